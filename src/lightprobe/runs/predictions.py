"""The light of new photos from a run, and the files it goes to: one map a photo, or one of several photos
together.

A photo without a camera is located first (`localization`); camera, mask and overlay go beside its map.
"""

import warnings
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import torch
from torch import Tensor

from lightprobe.core.config.prediction import UNCHANGED, Method, PredictionOptions, Sun
from lightprobe.core.device import resolve_device
from lightprobe.core.errors import ConfigError, InputError, LightprobeWarning
from lightprobe.core.files import refuse_replacing, remove
from lightprobe.core.run import RunFolder
from lightprobe.evaluation import write_prediction
from lightprobe.export.light_file import PhotoFacts, write_light_file
from lightprobe.light.files import light_file, other_map
from lightprobe.prediction import Prediction, Predictor, check_names, methods_for
from lightprobe.prediction.verdict import tells_nothing
from lightprobe.runs.loaded import LoadedRun
from lightprobe.runs.locations import LocatedPhoto, LocationFiles, file_stem, photo_mask, refuse_namesakes
from lightprobe.runs.new_photos import NewPhoto, NewPhotos, PhotoFiles
from lightprobe.scene.photo import OPAQUE, Pixels
from lightprobe.scene.record import read_record


@dataclass(frozen=True)
class PredictionFiles:
    """Where photos' masks and cameras are, and where maps go; of several all but `camera` are folders."""

    camera: Path | None = None
    """Camera of the photo, or many of which its name chooses; by default the run's own, or it is found."""
    mask: Path | None = None
    """White object on black; by default the photo's alpha, or it is found with the camera."""
    output: Path | None = None
    """The map, .exr or .hdr, or a folder that is there; by default RUN/predictions, with picture and
    confidence.
    """
    confidence: Path | None = None
    """The confidence, .exr, or a folder that is there."""
    location: LocationFiles = field(default_factory=LocationFiles)
    """Camera, mask and overlay of a photo whose camera is found; by default beside the map."""
    height: int | None = None
    """Rows of the maps, see `light.upsampling`; by default twice the texels along a cubemap edge."""
    sun: Sun = Sun.INSIDE
    """Whether the maps have the light's suns and lamps, which the .light.json beside them lists."""
    sources: bool = True
    """Whether suns and lamps are looked for: most of what the single step costs."""

    def check(self, photos: int) -> None:
        """Raise `ConfigError` for files of so many photos that no prediction could write."""
        self.location.check(photos)
        self.sun.check(self.sources)


@dataclass(frozen=True)
class PredictedPhoto:
    """A photo's prediction, and where its map is."""

    image: Path
    output: Path
    method: Method
    prediction: Prediction
    facts: PhotoFacts
    location: LocatedPhoto | None = None
    """Its camera and mask, if they were found."""


@dataclass(frozen=True)
class MapFiles:
    """Where a map goes, and how it is written."""

    output: Path
    confidence: Path | None
    kept: bool  # in the run, with a picture and the confidence beside it
    height: int | None
    sun: Sun

    @staticmethod
    def of(
        run: RunFolder, image: Path, several: bool, method: Method | None, files: PredictionFiles
    ) -> "MapFiles":
        """Refuse what could not be written, before any work; `image` names the map where nothing else does."""
        output, confidence, stem = files.output, files.confidence, file_stem(image)
        if several:
            for place in (output, confidence):
                if place is not None and (place.suffix.lower() in (".exr", ".hdr") or place.is_file()):
                    raise ConfigError(
                        f"Of several photos the maps need a folder, and {place} is named like one map."
                    )
        if output is not None and (several or output.is_dir()):
            output = output / f"{stem}.exr"
        if confidence is not None and (several or confidence.is_dir()):
            confidence = confidence / f"{stem}.confidence.exr"
        check_names(output, confidence)
        stored = run.prediction_file(stem, ".exr", method.value if method else None)
        return MapFiles(output or stored, confidence, output is None, files.height, files.sun)

    def write(self, prediction: Prediction, facts: PhotoFacts) -> None:
        """Write the map and what goes with it; the .light.json comes last, and an older one goes first."""
        other = other_map(self.output)
        if other is not None:
            warnings.warn(
                f"{light_file(self.output)} told the sources of {other.name} and is now that of {self.output.name}; "
                "give maps of one folder different names.",
                LightprobeWarning,
                stacklevel=2,
            )
        remove(light_file(self.output))
        if self.kept:
            write_prediction(prediction, self.output, self.height, self.sun)
            if self.confidence is not None:
                prediction.save_confidence(self.confidence)
        else:
            prediction.save(self.output, self.confidence, height=self.height, sun=self.sun)
        write_light_file(self.output, prediction, facts, self.sun, self.height)


@dataclass(frozen=True)
class PhotoPredictions:
    """Photos ready to be predicted from: everything is read and checked that can be before any work."""

    method: Method
    trained: bool  # whether the run has a model; without one the light is only solved for
    _predictor: Predictor
    _images: Sequence[Path]
    _maps: Sequence[MapFiles]
    _photos: NewPhotos
    _sources: bool

    def __iter__(self) -> Iterator[PredictedPhoto]:
        """Predict and write photo by photo; errors as in `unwritten`."""
        for files, predicted in self.unwritten():
            files.write(predicted.prediction, predicted.facts)
            yield predicted

    def unwritten(self) -> Iterator[tuple[MapFiles, PredictedPhoto]]:
        """Predict photo by photo, with where each map is meant to go.

        Raises `InputError` at the end when photos got no map: one that cannot serve must not cost those of
        the others.
        """
        failures: list[str] = []
        for index, (image, files) in enumerate(zip(self._images, self._maps, strict=True)):
            try:
                photo = self._photos.read(index)
                prediction = self._predictor.predict(
                    photo.pixels,
                    photo.pixel_camera,
                    self.method,
                    background=photo.background,
                    doubt=photo.doubt,
                    sources=self._sources,
                )
            except InputError as error:
                failures.append(f"{image} gets no map. {error}")
                continue
            facts = _facts(image, photo)
            yield files, PredictedPhoto(image, files.output, self.method, prediction, facts, photo.location)
        if failures:
            raise InputError(" ".join(failures))


def predict_photos(
    run_folder: Path | str,
    images: Sequence[Path],
    files: PredictionFiles | None = None,
    *,
    method: Method | None = None,
    settings: PredictionOptions = UNCHANGED,
    background: bool = True,
    device: str | torch.device = "auto",
    loaded: LoadedRun | None = None,
) -> PhotoPredictions:
    """Return the predictions from photos of a run's object, which are made and written as they are iterated
    over.

    method: by default the run's own, or the best it has a model for. settings: what changes of how the run
    predicts. background: whether what opaque photos show around the object is used. loaded: this run, with
    its device and settings, where it is loaded already. Raises `InputError` for a run, photo, mask or camera
    that cannot be used, `ConfigError` for names of files that cannot be written or mean two maps.
    """
    run, files = _checked(run_folder, images, files)
    refuse_namesakes(images, "predict them one by one, or rename one")
    maps = [MapFiles.of(run, image, len(images) > 1, method, files) for image in images]
    written = [path for one in maps for path in (one.output, one.confidence)]
    _refuse_replacing(written, images, files)
    folders = [one.output.parent for one in maps]
    photos = NewPhotos(run, _photo_files(images, files, folders), files.camera, background)
    loaded = loaded or LoadedRun(run, resolve_device(device), settings)
    loaded.make_ready(photos)
    predictor = loaded.predictor
    chosen = method or methods_for(predictor.model, predictor.config)[0]
    return PhotoPredictions(
        chosen, predictor.model is not None, predictor, images, maps, photos, files.sources
    )


@dataclass(frozen=True)
class JointPrediction:
    """The one light of several photos, in the exposure of the first of them that serves."""

    images: tuple[Path, ...]  # that serve
    output: Path
    method: Method
    trained: bool
    prediction: Prediction
    exposures: Tensor  # (N,) relative to the first
    measured: bool  # whether the exposures are the photos' EXIF's; else they were found with the light
    locations: tuple[LocatedPhoto, ...]
    left_out: dict[Path, str]  # photos that cannot serve, and why


def predict_one_light(
    run_folder: Path | str,
    images: Sequence[Path],
    files: PredictionFiles | None = None,
    *,
    method: Method | None = None,
    settings: PredictionOptions = UNCHANGED,
    background: bool = True,
    device: str | torch.device = "auto",
) -> JointPrediction:
    """Predict and write the one light that all photos of a run's object were taken under.

    The map is named after the first photo. The rest as in `predict_photos`. Photos that cannot serve are left
    out; raises `InputError` when none is left, and `ConfigError` when two photos have the same name: a photo
    that is given twice tells nothing more, and what is found of two that are named alike would go into one
    file.
    """
    run, files = _checked(run_folder, images, files)
    refuse_namesakes(images, "give each photo once, and rename those named alike")
    target = MapFiles.of(run, images[0], False, method, files)
    _refuse_replacing([target.output, target.confidence], images, files)
    folders = [target.output.parent] * len(images)
    photos = NewPhotos(run, _photo_files(images, files, folders), files.camera, background)
    loaded = LoadedRun(run, resolve_device(device), settings)
    loaded.make_ready(photos)
    predictor = loaded.predictor
    chosen = method or methods_for(predictor.model, predictor.config)[0]
    read, left_out = _readable(photos, images)
    if not read:
        raise InputError(" ".join(f"{image} gets no map. {reason}" for image, reason in left_out.items()))
    seen = list(read.values())
    given = _exif_exposures(seen)
    prediction, exposures = predictor.predict_together(
        [(photo.pixels, photo.pixel_camera) for photo in seen],
        chosen,
        exposures=given,
        backgrounds=[photo.background for photo in seen],
        doubt=max(photo.doubt for photo in seen),
        sources=files.sources,
    )
    target.write(prediction, _facts(next(iter(read)), seen[0]))
    return JointPrediction(
        tuple(read),
        target.output,
        chosen,
        predictor.model is not None,
        prediction,
        exposures,
        given is not None,
        tuple(photo.location for photo in seen if photo.location is not None),
        left_out,
    )


def _checked(
    run_folder: Path | str, images: Sequence[Path], files: PredictionFiles | None
) -> tuple[RunFolder, PredictionFiles]:
    """Return the run and the files; raise `InputError` or `ConfigError` where there is nothing to predict
    from.
    """
    run, files = RunFolder.open(Path(run_folder)), files or PredictionFiles()
    if not images:
        raise ConfigError("No photo is named: lightprobe predict RUN IMAGE.")
    if files.camera is None:
        read_record(run)  # it has the cameras
    files.check(len(images))
    return run, files


def _refuse_replacing(maps: Sequence[Path | None], images: Sequence[Path], files: PredictionFiles) -> None:
    """Raise `ConfigError` where what is written would replace a photo, a mask or a file of cameras."""
    masks = [photo_mask(image, files.mask) for image in images]
    refuse_replacing([*maps, *files.location.chosen()], [*images, *masks, files.camera])


def _facts(image: Path, photo: NewPhoto) -> PhotoFacts:
    return PhotoFacts(image.name, photo.camera, photo.ev100)


def _photo_files(images: Sequence[Path], files: PredictionFiles, folders: Sequence[Path]) -> list[PhotoFiles]:
    return [
        PhotoFiles(image, photo_mask(image, files.mask), files.location.within(folder, image))
        for image, folder in zip(images, folders, strict=True)
    ]


def _readable(photos: NewPhotos, images: Sequence[Path]) -> tuple[dict[Path, NewPhoto], dict[Path, str]]:
    """Return the photos that tell something of the light, and why the others do not serve."""
    read: dict[Path, NewPhoto] = {}
    left_out: dict[Path, str] = {}
    for index, image in enumerate(images):
        try:
            photo = photos.read(index)
        except InputError as error:
            left_out[image] = str(error)
            continue
        nothing = _tells_nothing(photo.pixels)
        if nothing is None:
            read[image] = photo
        else:
            left_out[image] = nothing
    return read, left_out


def _tells_nothing(pixels: Pixels) -> str | None:
    """Return why the object's pixels tell nothing about the light; None where they may, or where there is
    none.
    """
    opaque = pixels.alpha >= OPAQUE
    if not opaque.any():
        return None
    return tells_nothing(float(pixels.clipped[opaque].mean()), float(pixels.color[opaque].mean()))


def _exif_exposures(photos: Sequence[NewPhoto]) -> list[float] | None:
    """Return the exposures that EXIF gives, relative to the first photo's, or None unless all photos have
    them.

    A camera's values are radiance times 2^-EV100, up to what all its photos share.
    """
    values = [photo.ev100 for photo in photos if photo.ev100 is not None]
    return [2.0 ** (values[0] - value) for value in values] if len(values) == len(photos) else None
