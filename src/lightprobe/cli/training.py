"""demo, fit, distill, train: the commands that learn an object."""

import functools
import inspect
from collections.abc import Callable
from importlib import resources
from pathlib import Path
from typing import Annotated

from lightprobe.cli.evaluation import evaluate_run, print_tables
from lightprobe.cli.failures import writing
from lightprobe.cli.options import Device, Hdri, Restart, RunArg, RunOut, SceneArg, Seed, option
from lightprobe.cli.progress import Meter
from lightprobe.cli.stages import UserMaps, open_scene, restart_decompose, restart_distill, run_decompose, run_distill
from lightprobe.core import config, config_distill
from lightprobe.core.config import DecomposeConfig, DistillConfig, Preset, distill_preset, predict_preset
from lightprobe.core.config_predict import Method, PredictConfig
from lightprobe.core.device import resolve_device
from lightprobe.core.run import RunFolder
from lightprobe.models import Decomposition
from lightprobe.scene import load_scene

PresetArg = Annotated[
    Preset, option(help="quick: two CPU cores, minutes; standard: a GPU; paper: the paper's settings.")
]
MovedScene = Annotated[Path | None, option(metavar="FOLDER", help="Where the scene is now, if it has moved.")]

# `with_preset` puts the chosen preset's in their place
_FIRST, _SECOND, _THIRD = DecomposeConfig(), DistillConfig(), PredictConfig()
# What the demo compares: all methods would take more than a quarter of the time that its training does.
_SHOWN = (Method.PROBE_NET_OPTIMIZE, Method.PROBE_NET, Method.PROBE_MLP, Method.CONSTANT)


def fit(
    scene: SceneArg, *, output: RunOut, preset: PresetArg = Preset.QUICK, device: Device = "auto", seed: Seed = 0,
    restart: Restart = False, decompose: DecomposeConfig = _FIRST,
) -> None:  # fmt: skip
    """Phase I: reconstruct mesh, materials and one environment per photo.

    The same command goes on where an interrupted one stopped.

    Examples:
      lightprobe fit photos/cup -o runs/cup
      lightprobe fit photos/cup -o runs/cup --preset standard --device cuda
      lightprobe fit photos/cup -o runs/fine --decompose.pass1-iterations 3000
    """
    _train(scene, output, device, seed, restart, decompose, None)


def train(
    scene: SceneArg, *, output: RunOut, preset: PresetArg = Preset.QUICK, device: Device = "auto", seed: Seed = 0,
    restart: Restart = False, hdri: Hdri = None, decompose: DecomposeConfig = _FIRST,
    distill: DistillConfig = _SECOND, predict: PredictConfig = _THIRD,
) -> None:  # fmt: skip
    """Both phases: reconstruct the object, then train the predictor of its light.

    The same command goes on where an interrupted one stopped.

    Examples:
      lightprobe train photos/cup -o runs/cup
      lightprobe train photos/cup -o runs/cup --hdri ~/hdris
      lightprobe train photos/cup -o runs/cup --preset paper --device cuda
    """
    _train(scene, output, device, seed, restart, decompose, distill, hdri, predict=predict)


def distill(
    run: RunArg, *, preset: PresetArg = Preset.QUICK, device: Device = "auto", seed: Seed = 0,
    restart: Restart = False, scene: MovedScene = None, hdri: Hdri = None, distill: DistillConfig = _SECOND,
    predict: PredictConfig = _THIRD,
) -> None:  # fmt: skip
    """Phase II: train the predictor of light of a reconstructed object.

    Examples:
      lightprobe distill runs/cup
      lightprobe distill runs/cup --restart --hdri ~/hdris
      lightprobe distill runs/cup --restart --distill.lessons teacher
    """
    where, folder, user_maps = resolve_device(device), RunFolder.open(run), UserMaps.read(hdri, distill)
    with writing(folder), Meter() as meter:
        if restart:
            restart_distill(folder)
        decomposition = Decomposition.load(folder, where)
        run_distill(
            folder, decomposition, lambda: open_scene(folder, scene), distill, where, seed, meter, user_maps, predict
        )  # fmt: skip
    print(f"Model: {folder.model_folder}\nNext: lightprobe eval {run}")


def demo(*, output: RunOut = Path("runs/demo"), device: Device = "auto", seed: Seed = 0) -> None:
    """Learn the bundled object, predict the light of its test photos and write a report, in minutes on two cores.

    Examples:
      lightprobe demo
      lightprobe demo -o /tmp/demo
    """
    with resources.as_file(resources.files("lightprobe") / "assets" / "demo") as scene:
        _train(scene, output, device, seed, False, config.demo(), config_distill.demo(), next_step=False)
        print_tables(evaluate_run(RunFolder.open(output), resolve_device(device), methods=_SHOWN, scene_folder=scene))
    print(f"More methods: lightprobe eval {output}")


def _train(
    scene_folder: Path, output: Path, device: str, seed: int, restart: bool, first: DecomposeConfig,
    second: DistillConfig | None, hdri: Path | None = None, *, predict: PredictConfig = _THIRD,
    next_step: bool = True,
) -> None:  # fmt: skip
    where, user_maps, scene = resolve_device(device), UserMaps.read(hdri, second), load_scene(scene_folder)
    run = RunFolder.create(output)
    with writing(run), Meter() as meter:
        if restart:
            restart_decompose(run)
        decomposition = run_decompose(run, scene, first, where, seed, meter)
        if second is not None:
            run_distill(run, decomposition, lambda: scene, second, where, seed, meter, user_maps, predict)
    print(f"Mesh: {run.mesh_folder / 'object.glb'}\nEnvironments: {run.environment_folder}")
    if next_step:
        print(f"Next: lightprobe {'distill' if second is None else 'eval'} {output}")


def with_preset(command: Callable[..., None], name: str) -> Callable[..., None]:
    """Return the command with a preset's configuration as defaults, which its --help then shows.

    A name that is no preset is left to the argument parser to refuse.
    """
    preset = Preset(name) if name in list(Preset) else Preset.QUICK
    values = {
        "preset": preset, "decompose": DecomposeConfig.preset(preset), "distill": distill_preset(preset),
        "predict": predict_preset(preset),
    }  # fmt: skip
    known = inspect.signature(command).parameters
    return functools.partial(command, **{name: value for name, value in values.items() if name in known})
