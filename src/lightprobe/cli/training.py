"""demo, fit, distill, train: the commands that learn an object."""

import functools
import inspect
from collections.abc import Callable
from importlib import resources
from pathlib import Path
from typing import Annotated

from lightprobe.cli.answer import say
from lightprobe.cli.evaluation import show_evaluation
from lightprobe.cli.options import Device, Hdri, MovedScene, Restart, RunArg, RunOut, SceneArg, Seed, option
from lightprobe.cli.progress import Meter
from lightprobe.core.config import DecomposeConfig, DistillConfig, Preset, demo_settings, settings
from lightprobe.core.config.prediction import Method, PredictConfig
from lightprobe.core.errors import ConfigError
from lightprobe.core.files import shell_word
from lightprobe.core.run import RunFolder
from lightprobe.models import LightAccuracy, ObjectVerdict
from lightprobe.report.run_info import fitted_preset
from lightprobe.runs.evaluation import EvaluationOptions, evaluate_run
from lightprobe.runs.training import distill_run, fit_run, train_run

PresetArg = Annotated[
    Preset,
    option(
        help="quick: two CPU cores, minutes; standard: a GPU; paper: the paper's settings; paper-small: the same at "
        "smaller sizes, for two CPU cores."
    ),
]

_SamePresetArg = Annotated[
    Preset | None,
    option(
        metavar="quick|standard|paper|paper-small",
        help="Phase I's; it has to be given again unless it was quick.",
    ),
]

# `with_preset` puts the chosen preset's in their place
_FIRST, _SECOND, _THIRD = DecomposeConfig(), DistillConfig(), PredictConfig()
# What the demo compares: all methods would take more than a quarter of the time that its training does.
_SHOWN = (Method.PROBE_NET_OPTIMIZE, Method.PROBE_NET, Method.PROBE_MLP, Method.CONSTANT)


def fit(
    scene: SceneArg,
    *,
    output: RunOut,
    preset: PresetArg = Preset.QUICK,
    device: Device = "auto",
    seed: Seed = 0,
    restart: Restart = False,
    decompose: DecomposeConfig = _FIRST,
) -> None:
    """Phase I: reconstruct mesh, materials and one environment per photo.

    The same command goes on where an interrupted one stopped.

    Examples:
      lightprobe fit photos/cup -o runs/cup
      lightprobe fit photos/cup -o runs/cup --preset standard --device cuda
      lightprobe fit photos/cup -o runs/fine --decompose.pass1-iterations 3000
    """
    with Meter() as meter:
        run = fit_run(
            scene,
            output,
            decompose=decompose,
            device=device,
            seed=seed,
            restart=restart,
            on_progress=meter.update,
        )
    preset = fitted_preset(run)
    chosen = "" if preset is Preset.QUICK else f" --preset {preset.value}"
    _tell(run, f"lightprobe distill {shell_word(output)}{chosen}")


def train(
    scene: SceneArg,
    *,
    output: RunOut,
    preset: PresetArg = Preset.QUICK,
    device: Device = "auto",
    seed: Seed = 0,
    restart: Restart = False,
    hdri: Hdri = None,
    decompose: DecomposeConfig = _FIRST,
    distill: DistillConfig = _SECOND,
    predict: PredictConfig = _THIRD,
) -> None:
    """Both phases: reconstruct the object, then train the predictor of its light.

    The same command goes on where an interrupted one stopped.

    Examples:
      lightprobe train photos/cup -o runs/cup
      lightprobe train photos/cup -o runs/cup --hdri ~/hdris
      lightprobe train photos/cup -o runs/cup --preset paper --device cuda
    """
    with Meter() as meter:
        run = train_run(
            scene,
            output,
            decompose=decompose,
            distill=distill,
            predict=predict,
            device=device,
            seed=seed,
            hdri=hdri,
            restart=restart,
            on_progress=meter.update,
        )
    _tell(run, f"lightprobe eval {shell_word(output)}")


def distill(
    run: RunArg,
    *,
    preset: _SamePresetArg = None,
    device: Device = "auto",
    seed: Seed = 0,
    restart: Restart = False,
    scene: MovedScene = None,
    hdri: Hdri = None,
    distill: DistillConfig = _SECOND,
    predict: PredictConfig = _THIRD,
) -> None:
    """Phase II: train the predictor of light of a reconstructed object.

    Examples:
      lightprobe distill runs/cup
      lightprobe distill runs/cup --restart --hdri ~/hdris
      lightprobe distill runs/cup --restart --distill.lessons teacher
    """
    _require_preset(run, preset)
    with Meter() as meter:
        folder = distill_run(
            run,
            distill=distill,
            predict=predict,
            device=device,
            seed=seed,
            scene_folder=scene,
            hdri=hdri,
            restart=restart,
            on_progress=meter.update,
        )
    next_one = f"lightprobe eval {shell_word(run)}"
    say(f"Model: {folder.model_folder}", run=folder.path, model=folder.model_folder)
    _tell_accuracy(folder)
    say(f"Next: {next_one}")


def demo(*, output: RunOut = Path("runs/demo"), device: Device = "auto", seed: Seed = 0) -> None:
    """Learn the bundled object, predict the light of its test photos and write a report, in minutes on two
    cores.

    Examples:
      lightprobe demo
      lightprobe demo -o /tmp/demo
    """
    with resources.as_file(resources.files("lightprobe") / "assets" / "demo") as scene:
        with Meter() as meter:
            run = train_run(
                scene,
                output,
                **vars(demo_settings()),
                device=device,
                seed=seed,
                on_progress=meter.update,
            )
        _tell(run)
        with Meter() as meter:
            shown = EvaluationOptions(methods=_SHOWN)
            found = evaluate_run(output, shown, scene_folder=scene, device=device, on_progress=meter.update)
        show_evaluation(found)
    say(f"More methods: lightprobe eval {shell_word(output)}")


def _require_preset(run: Path, given: Preset | None) -> None:
    """Raise `ConfigError` where Phase I had another preset than the one that Phase II would silently get."""
    fitted = fitted_preset(RunFolder.open(run))
    if given is None and fitted is not Preset.QUICK:
        raise ConfigError(
            f"Phase I of {run} was run with --preset {fitted.value}: give it here, too, or --preset quick for Phase II "
            "alone."
        )


def _tell(run: RunFolder, following: str | None = None) -> None:
    """Print where a training's results are, and the command that follows."""
    mesh, environments = run.mesh_folder / "object.glb", run.environment_folder
    say(f"Mesh: {mesh}\nEnvironments: {environments}", run=run.path, mesh=mesh, environments=environments)
    verdict = ObjectVerdict.load(run.verdict_file)
    if verdict is not None:
        say(verdict.sentence, object=verdict.to_json())
    _tell_accuracy(run)
    if following is not None:
        say(f"Next: {following}")


def _tell_accuracy(run: RunFolder) -> None:
    """Print how well the run's object tells of its light, if that is known."""
    accuracy = LightAccuracy.load(run.model_folder)
    if accuracy is not None:
        say(accuracy.sentence, light_accuracy=accuracy.to_json())


def with_preset(command: Callable[..., None], name: str) -> Callable[..., None]:
    """Return the command with a preset's configuration as defaults, which its --help then shows.

    A name that is no preset is left to the argument parser to refuse. Where the command has to be told, the
    preset itself has no default.
    """
    preset = Preset(name) if name in list(Preset) else Preset.QUICK
    values = {"preset": preset, **vars(settings(preset))}
    parameters = inspect.signature(command).parameters
    known = {key for key, parameter in parameters.items() if parameter.default is not None}
    return functools.partial(command, **{key: value for key, value in values.items() if key in known})
