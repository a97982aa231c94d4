"""The prediction job: a photo is read, its camera found, its light predicted, and the files of its answer written.

    PredictRequest, Session, AnswerFiles -> Answer

Of one photo, of several one by one or together, or of a video's frames.
"""

import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import torch

from lightprobe.core.config.prediction import Method
from lightprobe.core.device import resolve_device
from lightprobe.core.errors import ConfigError, InputError
from lightprobe.core.files import read_json, refuse_replacing
from lightprobe.core.run import RunFolder
from lightprobe.export.light_file import PhotoFacts
from lightprobe.imaging import is_video, write_png
from lightprobe.imaging.video import frames
from lightprobe.jobs.files import BY_NAME, LOCATION, AnswerFiles, ChosenFiles, is_map_name, refuse_namesakes
from lightprobe.jobs.photos import LocatedPhoto, NewPhoto, known_photo, locate_photo
from lightprobe.jobs.request import Output, PredictRequest
from lightprobe.jobs.session import Session
from lightprobe.light.environment import Environment
from lightprobe.light.files import light_file
from lightprobe.light.sources import split_light
from lightprobe.prediction import Prediction, check_names
from lightprobe.prediction.sequence import flicker, steadied
from lightprobe.prediction.verdict import tells_nothing
from lightprobe.scene import Photo
from lightprobe.scene.frame import cut_name
from lightprobe.scene.photo import OPAQUE
from lightprobe.scene.record import read_record

EVERY = 10
"""Every so many frames of a video are predicted from by default."""

_NAME_BYTES = 200  # of a video's name that the name of its folder can hold
OnStage = Callable[[str], None]


@dataclass(frozen=True)
class Answer:
    """The light in a photo, and where its files are."""

    request: PredictRequest
    files: AnswerFiles
    method: Method
    prediction: Prediction
    facts: PhotoFacts
    location: LocatedPhoto | None  # None: the camera was known
    seconds: Mapping[str, float]  # of locating, of the prediction's parts and their total, and of all

    @property
    def sentences(self) -> list[str]:
        """What is doubtful about the camera that was found, and about the light."""
        pose = () if self.location is None else self.location.sentences
        return [*pose, *self.prediction.verdict.sentences]

    @property
    def light(self) -> dict[str, Any]:
        """The light file."""
        value: dict[str, Any] = read_json(light_file(self.files.light))
        return value

    def to_json(self) -> dict[str, Any]:
        """Return what every door tells."""
        return {
            "method": self.method.value,
            "verdict": self.prediction.verdict.to_json(),
            "pose": None if self.location is None else self.location.located.verdict.to_json(),
            "background": self.prediction.background.value,
            "seconds": dict(self.seconds),
            "files": {output.value: str(path) for output, path in self.files.paths.items() if path.is_file()},
        }


@dataclass(frozen=True)
class JointAnswer:
    """The one light of several photos, in the exposure of the first of them that serves."""

    answer: Answer  # of that first photo's request
    exposures: dict[Path, float]  # of the photos that serve, relative to the first
    measured: bool  # whether the exposures are the photos' EXIF's; else they were found with the light
    locations: tuple[LocatedPhoto, ...]
    left_out: dict[Path, str]  # photos that cannot serve, and why


@dataclass(frozen=True)
class VideoAnswer:
    """The maps of a video's frames."""

    answers: tuple[Answer, ...]  # in order, their maps steadied; without locations, which hold whole frames
    flicker: tuple[float, float]  # before and after, see `prediction.sequence.flicker`
    failures: str | None  # why frames got no map


def predict_photo(
    session: Session, request: PredictRequest, files: AnswerFiles, on_stage: OnStage = lambda stage: None
) -> Answer:
    """Predict the light in one photo, and write the files of the answer.

    on_stage: called with what is done next. Raises `InputError` for files that cannot be used, a photo
    without the object and one that no light explains.
    """
    answer = _predicted(session, request, files, known_photo(session.run, request), on_stage)
    on_stage("writing")
    return _written(answer)


def predict_photos(
    session: Session, requests: Sequence[PredictRequest], chosen: ChosenFiles = BY_NAME
) -> Iterator[Answer]:
    """Return the answers to photos of one object, which are made and written as they are iterated over.

    Before that everything is checked that can be. Raises `InputError` for a run, photo, mask or camera that
    cannot be used, `ConfigError` for names of files that cannot be written or mean two maps. In the end
    raises `InputError` when photos got no map: one that cannot serve must not cost those of the others.
    """
    return (_written(answer) for answer in _unwritten(session, requests, chosen))


def predict_together(
    session: Session,
    requests: Sequence[PredictRequest],
    chosen: ChosenFiles = BY_NAME,
    *,
    every: int = EVERY,
) -> JointAnswer:
    """Predict and write the one light of all photos of an object, or of every `every`-th frame of a video.

    The options are the first request's, and the map is named after its photo; the frames of a video go into
    the folder of the map, or into one of the map's name. The rest as in `predict_photos`. Photos that cannot
    serve are left out; raises `InputError` when none is left, and `ConfigError` when two photos have the same
    name: a photo that is given twice tells nothing more.
    """
    start = time.perf_counter()
    if requests and is_video(requests[0].photo):
        requests, chosen = _frames_together(session.run, requests[0], chosen, every)
    advice = "give each photo once, and rename those named alike"
    (target,), known = _ready(session, requests, chosen, advice, together=True)
    read, left_out = dict[Path, NewPhoto](), dict[Path, str]()
    for request, photo in zip(requests, known, strict=True):
        location = chosen.location_of(target.light.parent, request.photo)
        try:
            found = session.read(request, photo, location)
        except InputError as error:
            left_out[request.photo] = str(error)
            continue
        nothing = _tells_nothing(found)
        if nothing is None:
            read[request.photo] = found
        else:
            left_out[request.photo] = nothing
    if not read:
        raise InputError(" ".join(f"{image} gets no map. {reason}" for image, reason in left_out.items()))
    seen = list(read.values())
    given = _exif_exposures(seen)
    prediction, exposures = session.predict_together(seen, requests[0], given)
    first = next(request for request in requests if request.photo in read)
    answer = _answer(session, first, target, seen[0], prediction, start)
    return JointAnswer(
        _written(replace(answer, location=None)),
        dict(zip(read, exposures, strict=True)),
        given is not None,
        tuple(photo.location for photo in seen if photo.location is not None),
        left_out,
    )


def predict_video(
    session: Session,
    request: PredictRequest,
    chosen: ChosenFiles = BY_NAME,
    *,
    every: int = EVERY,
    on_answer: Callable[[Answer], None] = lambda answer: None,
) -> VideoAnswer:
    """Predict the light of every `every`-th frame of a video, and write the maps without their flicker.

    on_answer: called with each frame's answer as it is made, before the maps are steadied. The rest as in
    `predict_photos`; frames in which the object is not found get no map. Raises `InputError` when none gets
    one.
    """
    folder = _video_folder(session.run, request.photo, chosen.output)
    shots = _video_frames(request, folder, every)
    where = folder if len(shots) > 1 else folder / f"{shots[0].photo.stem}.exr"
    made, failures = list[Answer](), None
    try:
        for answer in _unwritten(session, shots, replace(chosen, output=where)):
            on_answer(answer)
            made.append(replace(answer, location=None))
    except InputError as error:
        failures = str(error)
    if not made:
        raise InputError(failures or f"{request.photo} has no frames.")
    lights = torch.stack([answer.prediction.environment.texels for answer in made])
    steady = steadied(lights, torch.stack([answer.prediction.confidence for answer in made]))
    answers = [
        _written(replace(answer, prediction=_steady(answer.prediction, Environment(light))))
        for answer, light in zip(made, steady, strict=True)
    ]
    return VideoAnswer(tuple(answers), (flicker(lights), flicker(steady)), failures)


def locate_photos(
    run: Path | str,
    images: Sequence[Path],
    folder: Path | None = None,
    *,
    location: Mapping[Output, Path] | None = None,
    mask: Path | None = None,
    device: str | torch.device = "auto",
) -> Iterator[LocatedPhoto]:
    """Locate photos of a run's object one after the other, and write camera, mask and overlay of each.

    folder: for the files, by default RUN/predictions; location: their names, if others. mask: white object on
    black, of several photos a folder. Raises `InputError` at the end when the object was not found in photos,
    and before any work for a run that cannot be used, `ConfigError` for names that cannot be written.
    """
    opened, chosen = RunFolder.open(Path(run)), ChosenFiles(location=location or {})
    if not images:
        raise ConfigError("No photo is named: lightprobe locate RUN IMAGE.")
    requests = [PredictRequest(photo=image, mask=mask) for image in images]
    chosen.check(len(images))
    _refuse_replacing(chosen.location.values(), requests)
    refuse_namesakes(images, "locate them one by one, or rename one")
    where, device = folder or opened.path / "predictions", resolve_device(device)

    def located() -> Iterator[LocatedPhoto]:
        from lightprobe.localization import Locator

        locator, failures = Locator.load(opened.path, device), list[str]()
        for request in requests:
            try:
                yield locate_photo(locator, request, chosen.location_of(where, request.photo))
            except InputError as error:
                failures.append(str(error))
        if failures:
            raise InputError(" ".join(failures))

    return located()


def _predicted(
    session: Session,
    request: PredictRequest,
    files: AnswerFiles,
    known: Photo | None,
    on_stage: OnStage = lambda stage: None,
) -> Answer:
    """Return the answer to a request, its maps still to be written."""
    start = time.perf_counter()
    if known is None:
        on_stage("finding the object in the photo")
    whole = files.known and Output.MASK in files.paths
    photo = session.read(request, known, files.location, whole=whole)
    if files.known and known is not None:
        photo.write_location(files.location)
    on_stage("predicting the light")
    return _answer(session, request, files, photo, session.predict(photo, request), start)


def _answer(
    session: Session,
    request: PredictRequest,
    files: AnswerFiles,
    photo: NewPhoto,
    prediction: Prediction,
    start: float,
) -> Answer:
    locating = 0.0 if photo.location is None else photo.location.located.seconds
    seconds = {"locate": locating, **prediction.seconds, "all": time.perf_counter() - start}
    facts = PhotoFacts(request.name or request.photo.name, photo.camera, photo.ev100)
    return Answer(request, files, session.method(request), prediction, facts, photo.location, seconds)


def _unwritten(session: Session, requests: Sequence[PredictRequest], chosen: ChosenFiles) -> Iterator[Answer]:
    """Return the answers of `predict_photos`, their maps still to be written."""
    files, known = _ready(session, requests, chosen, "predict them one by one, or rename one")

    def answers() -> Iterator[Answer]:
        failures = list[str]()
        for request, target, photo in zip(requests, files, known, strict=True):
            try:
                yield _predicted(session, request, target, photo)
            except InputError as error:
                failures.append(f"{request.photo} gets no map. {error}")
        if failures:
            raise InputError(" ".join(failures))

    return answers()


def _written(answer: Answer) -> Answer:
    answer.files.write(answer.prediction, answer.facts, answer.request)
    return answer


def _ready(
    session: Session,
    requests: Sequence[PredictRequest],
    chosen: ChosenFiles,
    advice: str,
    *,
    together: bool = False,
) -> tuple[list[AnswerFiles], list[Photo | None]]:
    """Check all that can be before any work, and load what is needed.

    Returns the files of each answer, of `together` one, and the photos whose camera is known. advice: what to
    do about photos of the same name. Raises `InputError` and `ConfigError` as `predict_photos`.
    """
    if not requests:
        raise ConfigError("No photo is named: lightprobe predict RUN IMAGE.")
    if any(request.camera is None for request in requests):
        read_record(session.run)  # it has the cameras
    chosen.check(len(requests))
    refuse_namesakes([request.photo for request in requests], advice)
    several, named = len(requests) > 1 and not together, requests[:1] if together else requests
    files = [chosen.of(session.run, request.photo, several, request) for request in named]
    maps = [path for one in files for output, path in one.paths.items() if output not in LOCATION]
    _refuse_replacing([*maps, *chosen.location.values()], requests)
    known = [known_photo(session.run, request) for request in requests]
    session.method(requests[0])
    if None in known:
        session.locator  # noqa: B018  loaded, or refused
    return files, known


def _refuse_replacing(written: Iterable[Path], requests: Sequence[PredictRequest]) -> None:
    """Raise `ConfigError` where what is written would replace a photo, a mask or a file of cameras."""
    refuse_replacing(written, [path for one in requests for path in (one.photo, one.mask_file, one.camera)])


def _tells_nothing(photo: NewPhoto) -> str | None:
    """Return why the object's pixels tell nothing about the light; None where they may, or where there is none."""
    pixels = photo.pixels
    opaque = pixels.alpha >= OPAQUE
    if not opaque.any():
        return None
    return tells_nothing(float(pixels.clipped[opaque].mean()), float(pixels.color[opaque].mean()))


def _exif_exposures(photos: Sequence[NewPhoto]) -> list[float] | None:
    """Return the exposures that EXIF gives, relative to the first photo's, or None unless all photos have them.

    A camera's values are radiance times 2^-EV100, up to what all its photos share.
    """
    values = [photo.ev100 for photo in photos if photo.ev100 is not None]
    return [2.0 ** (values[0] - value) for value in values] if len(values) == len(photos) else None


def _video_folder(run: RunFolder, video: Path, output: Path | None) -> Path:
    """Return where the maps of a video go; raise `ConfigError` when `output` is no name of a folder."""
    if is_map_name(output):
        raise ConfigError(f"The maps of a video need a folder, and {output} is named like one map.")
    return output or run.path / "predictions" / cut_name(video.stem, _NAME_BYTES)


def _video_frames(request: PredictRequest, folder: Path, every: int) -> list[PredictRequest]:
    """Write every `every`-th frame of a video as PNG into `folder`/frames; return a request for each.

    Raises `InputError` for a video that cannot be read, `ConfigError` for an `every` below 1.
    """
    if every < 1:
        raise ConfigError(f"--every must be at least 1, not {every}.")
    shots = list[PredictRequest]()
    for frame in frames(request.photo, every):
        path = folder / "frames" / f"frame_{frame.index:06d}.png"
        write_png(path, frame.color)
        shots.append(replace(request, photo=path))
    return shots


def _frames_together(
    run: RunFolder, request: PredictRequest, chosen: ChosenFiles, every: int
) -> tuple[list[PredictRequest], ChosenFiles]:
    """Return the frames of a video, and the files of their one map; the frames are written."""
    output = chosen.output
    if output is None or output.is_dir():
        folder = _video_folder(run, request.photo, output)
    else:
        check_names(output, chosen.confidence)  # before the frames are written
        folder = output.with_suffix("")
    shots = _video_frames(request, folder, every)
    return shots, replace(chosen, output=output or folder / f"{folder.name}.exr")


def _steady(prediction: Prediction, environment: Environment) -> Prediction:
    """Return a frame's prediction with its steadied map, and with the sources of the steadied map."""
    split = None if prediction.split is None else split_light(environment)
    return replace(prediction, environment=environment, split=split)
