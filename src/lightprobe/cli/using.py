"""predict, render, relight, export: the commands that use what was learnt."""

from pathlib import Path
from typing import Annotated

import numpy as np
import torch
from tyro.conf import Positional, arg

from lightprobe.cli.cameras import read_camera
from lightprobe.cli.options import CameraArg, Device, EnvironmentArg, RunArg
from lightprobe.cli.progress import Meter
from lightprobe.cli.stages import model_exists
from lightprobe.core.device import resolve_device
from lightprobe.core.errors import ConfigError
from lightprobe.core.run import RunFolder
from lightprobe.decompose import Decomposition
from lightprobe.distill import ProbeModel
from lightprobe.evaluate import (
    load_environment,
    panorama,
    turntable,
    write_confidence,
    write_map,
    write_prediction,
)
from lightprobe.evaluate import relight as relight_image
from lightprobe.export import export as export_files
from lightprobe.imaging import image_size, write_exr, write_png
from lightprobe.predict import Method, Predictor, methods_for
from lightprobe.scene import load_pixels
from lightprobe.scene.photo import Photo
from lightprobe.scene.pixels import fit_camera
from lightprobe.scene.record import recorded_cameras

MethodArg = Annotated[Method | None, arg(help="How to predict; by default the best this run is trained for.")]


def load_model(run: RunFolder, device: torch.device) -> ProbeModel | None:
    """Return the Phase II model of a run, or None before `distill`."""
    return ProbeModel.load(run.model_folder).to(device) if model_exists(run) else None


def predict(
    run: RunArg,
    image: Annotated[Positional[Path], arg(metavar="IMAGE", help="Photo of the object.")],
    *,
    camera: CameraArg,
    output: Annotated[Path | None, arg(aliases=["-o"], metavar="ENV.exr", help="Also write the map here.")] = None,
    mask: Annotated[Path | None, arg(metavar="M", help="White object on black; else the photo's alpha.")] = None,
    method: MethodArg = None,
    confidence: Annotated[Path | None, arg(metavar="C.exr", help="Also write the confidence here.")] = None,
    device: Device = "auto",
) -> None:
    """Predict the environment around the object from one photo.

    The map, a picture of it and the confidence of each direction go to RUN/predictions.

    Examples:
      lightprobe predict runs/cup new.jpg --camera new.json --mask new_mask.png -o light.exr
      lightprobe predict runs/cup test/r_003.png --camera transforms_test.json
    """
    where, folder = resolve_device(device), RunFolder.open(run)
    view = fit_camera(read_camera(camera, image, image_size(image)), image, str(camera))
    pixels, view = load_pixels(Photo(image.stem, view, image, mask))
    decomposition, model = Decomposition.load(folder, where), load_model(folder, where)
    predictor = Predictor.of(decomposition, model, where)
    prediction = predictor.predict(pixels, view, method or methods_for(model)[0])
    stored = folder.prediction_file(image.stem, ".exr", method.value if method else None)
    write_prediction(prediction, stored)
    if output is not None:
        write_map(output, panorama(prediction.environment))
    if confidence is not None:
        write_confidence(prediction, confidence)
    parts = ", ".join(f"{name} {seconds:.2f} s" for name, seconds in prediction.seconds.items())
    print(f"Environment: {output or stored} ({parts})")


def render(
    run: RunArg,
    *,
    camera: CameraArg,
    env: EnvironmentArg,
    output: Annotated[Path, arg(aliases=["-o"], metavar="OUT", help="Picture: .png (sRGB) or .exr (linear).")],
    device: Device = "auto",
) -> None:
    """Render the object under an environment.

    Examples:
      lightprobe render runs/cup --camera view.json --env studio.exr -o cup.png
    """
    if output.suffix.lower() not in (".png", ".exr"):
        raise ConfigError(f"Cannot write '{output.suffix}' pictures: name the output .png or .exr.")
    where, folder = resolve_device(device), RunFolder.open(run)
    view = read_camera(camera)
    image, cover = relight_image(Decomposition.load(folder, where), load_environment(env, where), view)
    write_picture(output, image, cover)
    print(f"Picture: {output}")


def relight(
    run: RunArg,
    *,
    env: EnvironmentArg,
    output: Annotated[Path, arg(aliases=["-o"], metavar="DIR", help="Folder for the pictures.")],
    frames: Annotated[int, arg(help="Pictures of the turntable.")] = 24,
    side: Annotated[int, arg(help="Their size in pixels.")] = 512,
    device: Device = "auto",
) -> None:
    """Render a turntable and the test views under a new environment.

    Examples:
      lightprobe relight runs/cup --env studio.exr -o relit
    """
    if frames < 1 or side < 8:
        raise ConfigError("A turntable needs --frames of at least 1 and --side of at least 8.")
    where, folder = resolve_device(device), RunFolder.open(run)
    decomposition, light = Decomposition.load(folder, where), load_environment(env, where)
    record = folder.scene()
    photos = list(recorded_cameras(record, "train").values())
    circle = turntable(photos, decomposition.similarity.center, frames, side)
    views = {f"turntable/{i:03d}": camera for i, camera in enumerate(circle)}
    views |= {f"test/{name}": camera for name, camera in recorded_cameras(record, "test").items()}
    with Meter() as meter:
        for done, (name, camera) in enumerate(views.items()):
            write_picture(output / f"{name}.png", *relight_image(decomposition, light, camera))
            meter.update("relight", done + 1, len(views))
    print(f"Pictures: {output}")


def export(
    run: RunArg,
    *,
    output: Annotated[Path, arg(aliases=["-o"], metavar="DIR", help="Folder for the files.")],
    device: Device = "auto",
) -> None:
    """Write mesh.glb, its textures and every environment as EXR and HDR, for Blender, three.js and others.

    Examples:
      lightprobe export runs/cup -o cup_files
    """
    decomposition = Decomposition.load(RunFolder.open(run), resolve_device(device))
    written = export_files(decomposition, output, decomposition.lights)
    print(f"{len(written)} files in {output}; mesh: {written[0]}")


def write_picture(path: Path, image: torch.Tensor, cover: torch.Tensor) -> None:
    """Write a premultiplied linear image (H, W, 3) with coverage (H, W): straight sRGB PNG, or premultiplied EXR."""
    color, alpha = image.cpu().numpy(), cover.cpu().numpy()
    if path.suffix.lower() == ".exr":
        write_exr(path, np.concatenate([color, alpha[..., None]], axis=2))
    else:
        write_png(path, color / np.maximum(alpha, 1e-6)[..., None], alpha)
