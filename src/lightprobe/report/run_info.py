"""How a run was made, read back from its config.json: the preset or the steps, the seeds, and the commands.

SCENE, RUN and HDRI stand for folders in the commands, which are the same wherever these lie.
"""

from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from enum import Enum
from pathlib import Path
from typing import Any

from lightprobe.core.config import (
    DecomposeConfig,
    DistillConfig,
    PredictConfig,
    Preset,
    demo_settings,
    settings,
)
from lightprobe.core.errors import ConfigError
from lightprobe.core.run import RunFolder

Config = DecomposeConfig | DistillConfig

_DEMO = "demo"  # has the settings of a preset, but a command of its own
_BUNDLED = ("lightprobe", "assets", "demo")  # the end of the path of the demo's scene

_SETTINGS = {**{preset.value: settings(preset) for preset in Preset}, _DEMO: demo_settings()}


@dataclass(frozen=True)
class Phase:
    """What one phase was run with."""

    section: str  # of config.json, and of the command line's options
    config: Config
    seed: int
    hdri: bool = False
    prediction: PredictConfig | None = None  # how the run predicts, kept with the second phase

    @property
    def preset(self) -> str | None:
        """The preset that has these very settings, or None."""
        return next((name for name in _SETTINGS if not self.options(name)), None)

    @property
    def steps(self) -> str:
        """The steps of its parts, as they were asked for; a part may have had nothing to do."""
        if isinstance(self.config, DecomposeConfig):
            parts = [self.config.pass1_iterations, self.config.pass2_iterations, self.config.pass3_iterations]
        else:
            parts = [self.config.steps, self.config.sphere_steps]
        return " + ".join(map(str, parts)) + " steps"

    def nearest(self) -> str:
        """Return the preset of the command line that fewest settings differ from."""
        return min((preset.value for preset in Preset), key=lambda name: len(self.options(name)))

    def options(self, preset: str) -> list[str]:
        """Return the options that turn a preset into these settings."""
        options = _changed(self.section, getattr(_SETTINGS[preset], self.section), self.config)
        if self.prediction is not None:
            options += _changed("predict", _SETTINGS[preset].predict, self.prediction)
        return options


def read_phases(run: RunFolder) -> list[Phase]:
    """Return the phases that the run went through; none where its settings are of another version."""
    stored = run.sections()
    if "decompose" not in stored:
        return []
    try:
        phases = [_first_phase(run)]
        if "distill" in stored:
            phases.append(_second_phase(run))
    except ConfigError:
        return []
    return phases


def fitted_preset(run: RunFolder) -> Preset:
    """Return the preset that Phase I was run with, up to single settings; quick where its settings do not
    tell.

    Phase II is not read: another process may be starting it over just now.
    """
    if "decompose" not in run.sections():
        return Preset.QUICK
    try:
        return Preset(_first_phase(run).nearest())
    except ConfigError:
        return Preset.QUICK


def training_facts(phases: list[Phase]) -> dict[str, str]:
    """Return the preset, or the steps where they are no preset's, and the seed by heading."""
    if not phases:
        return {}
    presets, seeds = [phase.preset for phase in phases], [str(phase.seed) for phase in phases]
    if presets[0] is not None and len(set(presets)) == 1:
        facts = {"preset": presets[0]}
    else:
        made = [f"preset {phase.preset}" if phase.preset else phase.steps for phase in phases]
        facts = dict(zip(("Phase I", "Phase II"), made, strict=False))
    return facts | ({"seed": seeds[0]} if len(set(seeds)) == 1 else {"seeds": " and ".join(seeds)})


def training_commands(phases: list[Phase], scene: Path) -> list[str]:
    """Return the commands that make such a run from `scene`, or none where the run does not tell."""
    if not phases:
        return []
    seeds = {phase.seed for phase in phases}
    demo = all(phase.preset == _DEMO and not phase.hdri for phase in phases) and len(phases) == 2
    if demo and len(seeds) == 1 and scene.parts[-3:] == _BUNDLED:
        return [f"lightprobe demo -o RUN --seed {phases[0].seed}"]
    nearest = {phase.nearest() for phase in phases}
    if len(phases) == 2 and len(seeds) == len(nearest) == 1:
        return [_command("train SCENE -o RUN", phases)]
    return [
        _command(start, [p]) for start, p in zip(("fit SCENE -o RUN", "distill RUN"), phases, strict=False)
    ]


def _command(start: str, phases: list[Phase]) -> str:
    preset = phases[0].nearest()
    options = [option for phase in phases for option in phase.options(preset)]
    hdri = ["--hdri HDRI"] if any(phase.hdri for phase in phases) else []
    return " ".join([f"lightprobe {start} --preset {preset} --seed {phases[0].seed}", *hdri, *options])


def _phase(
    section: str,
    stored: dict[str, Any],
    parse: Callable[[dict[str, Any]], Config],
) -> Phase:
    settings = {key: value for key, value in stored.items() if key not in ("seed", "hdri")}
    parsed = parse(settings)
    seed = stored.get("seed")
    if (
        settings.keys() != {f.name for f in fields(parsed)} or type(seed) is not int
    ):  # what is missing would be guessed
        raise ConfigError(f"The stored settings of '{section}' are of another version.")
    return Phase(section, parsed, seed, stored.get("hdri") is not None)


def _first_phase(run: RunFolder) -> Phase:
    return _phase("decompose", run.config("decompose"), DecomposeConfig.from_json)


def _second_phase(run: RunFolder) -> Phase:
    prediction = PredictConfig.from_json(run.config("predict")) if "predict" in run.sections() else None
    return replace(_phase("distill", run.config("distill"), DistillConfig.from_json), prediction=prediction)


def _changed(section: str, usual: Config | PredictConfig, config: Config | PredictConfig) -> list[str]:
    """Return the options that turn `usual` settings of a section into those of `config`."""
    names = [
        field.name for field in fields(usual) if getattr(usual, field.name) != getattr(config, field.name)
    ]
    return [_option(section, name, getattr(config, name)) for name in names]


def _option(section: str, name: str, value: Any) -> str:
    """Return a setting as the command line takes it."""
    dashed = name.replace("_", "-")
    if isinstance(value, bool):
        return f"--{section}.{dashed}" if value else f"--{section}.no-{dashed}"
    return f"--{section}.{dashed} {value.value if isinstance(value, Enum) else value}"
