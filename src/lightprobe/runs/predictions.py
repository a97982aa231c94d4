"""The light of new photos from a run, one photo after the other, and the files it goes to.

A photo without a camera is located first (`localization`); camera, mask and overlay go beside its map.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

import torch

from lightprobe.core.config.prediction import UNCHANGED, Method, PredictionOptions
from lightprobe.core.device import resolve_device
from lightprobe.core.errors import ConfigError, InputError
from lightprobe.core.run import RunFolder
from lightprobe.evaluation import write_prediction
from lightprobe.imaging import image_size
from lightprobe.prediction import Prediction, Predictor, check_names, methods_for, recorded_config
from lightprobe.runs.locations import LocatedPhoto, LocationFiles, is_own_photo, locate_photo, photo_mask
from lightprobe.scene import Photo, load_pixels, new_photo
from lightprobe.scene.frame import cut_name
from lightprobe.scene.record import read_record

if TYPE_CHECKING:  # the package is loaded when a photo is located, and not before
    from lightprobe.localization import Locator

_STEM_BYTES = 255 - len(".confidence.exr")  # of a photo's name that the names of its maps can hold


@dataclass(frozen=True)
class PredictionFiles:
    """Where photos' masks and cameras are, and where their maps go; of several photos all but `camera` are folders."""

    camera: Path | None = None
    """Camera of the photo, or many of which its name chooses; by default the run's own, or it is found."""
    mask: Path | None = None
    """White object on black; by default the photo's alpha, or it is found with the camera."""
    output: Path | None = None
    """The map, .exr or .hdr; by default RUN/predictions, with a picture and the confidence beside it."""
    confidence: Path | None = None
    """The confidence, .exr."""
    location: LocationFiles = field(default_factory=LocationFiles)
    """Camera, mask and overlay of a photo whose camera is found; by default beside the map."""


@dataclass(frozen=True)
class PredictedPhoto:
    """A photo's prediction, and where its map is."""

    image: Path
    output: Path
    method: Method
    prediction: Prediction
    location: LocatedPhoto | None = None
    """Its camera and mask, if they were found."""


@dataclass(frozen=True)
class PhotoPredictions:
    """Photos ready to be predicted from: everything is read and checked that can be before any work."""

    method: Method
    trained: bool  # whether the run has a model; without one the light is only solved for
    _predictor: Predictor
    _jobs: list["_Job"]
    _photos: list[Photo | None]  # None: to be located
    _locator: "Locator | None"

    def __iter__(self) -> Iterator[PredictedPhoto]:
        """Predict and write photo by photo.

        Raises `InputError` at the end when photos got no map: one that cannot serve must not cost those of the others.
        """
        failures: list[str] = []
        for job, photo in zip(self._jobs, self._photos, strict=True):
            location, doubt = None, 0.0
            try:
                if photo is None:
                    location = self._located(job)
                    pixels, camera = location.located.pixels, location.located.camera
                    doubt = location.located.verdict.doubt
                else:
                    pixels, camera = load_pixels(photo)
                prediction = self._predictor.predict(pixels, camera, self.method, doubt=doubt)
            except InputError as error:
                failures.append(f"{job.image} gets no map. {error}")
                continue
            job.write(prediction)
            yield PredictedPhoto(job.image, job.output, self.method, prediction, location)
        if failures:
            raise InputError("\n".join(failures))

    def _located(self, job: "_Job") -> LocatedPhoto:
        if self._locator is None:
            raise ValueError("Loaded with the photos that need it.")
        return locate_photo(self._locator, job.image, job.mask, job.location)


def predict_photos(
    run_folder: Path | str, images: Sequence[Path], files: PredictionFiles | None = None, *,
    method: Method | None = None, settings: PredictionOptions = UNCHANGED, device: str | torch.device = "auto",
) -> PhotoPredictions:  # fmt: skip
    """Return the predictions from photos of a run's object, which are made and written as they are iterated over.

    method: by default the run's own, or the best it has a model for. settings: what changes of how the run predicts.
    Raises `InputError` for a run, photo, mask or camera that cannot be used, `ConfigError` for names of files that
    cannot be written or mean two maps.
    """
    run, files = RunFolder.open(Path(run_folder)), files or PredictionFiles()
    if not images:
        raise ConfigError("No photo is named: lightprobe predict RUN IMAGE.")
    if files.camera is None:
        read_record(run)  # it has the cameras
    files.location.check(len(images))
    jobs = [
        _Job.of(run, image, len(images) > 1, files.mask, method, files.output, files.confidence, files.location)
        for image in images
    ]
    if len({job.output for job in jobs}) < len(jobs):
        raise ConfigError("Two of the photos have the same name, and so would their maps; predict them one by one.")
    photos = [_photo(run, job, files.camera) for job in jobs]
    predictor = Predictor.load(run.path, resolve_device(device), settings.over(recorded_config(run)))
    chosen = method or methods_for(predictor.model, predictor.config)[0]
    locator = _locator(run, predictor) if None in photos else None
    return PhotoPredictions(chosen, predictor.model is not None, predictor, jobs, photos, locator)


def _photo(run: RunFolder, job: "_Job", camera: Path | None) -> Photo | None:
    """Return a photo with the camera that is known of it, or None where it has to be located."""
    image_size(job.image)  # a file that is no photo is told before any work
    if camera is None and not is_own_photo(run, job.image):
        return None
    return new_photo(job.image, camera or run.scene_file, job.mask)


def _locator(run: RunFolder, predictor: Predictor) -> "Locator":
    from lightprobe.localization import Locator, stored_views

    views = stored_views(run, predictor.decomposition)
    return Locator(predictor.decomposition, views, predictor.device)


@dataclass(frozen=True)
class _Job:
    """One photo of a call, and where its results go."""

    image: Path
    mask: Path | None
    output: Path
    confidence: Path | None
    kept: bool  # in the run, with a picture and the confidence beside it
    location: LocationFiles

    @staticmethod
    def of(
        run: RunFolder, image: Path, several: bool, mask: Path | None, method: Method | None, output: Path | None,
        confidence: Path | None, location: LocationFiles | None = None,
    ) -> "_Job":  # fmt: skip
        """Refuse what could not be written, before any work."""
        mask = photo_mask(image, mask)
        stem = cut_name(image.stem, _STEM_BYTES)
        if several:
            for place in (output, confidence):
                if place is not None and (place.suffix.lower() in (".exr", ".hdr") or place.is_file()):
                    raise ConfigError(f"Of several photos the maps need a folder, and {place} is named like one map.")
            output = None if output is None else output / f"{stem}.exr"
            confidence = None if confidence is None else confidence / f"{stem}.confidence.exr"
        check_names(output, confidence)
        kept = output is None
        stored = run.prediction_file(stem, ".exr", method.value if method else None)
        target = output or stored
        return _Job(
            image, mask, target, confidence, kept, (location or LocationFiles()).within(target.parent, image)
        )  # fmt: skip

    def write(self, prediction: Prediction) -> None:
        if self.kept:
            write_prediction(prediction, self.output)
            if self.confidence is not None:
                prediction.save_confidence(self.confidence)
        else:
            prediction.save(self.output, self.confidence)
