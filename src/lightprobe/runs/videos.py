"""The light in a video: a map for every few frames, steadied, or one for all of them."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import torch

from lightprobe.core.config.prediction import UNCHANGED, Method, PredictionOptions
from lightprobe.core.errors import ConfigError, InputError
from lightprobe.core.run import RunFolder
from lightprobe.imaging import write_png
from lightprobe.imaging.video import frames
from lightprobe.light.environment import Environment
from lightprobe.light.sources import split_light
from lightprobe.prediction import Prediction, check_names
from lightprobe.prediction.sequence import flicker, steadied
from lightprobe.runs.predictions import (
    JointPrediction,
    PredictedPhoto,
    PredictionFiles,
    predict_one_light,
    predict_photos,
)
from lightprobe.scene.frame import cut_name

EVERY = 10  # by default every so many frames are predicted from
_NAME_BYTES = 200  # of a video's name that the name of its folder can hold


@dataclass(frozen=True)
class PredictedVideo:
    """The maps of a video's frames."""

    photos: tuple[
        PredictedPhoto, ...
    ]  # in order, their maps steadied; without locations, which hold whole frames
    flicker: tuple[float, float]  # before and after, see `prediction.sequence.flicker`
    failures: str | None  # why frames got no map


def video_frames(video: Path, folder: Path, every: int) -> list[Path]:
    """Write every `every`-th frame of a video as PNG into `folder`/frames, where its maps go, and return
    their paths.

    Raises `InputError` for a video that cannot be read, `ConfigError` for an `every` below 1.
    """
    if every < 1:
        raise ConfigError(f"--every must be at least 1, not {every}.")
    paths = []
    for frame in frames(video, every):
        paths.append(folder / "frames" / f"frame_{frame.index:06d}.png")
        write_png(paths[-1], frame.color)
    return paths


def video_folder(run: Path | str, video: Path, output: Path | None) -> Path:
    """Return where the maps of a video go; raise `ConfigError` when `output` is no name of a folder."""
    if output is not None and (output.suffix.lower() in (".exr", ".hdr") or output.is_file()):
        raise ConfigError(f"The maps of a video need a folder, and {output} is named like one map.")
    return output or RunFolder.open(Path(run)).path / "predictions" / cut_name(video.stem, _NAME_BYTES)


def predict_video(
    run: Path | str,
    video: Path,
    files: PredictionFiles | None = None,
    *,
    every: int = EVERY,
    method: Method | None = None,
    settings: PredictionOptions = UNCHANGED,
    background: bool = True,
    device: str | torch.device = "auto",
    on_photo: Callable[[PredictedPhoto], None] | None = None,
) -> PredictedVideo:
    """Predict the light of every `every`-th frame of a video, and write the maps without their flicker.

    on_photo: called with each frame's prediction as it is made, before the maps are steadied. The rest as in
    `predict_photos`; frames in which the object is not found get no map. Raises `InputError` when none gets
    one.
    """
    files = files or PredictionFiles()
    folder = video_folder(run, video, files.output)
    images = video_frames(video, folder, every)
    where = replace(files, output=folder if len(images) > 1 else folder / f"{images[0].stem}.exr")
    predictions = predict_photos(
        run, images, where, method=method, settings=settings, background=background, device=device
    )
    made, failures = [], None
    try:
        for target, predicted in predictions.unwritten():
            if on_photo is not None:
                on_photo(predicted)
            made.append((target, replace(predicted, location=None)))
    except InputError as error:
        failures = str(error)
    if not made:
        raise InputError(failures or f"{video} has no frames.")
    lights = torch.stack([one.prediction.environment.texels for _, one in made])
    steady = steadied(lights, torch.stack([one.prediction.confidence for _, one in made]))
    photos = []
    for (target, predicted), light in zip(made, steady, strict=True):
        prediction = _steady(predicted.prediction, Environment(light))
        target.write(prediction, predicted.facts)
        photos.append(replace(predicted, prediction=prediction))
    return PredictedVideo(tuple(photos), (flicker(lights), flicker(steady)), failures)


def _steady(prediction: Prediction, environment: Environment) -> Prediction:
    """Return a frame's prediction with its steadied map, and with that map's sources: one photo's flicker,
    too.
    """
    split = None if prediction.split is None else split_light(environment)
    return replace(prediction, environment=environment, split=split)


def predict_video_light(
    run: Path | str,
    video: Path,
    files: PredictionFiles | None = None,
    *,
    every: int = EVERY,
    method: Method | None = None,
    settings: PredictionOptions = UNCHANGED,
    background: bool = True,
    device: str | torch.device = "auto",
) -> JointPrediction:
    """Predict the one light of a video's frames; as `predict_video` and `predict_one_light`.

    The frames go into the folder of the map, or, where the map is named, into one of its name.
    """
    files = files or PredictionFiles()
    output = files.output
    if output is None or output.is_dir():
        folder = video_folder(run, video, output)
    else:
        check_names(output, files.confidence)  # before the frames are written
        folder = output.with_suffix("")
    images = video_frames(video, folder, every)
    where = replace(files, output=output or folder / f"{folder.name}.exr")
    return predict_one_light(
        run, images, where, method=method, settings=settings, background=background, device=device
    )
