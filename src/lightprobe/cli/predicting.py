"""predict, locate: from new photos of a known object to the light around it, and to their cameras."""

import sys
import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from tyro.conf import FlagCreatePairsOff, Positional

from lightprobe.cli.answer import say, say_one
from lightprobe.cli.options import Device, Prediction, RunArg, SizeArg, SunArg, option
from lightprobe.core.config.prediction import UNCHANGED, Method, PredictionOptions, Sun
from lightprobe.core.errors import ConfigError, InputError, LightprobeWarning
from lightprobe.core.files import shell_word
from lightprobe.imaging import is_video
from lightprobe.light.upsampling import map_height
from lightprobe.prediction import BackgroundUse
from lightprobe.prediction import Prediction as PredictionResult
from lightprobe.runs.locations import LocatedPhoto, LocationFiles, locate_photos
from lightprobe.runs.predictions import (
    JointPrediction,
    PredictedPhoto,
    PredictionFiles,
    predict_one_light,
    predict_photos,
)
from lightprobe.runs.videos import EVERY, predict_video, predict_video_light

_PhotosArg = Annotated[
    Positional[tuple[Path, ...]], option(metavar="IMAGE...", help="Photos of the object (at least one).")
]
_NewCameraArg = Annotated[
    Path | None,
    option(
        metavar="C.json", help="Camera of the photo, or many of which its name chooses; else it is found."
    ),
]
_MapArg = Annotated[
    Path | None,
    option(
        aliases=["-o"],
        metavar="ENV",
        help="The map, .exr or .hdr, or a folder that is there; several maps need one.",
    ),
]
_MaskArg = Annotated[
    Path | None,
    option(
        metavar="M",
        help="White object on black, or a folder with a .png like it for each photo; else the photo's alpha, or found.",
    ),
]
_SaveCameraArg = Annotated[Path | None, option(metavar="C.json", help="Name of the camera that was found.")]
_SaveMaskArg = Annotated[Path | None, option(metavar="M.png", help="Name of the mask that was found.")]
_SaveOverlayArg = Annotated[
    Path | None, option(metavar="O.png", help="Name of the photo with the object's outline as it was found.")
]
_MethodArg = Annotated[
    Method | None,
    option(
        metavar="METHOD",
        help=f"One of {', '.join(Method.offered())}; by default the run's own, or the best it has a model for.",
    ),
]
_ConfidenceArg = Annotated[
    Path | None, option(metavar="C.exr", help="Also write the confidence: .exr, or a folder as -o.")
]


_OneLightArg = Annotated[
    FlagCreatePairsOff[bool],
    option(help="All photos, or frames, were taken under one light: predict it from them together."),
]
_BackgroundArg = Annotated[
    bool, option(help="Use what photos show around the object; not for photos close to a wall or a table.")
]
_SourcesArg = Annotated[bool, option(help="Look for suns and lamps, some .3 s a photo.")]
_EveryArg = Annotated[
    int | None,
    option(metavar="N", help="Predict from every Nth frame of a video; by default from every tenth."),
]


def predict(
    run: RunArg,
    images: _PhotosArg,
    *,
    camera: _NewCameraArg = None,
    output: _MapArg = None,
    mask: _MaskArg = None,
    method: _MethodArg = None,
    confidence: _ConfidenceArg = None,
    save_camera: _SaveCameraArg = None,
    save_mask: _SaveMaskArg = None,
    save_overlay: _SaveOverlayArg = None,
    one_light: _OneLightArg = False,
    background: _BackgroundArg = True,
    every: _EveryArg = None,
    size: SizeArg = None,
    sun: SunArg = Sun.INSIDE,
    sources: _SourcesArg = True,
    settings: Prediction = UNCHANGED,
    device: Device = "auto",
) -> None:
    """Predict the environment around the object from one photo, from several one by one or together, or from a video.

    Without -o the map, a picture of it and the confidence of each direction go to RUN/predictions, of a video its
    frames and the maps alone. NAME.light.json beside the map has its suns and lamps, their brightness solved from the
    shadows in the photo, and more. Without --camera the object is found in the photo first, as by `lightprobe locate`;
    photos of the run's own scene have their cameras in the run. A photo that no light explains gets a warning and a
    lower confidence, or no map at all.

    Examples:
      lightprobe predict runs/cup new.jpg
      lightprobe predict runs/cup new.jpg -o light.exr --size 2048x1024 --sun separate
      lightprobe predict runs/cup left.jpg right.jpg --one-light -o light.exr
      lightprobe predict runs/cup clip.mp4 --every 10 -o lights
      lightprobe predict runs/cup new.jpg --camera new.json --mask new_mask.png -o light.exr
      lightprobe predict runs/cup test/r_003.png --camera transforms_test.json
      lightprobe predict runs/cup new.jpg --camera new.json --light-resolution 128 --method probe-mlp -o light.exr
      lightprobe predict runs/cup shots/*.png --camera shots/transforms.json --mask shots/masks -o lights
    """
    located = _wanted(camera, LocationFiles(save_camera, save_mask, save_overlay))
    height = None if size is None else map_height(size)
    files = PredictionFiles(camera, mask, output, confidence, located, height, sun, sources)
    how = _How(method, settings, background, device)
    video = _video_among(images, every)
    if video is not None:
        _predict_video(run, video, files, how, EVERY if every is None else every, one_light)
    elif one_light:
        _tell_joint(predict_one_light(run, images, files, **vars(how)), run, method)
    else:
        predictions = predict_photos(run, images, files, **vars(how))
        _tell_untrained(predictions.trained, run, method)
        for predicted in predictions:
            _tell(predicted)
            _tell_known(predicted, located)


@dataclass(frozen=True)
class _How:
    """What all ways of predicting take."""

    method: Method | None
    settings: PredictionOptions
    background: bool
    device: str


def _video_among(images: Sequence[Path], every: int | None) -> Path | None:
    """Return the video that is to be predicted from, None if it is photos; raise `ConfigError` for both at
    once.
    """
    video = next((image for image in images if is_video(image)), None)
    if video is not None and len(images) > 1:
        raise ConfigError(f"{video} is a video; predict from it alone, or from photos.")
    if video is None and every is not None:
        raise ConfigError("--every is about a video's frames; leave it out.")
    return video


def _predict_video(
    run: Path, video: Path, files: PredictionFiles, how: _How, every: int, one_light: bool
) -> None:
    if one_light:
        _tell_joint(predict_video_light(run, video, files, every=every, **vars(how)), run, how.method)
        return
    found = predict_video(run, video, files, every=every, on_photo=_tell, **vars(how))
    before, after = found.flicker
    say(
        f"{len(found.photos)} maps in {found.photos[0].output.parent}; from one to the next ln radiance changes by\n"
        f"{after:.3f} root mean square, {before:.3f} before they were steadied.",
        flicker={"before": before, "after": after},
    )
    if found.failures is not None:
        raise InputError(found.failures)


def _wanted(camera: Path | None, files: LocationFiles) -> LocationFiles:
    """Return the files of what is found; raise `ConfigError` where they are named although the camera is
    given.
    """
    if camera is not None and any(files.chosen()):
        raise ConfigError(
            "--save-camera, --save-mask and --save-overlay write what is found, and --camera gives that; leave it out."
        )
    return files


def _tell_known(predicted: PredictedPhoto, files: LocationFiles) -> None:
    """Warn where files of what is found are named for a photo in which nothing had to be looked for."""
    if predicted.location is None and any(files.chosen()):
        warnings.warn(
            f"{predicted.image} is a photo of the run's scene, whose camera is known: nothing was looked for, and "
            "--save-camera, --save-mask and --save-overlay write no file.",
            LightprobeWarning,
            stacklevel=2,
        )


def _tell_untrained(trained: bool, run: Path, method: Method | None) -> None:
    if not trained and method is None:
        command = f"lightprobe distill {shell_word(run)}"
        say(f"No trained model in {run}, so the light is only solved for; train one with: {command}")


def _tell(predicted: PredictedPhoto) -> None:
    """Print where a map is, what it cost and what its photo's verdict is; doubts go to standard error."""
    if predicted.location is not None:
        _tell_location(predicted.location)
    _tell_map(predicted.output, predicted.method, predicted.prediction, "photo", str(predicted.image))


def _tell_joint(joint: JointPrediction, run: Path, method: Method | None) -> None:
    """Print the same of a map of several photos, their exposures, and which of them did not serve.

    Raises `InputError` when some did not.
    """
    _tell_untrained(joint.trained, run, method)
    for location in joint.locations:
        _tell_location(location)
    _tell_map(joint.output, joint.method, joint.prediction, "photos", "the photos together")
    source = "from EXIF" if joint.measured else "found with the light, as not every photo's EXIF tells it"
    factors = ", ".join(
        f"{image.name} {value:.2f}"
        for image, value in zip(joint.images, joint.exposures.tolist(), strict=True)
    )
    exposures = dict(zip(map(str, joint.images), joint.exposures.tolist(), strict=True))
    left_out = {str(image): reason for image, reason in joint.left_out.items()}
    say(f"Exposures relative to the first, {source}: {factors}", exposures=exposures, left_out=left_out)
    if joint.left_out:
        raise InputError(
            " ".join(f"{image} is not in the map. {reason}" for image, reason in joint.left_out.items())
        )


def _tell_map(output: Path, method: Method, prediction: PredictionResult, of: str, source: str) -> None:
    verdict, seconds = prediction.verdict, prediction.seconds
    parts = ", ".join(f"{name} {value:.2f} s" for name, value in seconds.items())
    around = (
        "" if prediction.background is BackgroundUse.ABSENT else f"; background {prediction.background.value}"
    )
    line = f"Environment: {output} ({method.value}; {parts}; {of} {verdict.status.value}{around})"
    values = {"source": source, "environment": output, "method": method, "seconds": seconds}
    say_one(
        "predictions", line, {**values, "verdict": verdict.to_json(), "background": prediction.background}
    )
    for sentence in verdict.sentences:
        print(f"lightprobe: warning: {source}: {sentence}", file=sys.stderr)


def locate(
    run: RunArg,
    images: _PhotosArg,
    *,
    output: Annotated[
        Path | None, option(aliases=["-o"], metavar="FOLDER", help="Folder for the files.")
    ] = None,
    mask: _MaskArg = None,
    save_camera: _SaveCameraArg = None,
    save_mask: _SaveMaskArg = None,
    save_overlay: _SaveOverlayArg = None,
    device: Device = "auto",
) -> None:
    """Find the object in new photos: from where each was taken, with which focal length, and the object's
    mask.

    NAME.camera.json, NAME.mask.png and NAME.overlay.png, the photo with the object's outline, go to FOLDER,
    without -o to RUN/predictions. A photo without the object is refused; where the pose is doubtful, a
    warning says so.

    Examples:
      lightprobe locate runs/cup new.jpg
      lightprobe locate runs/cup shots/*.jpg -o shots/cameras
    """
    files = LocationFiles(save_camera, save_mask, save_overlay)
    for photo in locate_photos(run, images, output, files=files, mask=mask, device=device):
        _tell_location(photo)


def _tell_location(photo: LocatedPhoto) -> None:
    """Print where a camera is and what its verdict is; doubts go to standard error."""
    verdict, camera = photo.located.verdict, photo.located.camera
    found = f"focal length {camera.fx:.0f} px; {photo.located.seconds:.2f} s; pose {verdict.status.value}"
    values = {"photo": photo.image, "files": photo.files, "camera": camera.to_json()}
    values |= {"seconds": photo.located.seconds, "verdict": verdict.to_json()}
    say_one("cameras", f"Camera: {photo.files.camera} ({found})", values)
    for sentence in photo.warnings():
        print(f"lightprobe: warning: {photo.image}: {sentence}", file=sys.stderr)
