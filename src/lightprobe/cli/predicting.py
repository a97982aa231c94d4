"""predict, locate: from new photos of a known object to the light around it, and to their cameras."""

import sys
import warnings
from pathlib import Path
from typing import Annotated

from tyro.conf import FlagCreatePairsOff, Positional, arg

from lightprobe.cli.answer import say, say_one
from lightprobe.cli.options import Device, FoundCameraArg, MaskArg, Prediction, RunArg, option
from lightprobe.core.config.prediction import UNCHANGED
from lightprobe.core.errors import ConfigError, InputError, LightprobeWarning
from lightprobe.core.files import shell_word
from lightprobe.imaging import is_video
from lightprobe.jobs import (
    EVERY,
    Answer,
    ChosenFiles,
    JointAnswer,
    LightOptions,
    LocatedPhoto,
    Output,
    PredictRequest,
    Session,
    locate_photos,
    predict_photos,
    predict_together,
    predict_video,
)
from lightprobe.prediction import BackgroundUse

_PhotosArg = Annotated[
    Positional[tuple[Path, ...]], option(metavar="IMAGE...", help="Photos of the object (at least one).")
]
_MapArg = Annotated[
    Path | None,
    option(
        aliases=["-o"],
        metavar="ENV",
        help="The map, .exr or .hdr, or a folder that is there; several maps need one.",
    ),
]
_SaveCameraArg = Annotated[Path | None, option(metavar="C.json", help="Name of the camera that was found.")]
_SaveMaskArg = Annotated[Path | None, option(metavar="M.png", help="Name of the mask that was found.")]
_SaveOverlayArg = Annotated[
    Path | None, option(metavar="O.png", help="Name of the photo with the object's outline as it was found.")
]
_ConfidenceArg = Annotated[
    Path | None, option(metavar="C.exr", help="Also write the confidence: .exr, or a folder as -o.")
]
_OneLightArg = Annotated[
    FlagCreatePairsOff[bool],
    option(help="All photos, or frames, were taken under one light: predict it from them together."),
]
_EveryArg = Annotated[
    int | None, option(metavar="N", help=f"Predict from every Nth frame of a video; by default {EVERY}.")
]
_OPTIONS = LightOptions()


def predict(
    run: RunArg,
    images: _PhotosArg,
    *,
    camera: FoundCameraArg = None,
    output: _MapArg = None,
    mask: MaskArg = None,
    confidence: _ConfidenceArg = None,
    save_camera: _SaveCameraArg = None,
    save_mask: _SaveMaskArg = None,
    save_overlay: _SaveOverlayArg = None,
    one_light: _OneLightArg = False,
    every: _EveryArg = None,
    options: Annotated[LightOptions, arg(name="")] = _OPTIONS,
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
    location = _location(save_camera, save_mask, save_overlay)
    if camera is not None and location:
        raise ConfigError(
            "--save-camera, --save-mask and --save-overlay write what is found, and --camera gives that; leave it out."
        )
    video = next((image for image in images if is_video(image)), None)
    if video is not None and len(images) > 1:
        raise ConfigError(f"{video} is a video; predict from it alone, or from photos.")
    if video is None and every is not None:
        raise ConfigError("--every is about a video's frames; leave it out.")
    chosen, step = ChosenFiles(output, confidence, location), EVERY if every is None else every
    requests = [PredictRequest(photo=image, camera=camera, mask=mask, **vars(options)) for image in images]
    session = Session(run, device, settings)
    if video is None and not one_light:
        answers = predict_photos(session, requests, chosen)
        _tell_untrained(session, options)
        for answer in answers:
            _tell(answer)
            _tell_known(answer, chosen)
    elif one_light:
        joint = predict_together(session, requests, chosen, every=step)
        _tell_untrained(session, options)
        _tell_joint(joint)
    else:
        found = predict_video(session, requests[0], chosen, every=step, on_answer=_tell)
        before, after = found.flicker
        say(
            f"{len(found.answers)} maps in {found.answers[0].files.light.parent}; from one to the next ln radiance "
            f"changes by\n{after:.3f} root mean square, {before:.3f} before they were steadied.",
            flicker={"before": before, "after": after},
        )
        if found.failures is not None:
            raise InputError(found.failures)


def _location(camera: Path | None, mask: Path | None, overlay: Path | None) -> dict[Output, Path]:
    chosen = {Output.CAMERA: camera, Output.MASK: mask, Output.OVERLAY: overlay}
    return {output: path for output, path in chosen.items() if path is not None}


def _tell_known(answer: Answer, chosen: ChosenFiles) -> None:
    """Warn where files of what is found are named for a photo in which nothing had to be looked for."""
    if answer.location is None and chosen.location:
        warnings.warn(
            f"{answer.request.photo} is a photo of the run's scene, whose camera is known: nothing was looked for, and "
            "--save-camera, --save-mask and --save-overlay write no file.",
            LightprobeWarning,
            stacklevel=2,
        )


def _tell_untrained(session: Session, options: LightOptions) -> None:
    run = session.run.path
    if session.predictor.model is None and options.method is None:
        command = f"lightprobe distill {shell_word(run)}"
        say(f"No trained model in {run}, so the light is only solved for; train one with: {command}")


def _tell(answer: Answer) -> None:
    """Print where a map is, what it cost and what its photo's verdict is; doubts go to standard error."""
    if answer.location is not None:
        _tell_location(answer.location)
    _tell_map(answer, "photo", str(answer.request.photo))


def _tell_joint(joint: JointAnswer) -> None:
    """Print the same of a map of several photos, their exposures, and which of them did not serve.

    Raises `InputError` when some did not.
    """
    for location in joint.locations:
        _tell_location(location)
    _tell_map(joint.answer, "photos", "the photos together")
    source = "from EXIF" if joint.measured else "found with the light, as not every photo's EXIF tells it"
    factors = ", ".join(f"{image.name} {value:.2f}" for image, value in joint.exposures.items())
    say(
        f"Exposures relative to the first, {source}: {factors}",
        exposures={str(image): value for image, value in joint.exposures.items()},
        left_out={str(image): reason for image, reason in joint.left_out.items()},
    )
    if joint.left_out:
        raise InputError(
            " ".join(f"{image} is not in the map. {reason}" for image, reason in joint.left_out.items())
        )


def _tell_map(answer: Answer, of: str, source: str) -> None:
    prediction, output = answer.prediction, answer.files.light
    verdict, background = prediction.verdict, prediction.background
    parts = ", ".join(f"{name} {value:.2f} s" for name, value in prediction.seconds.items())
    around = "" if background is BackgroundUse.ABSENT else f"; background {background.value}"
    line = f"Environment: {output} ({answer.method.value}; {parts}; {of} {verdict.status.value}{around})"
    say_one("predictions", line, {"source": source, "environment": output, **answer.to_json()})
    for sentence in verdict.sentences:
        print(f"lightprobe: warning: {source}: {sentence}", file=sys.stderr)


def locate(
    run: RunArg,
    images: _PhotosArg,
    *,
    output: Annotated[
        Path | None, option(aliases=["-o"], metavar="FOLDER", help="Folder for the files.")
    ] = None,
    mask: MaskArg = None,
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
    location = _location(save_camera, save_mask, save_overlay)
    for photo in locate_photos(run, images, output, location=location, mask=mask, device=device):
        _tell_location(photo)


def _tell_location(photo: LocatedPhoto) -> None:
    """Print where a camera is and what its verdict is; doubts go to standard error."""
    verdict, focal = photo.located.verdict, photo.located.camera.fx
    found = f"focal length {focal:.0f} px; {photo.located.seconds:.2f} s; pose {verdict.status.value}"
    say_one("cameras", f"Camera: {photo.files[Output.CAMERA]} ({found})", photo.to_json())
    for sentence in photo.warnings:
        print(f"lightprobe: warning: {photo.image}: {sentence}", file=sys.stderr)
