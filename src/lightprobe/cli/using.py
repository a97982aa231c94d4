"""predict, locate, render, relight, export: the commands that use what was learnt."""

import sys
from pathlib import Path
from typing import Annotated

from tyro.conf import Positional

from lightprobe.cli.options import CameraArg, Device, EnvironmentArg, Prediction, RunArg, option
from lightprobe.cli.progress import Meter
from lightprobe.core.config.prediction import UNCHANGED, Method
from lightprobe.runs.locations import LocatedPhoto, LocationFiles, locate_photos
from lightprobe.runs.outputs import export_run, relight_run, render_run
from lightprobe.runs.predictions import PredictedPhoto, PredictionFiles, predict_photos

_PhotosArg = Annotated[
    Positional[tuple[Path, ...]], option(metavar="IMAGE...", help="Photos of the object (at least one).")
]
_NewCameraArg = Annotated[
    Path | None,
    option(metavar="C.json", help="Camera of the photo, or many of which its name chooses; else it is found."),
]
_MapArg = Annotated[
    Path | None,
    option(aliases=["-o"], metavar="ENV", help="The map's name, .exr or .hdr; of several photos a folder."),
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
        metavar="METHOD", help=f"One of {', '.join(Method)}; by default the run's own, or the best it has a model for."
    ),
]
_ConfidenceArg = Annotated[
    Path | None, option(metavar="C.exr", help="Also write the confidence here; of several photos a folder.")
]


def predict(
    run: RunArg, images: _PhotosArg, *, camera: _NewCameraArg = None, output: _MapArg = None, mask: _MaskArg = None,
    method: _MethodArg = None, confidence: _ConfidenceArg = None, save_camera: _SaveCameraArg = None,
    save_mask: _SaveMaskArg = None, save_overlay: _SaveOverlayArg = None, settings: Prediction = UNCHANGED,
    device: Device = "auto",
) -> None:  # fmt: skip
    """Predict the environment around the object from one photo, or from several one by one.

    Without -o the map, a picture of it and the confidence of each direction go to RUN/predictions. Without --camera the
    object is found in the photo first, as by `lightprobe locate`; photos of the run's own scene have their cameras in
    the run. A photo that no light explains gets a warning and a lower confidence, or no map at all.

    Examples:
      lightprobe predict runs/cup new.jpg
      lightprobe predict runs/cup new.jpg --camera new.json --mask new_mask.png -o light.exr
      lightprobe predict runs/cup test/r_003.png --camera transforms_test.json
      lightprobe predict runs/cup new.jpg --camera new.json --light-resolution 128 --method probe-mlp -o light.exr
      lightprobe predict runs/cup shots/*.png --camera shots/transforms.json --mask shots/masks -o lights
    """
    location = LocationFiles(save_camera, save_mask, save_overlay)
    files = PredictionFiles(camera, mask, output, confidence, location)
    predictions = predict_photos(run, images, files, method=method, settings=settings, device=device)
    if not predictions.trained and method is None:
        print(f"No trained model in {run}, so the light is only solved for; train one with: lightprobe distill {run}")
    for predicted in predictions:
        _tell(predicted)


def _tell(predicted: PredictedPhoto) -> None:
    """Print where a map is, what it cost and what its photo's verdict is; doubts go to standard error."""
    if predicted.location is not None:
        _tell_location(predicted.location)
    verdict, seconds = predicted.prediction.verdict, predicted.prediction.seconds
    parts = ", ".join(f"{name} {value:.2f} s" for name, value in seconds.items())
    print(f"Environment: {predicted.output} ({predicted.method.value}; {parts}; photo {verdict.status.value})")
    for sentence in verdict.sentences:
        print(f"lightprobe: warning: {predicted.image}: {sentence}", file=sys.stderr)


def locate(
    run: RunArg, images: _PhotosArg, *,
    output: Annotated[Path | None, option(aliases=["-o"], metavar="FOLDER", help="Folder for the files.")] = None,
    mask: _MaskArg = None, save_camera: _SaveCameraArg = None, save_mask: _SaveMaskArg = None,
    save_overlay: _SaveOverlayArg = None, device: Device = "auto",
) -> None:  # fmt: skip
    """Find the object in new photos: from where each was taken, with which focal length, and the object's mask.

    NAME.camera.json, NAME.mask.png and NAME.overlay.png, the photo with the object's outline, go to FOLDER, without -o
    to RUN/predictions. A photo without the object is refused; where the pose is doubtful, a warning says so.

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
    print(f"Camera: {photo.files.camera} ({found})")
    for sentence in photo.warnings():
        print(f"lightprobe: warning: {photo.image}: {sentence}", file=sys.stderr)


def render(
    run: RunArg,
    *,
    camera: CameraArg,
    env: EnvironmentArg,
    output: Annotated[Path, option(aliases=["-o"], metavar="OUT", help="Picture: .png (sRGB) or .exr (linear).")],
    frame: Annotated[
        str | None, option(metavar="NAME", help="Photo whose camera is meant, of a file with many.")
    ] = None,
    device: Device = "auto",
) -> None:
    """Render the object under an environment.

    Examples:
      lightprobe render runs/cup --camera view.json --env studio.exr -o cup.png
      lightprobe render runs/cup --camera transforms_test.json --frame r_003 --env studio.exr -o cup.png
    """
    render_run(run, env, camera, output, frame=frame, device=device)
    print(f"Picture: {output}")


def relight(
    run: RunArg,
    *,
    env: EnvironmentArg,
    output: Annotated[Path, option(aliases=["-o"], metavar="DIR", help="Folder for the pictures.")],
    frames: Annotated[int, option(help="Pictures of the turntable.")] = 24,
    side: Annotated[int, option(help="Their size in pixels.")] = 512,
    device: Device = "auto",
) -> None:
    """Render a turntable and the test views under a new environment.

    Examples:
      lightprobe relight runs/cup --env studio.exr -o relit
    """
    with Meter() as meter:
        relight_run(run, env, output, frames=frames, side=side, device=device, on_progress=meter.update)
    print(f"Pictures: {output}")


def export(
    run: RunArg,
    *,
    output: Annotated[Path, option(aliases=["-o"], metavar="DIR", help="Folder for the files.")],
    device: Device = "auto",
) -> None:
    """Write mesh.glb, its textures and the training photos' lights as EXR and HDR, for Blender, three.js and others.

    The light of another photo is what `lightprobe predict` writes, as .exr or .hdr.

    Examples:
      lightprobe export runs/cup -o cup_files
    """
    written = export_run(run, output, device=device)
    print(f"{len(written)} files in {output}; mesh: {written[0]}")
