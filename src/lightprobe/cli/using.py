"""predict, render, relight, export: the commands that use what was learnt."""

import os
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
import torch
from tyro.conf import Positional

from lightprobe.cli import options
from lightprobe.cli.options import CameraArg, Device, EnvironmentArg, RunArg, option
from lightprobe.cli.progress import Meter
from lightprobe.core.device import resolve_device
from lightprobe.core.errors import ConfigError, InputError
from lightprobe.core.files import filled_folder, named_file
from lightprobe.core.run import RunFolder
from lightprobe.evaluation import load_environment, turntable, write_prediction
from lightprobe.evaluation import relight as relight_image
from lightprobe.export import export as export_files
from lightprobe.imaging import write_exr, write_png
from lightprobe.models import Decomposition
from lightprobe.prediction import Method, Prediction, Predictor, check_names, methods_for, recorded_config
from lightprobe.scene import load_pixels, new_photo, read_camera
from lightprobe.scene.frame import cut_name
from lightprobe.scene.record import read_record

MethodArg = Annotated[
    Method | None,
    option(
        metavar="METHOD", help=f"One of {', '.join(Method)}; by default the run's own, or the best it has a model for."
    ),
]

_STEM_BYTES = 255 - len(".confidence.exr")  # of a photo's name that the names of its maps can hold
_LARGEST_SIDE = 8192  # pixels of a picture's edge


def predict(
    run: RunArg,
    images: Annotated[
        Positional[tuple[Path, ...]], option(metavar="IMAGE...", help="Photos of the object (at least one).")
    ],
    *,
    camera: Annotated[
        Path | None,
        option(metavar="C.json", help="Camera of the photo, or many of which its name chooses; else the run's own."),
    ] = None,
    output: Annotated[
        Path | None,
        option(aliases=["-o"], metavar="ENV", help="The map's name, .exr or .hdr; of several photos a folder."),
    ] = None,
    mask: Annotated[
        Path | None,
        option(
            metavar="M",
            help="White object on black, or a folder with a .png like it for each photo; else the photo's alpha.",
        ),
    ] = None,
    method: MethodArg = None,
    confidence: Annotated[
        Path | None, option(metavar="C.exr", help="Also write the confidence here; of several photos a folder.")
    ] = None,
    settings: options.Prediction = options.UNCHANGED,
    device: Device = "auto",
) -> None:
    """Predict the environment around the object from one photo, or from several one by one.

    Without -o the map, a picture of it and the confidence of each direction go to RUN/predictions. Photos of the run's
    own scene need no --camera. A photo that no light explains gets a warning and a lower confidence, or no map at all.

    Examples:
      lightprobe predict runs/cup new.jpg --camera new.json --mask new_mask.png -o light.exr
      lightprobe predict runs/cup test/r_003.png --camera transforms_test.json
      lightprobe predict runs/cup new.jpg --camera new.json --light-resolution 128 --method probe-mlp -o light.exr
      lightprobe predict runs/cup shots/*.png --camera shots/transforms.json --mask shots/masks -o lights
    """
    folder = RunFolder.open(run)
    if not images:
        raise ConfigError("No photo is named: lightprobe predict RUN IMAGE.")
    if camera is None:
        read_record(folder)  # it has the cameras
    jobs = [_Job.of(folder, image, len(images) > 1, mask, method, output, confidence) for image in images]
    if len({job.output for job in jobs}) < len(jobs):
        raise ConfigError("Two of the photos have the same name, and so would their maps; predict them one by one.")
    photos = [new_photo(job.image, camera or folder.scene_file, job.mask) for job in jobs]
    predictor = Predictor.load(run, resolve_device(device), settings.over(recorded_config(folder)))
    chosen = method or methods_for(predictor.model, predictor.config)[0]
    if predictor.model is None and method is None:
        print(f"No trained model in {run}, so the light is only solved for; train one with: lightprobe distill {run}")
    failures: list[str] = []
    for job, photo in zip(jobs, photos, strict=True):
        try:
            prediction = predictor.predict(*load_pixels(photo), chosen)
        except InputError as error:  # one photo that cannot serve must not cost the maps of the others
            failures.append(f"{job.image} gets no map. {error}")
            continue
        job.write(prediction)
        _tell(prediction, job, chosen)
    if failures:
        raise InputError("\n".join(failures))


def _tell(prediction: Prediction, job: "_Job", method: Method) -> None:
    """Print where a map is, what it cost and what its photo's verdict is; doubts go to standard error."""
    verdict = prediction.verdict
    parts = ", ".join(f"{name} {seconds:.2f} s" for name, seconds in prediction.seconds.items())
    print(f"Environment: {job.output} ({method.value}; {parts}; photo {verdict.status.value})")
    for sentence in verdict.sentences:
        print(f"lightprobe: warning: {job.image}: {sentence}", file=sys.stderr)


@dataclass(frozen=True)
class _Job:
    """One photo of a call, and where its results go."""

    image: Path
    mask: Path | None
    output: Path
    confidence: Path | None
    kept: bool  # in the run, with a picture and the confidence beside it

    @staticmethod
    def of(
        run: RunFolder, image: Path, several: bool, mask: Path | None, method: Method | None, output: Path | None,
        confidence: Path | None,
    ) -> "_Job":  # fmt: skip
        """Refuse what could not be written, before any work."""
        if mask is not None and mask.is_dir():
            mask = mask / f"{image.stem}.png"
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
        return _Job(image, mask, output or stored, confidence, kept)

    def write(self, prediction: Prediction) -> None:
        if self.kept:
            write_prediction(prediction, self.output)
            if self.confidence is not None:
                prediction.save_confidence(self.confidence)
        else:
            prediction.save(self.output, self.confidence)


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
    if output.suffix.lower() not in (".png", ".exr"):
        raise ConfigError(f"Cannot write '{output.suffix}' pictures: name the output .png or .exr.")
    where, folder = resolve_device(device), RunFolder.open(run)
    view = read_camera(camera, None if frame is None else Path(frame))
    image, cover = relight_image(Decomposition.load(folder, where), load_environment(env, where), view)
    write_picture(output, image, cover)
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
    if frames < 1 or not 8 <= side <= _LARGEST_SIDE:
        raise ConfigError(f"A turntable needs --frames of at least 1 and --side from 8 to {_LARGEST_SIDE}.")
    where, folder = resolve_device(device), RunFolder.open(run)
    _refuse_mixing(output)
    decomposition, light = Decomposition.load(folder, where), load_environment(env, where)
    cameras = read_record(folder).cameras
    circle = turntable(list(cameras["train"].values()), decomposition.similarity.center, frames, side)
    views = {Path("turntable") / f"{i:03d}.png": camera for i, camera in enumerate(circle)}
    views |= {named_file(Path("test"), name, ".png"): camera for name, camera in cameras["test"].items()}
    with filled_folder(output) as pictures, Meter() as meter:
        for done, (name, camera) in enumerate(views.items()):
            write_picture(pictures / name, *relight_image(decomposition, light, camera))
            meter.update("relight", done + 1, len(views))
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
    folder = RunFolder.open(run)
    _refuse_mixing(output)
    decomposition = Decomposition.load(folder, resolve_device(device))
    with filled_folder(output) as files:
        written = export_files(decomposition, files, decomposition.lights)
    print(f"{len(written)} files in {output}; mesh: {output / written[0].name}")


def _refuse_mixing(folder: Path) -> None:
    """Refuse a folder that holds files: among those of an earlier call the new ones could not be told apart."""
    if folder.is_dir() and any(not name.startswith(".") for name in os.listdir(folder)):
        raise ConfigError(f"{folder} is not empty; give a new folder with -o, so that no older file stays among these.")


def write_picture(path: Path, image: torch.Tensor, cover: torch.Tensor) -> None:
    """Write a premultiplied linear image (H, W, 3) with coverage (H, W): straight sRGB PNG, or premultiplied EXR."""
    color, alpha = image.cpu().numpy(), cover.cpu().numpy()
    if path.suffix.lower() == ".exr":
        write_exr(path, np.concatenate([color, alpha[..., None]], axis=2))
    else:
        write_png(path, color / np.maximum(alpha, 1e-6)[..., None], alpha)
