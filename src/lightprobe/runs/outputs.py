"""What a run's object is shown in and handed on as: pictures under a light, and files for other programs."""

import warnings
from pathlib import Path

import numpy as np
import torch

from lightprobe.core.config.export import ExportOptions
from lightprobe.core.config.prediction import Sun
from lightprobe.core.config.rendering import FAST_PICTURES, RenderConfig
from lightprobe.core.device import resolve_device
from lightprobe.core.errors import ConfigError, LightprobeWarning
from lightprobe.core.files import filled_folder, holds_files, named_file, refuse_replacing
from lightprobe.core.run import RunFolder
from lightprobe.evaluation import Relighter, relight, turntable
from lightprobe.export import export, write_picture
from lightprobe.export.bundle import check_libraries, write_addon
from lightprobe.jobs.light_files import scene_light, tell_of_scale, whole_light
from lightprobe.models import Decomposition
from lightprobe.runs.progress import OnProgress, silent
from lightprobe.scene import read_camera
from lightprobe.scene.camera import Similarity
from lightprobe.scene.record import read_record

_USUAL = ExportOptions()
_LARGEST_SIDE = 8192  # pixels of a picture's edge
_PLACED = 1e-4  # of the object's radius: a place in 32 bits that is rounded by more is told of


def render_run(
    run_folder: Path | str,
    environment: Path,
    camera: Path,
    output: Path,
    *,
    frame: str | None = None,
    device: str | torch.device = "auto",
    config: RenderConfig = FAST_PICTURES,
) -> None:
    """Write a picture of a run's object under an equirectangular map: .png (sRGB) or .exr (linear).

    camera: a file with the camera, or with many, of which `frame` names the photo whose camera is meant.
    A map without its suns and lamps has them from its .light.json.
    Raises `InputError` for a run, map or camera that cannot be used, `ConfigError` for a name of another
    suffix and for a path tracer that is not installed.
    """
    if output.suffix.lower() not in (".png", ".exr"):
        raise ConfigError(f"Cannot write '{output.suffix}' pictures: name the output .png or .exr.")
    refuse_replacing([output], [environment, camera])
    where, run = resolve_device(device), RunFolder.open(Path(run_folder))
    view = read_camera(camera, None if frame is None else Path(frame))
    decomposition, light = Decomposition.load(run, where), whole_light(environment, where)
    tell_of_scale(environment, decomposition.calibration)
    image, cover = relight(decomposition, light, view, config)
    write_picture(output, image, cover)


def relight_run(
    run_folder: Path | str,
    environment: Path,
    output: Path,
    *,
    frames: int = 24,
    side: int = 512,
    device: str | torch.device = "auto",
    config: RenderConfig = FAST_PICTURES,
    on_progress: OnProgress = silent,
) -> None:
    """Write a turntable of `frames` pictures of `side` pixels, and the test views, under an equirectangular
    map.

    output: a new or empty folder, filled at once at the end. A map without its suns and lamps has them from
    its .light.json. Raises `InputError` for a run or map that cannot be used, `ConfigError` for sizes and
    folders that cannot and for a path tracer that is not installed.
    """
    if frames < 1 or not 8 <= side <= _LARGEST_SIDE:
        raise ConfigError(f"A turntable needs --frames of at least 1 and --side from 8 to {_LARGEST_SIDE}.")
    where, run = resolve_device(device), RunFolder.open(Path(run_folder))
    _refuse_mixing(output)
    decomposition, light = Decomposition.load(run, where), whole_light(environment, where)
    tell_of_scale(environment, decomposition.calibration)
    cameras = read_record(run).cameras
    circle = turntable(list(cameras["train"].values()), decomposition.similarity.center, frames, side)
    views = {Path("turntable") / f"{i:03d}.png": camera for i, camera in enumerate(circle)}
    views |= {named_file(Path("test"), name, ".png"): camera for name, camera in cameras["test"].items()}
    relighter = Relighter(decomposition, where, config)
    with filled_folder(output) as pictures:
        for done, (name, camera) in enumerate(views.items()):
            write_picture(pictures / name, *relighter.picture(light, camera))
            on_progress("relight", done + 1, len(views))


def export_run(
    run_folder: Path | str,
    output: Path,
    *,
    environment: Path | None = None,
    sun: Sun = Sun.SEPARATE,
    options: ExportOptions = _USUAL,
    device: str | torch.device = "auto",
) -> list[Path]:
    """Write mesh.glb, its textures and the training photos' lights into a new or empty folder; return the
    files.

    Blender's add-on that imports them, lightprobe_import.py, is among them.
    The first is the mesh. environment: a map to write, too, with scene.glb, the mesh and the map's suns and
    lamps (`jobs.light_files`), unless `sun` leaves them inside the map. Raises `InputError` for a run or map that
    cannot be used, `ConfigError` for a folder with files and for options about a file that is not written.
    """
    run = RunFolder.open(Path(run_folder))
    _refuse_mixing(output)
    options.check(environment is not None)
    check_libraries(options)
    light = None if environment is None else scene_light(environment, sun)
    decomposition = Decomposition.load(run, resolve_device(device))
    if environment is not None:
        tell_of_scale(environment, decomposition.calibration)
    with filled_folder(output) as files:
        written = export(decomposition, files, decomposition.lights, light=light, options=options)
        written.append(write_addon(files))
        _tell_of_place(decomposition.similarity)
        return [output / path.relative_to(files) for path in written]


def _tell_of_place(similarity: Similarity) -> None:
    """Warn of an object so far from the origin that programs of 32 bits put it beside its place."""
    farthest = float(np.abs(similarity.center).max())
    step = float(np.spacing(np.float32(farthest)))
    if step <= _PLACED * similarity.scale:
        return
    x, y, z = (f"{value:.10g}" for value in similarity.center)
    warnings.warn(
        f"The object's middle is at ({x}, {y}, {z}) in the cameras' coordinates, far from their origin. The mesh is "
        "written around its middle, and the node of mesh.glb and the prim of scene.usdc have the offset, exactly; a "
        f"program that keeps places in 32 bits, as Blender does, puts it up to {step / 2:.2g} units away from there.",
        LightprobeWarning,
        stacklevel=3,
    )


def _refuse_mixing(folder: Path) -> None:
    """Refuse a folder that holds files: among those of an earlier call the new ones could not be told apart."""
    if holds_files(folder):
        raise ConfigError(
            f"{folder} is not empty; give a new folder with -o, so that no older file stays among these."
        )
