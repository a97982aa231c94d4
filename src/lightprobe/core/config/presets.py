"""The presets: how Phase I, Phase II and the predictions after them run together."""

from dataclasses import dataclass
from enum import StrEnum

from lightprobe.core.config import distillation, prediction, reconstruction
from lightprobe.core.config.distillation import DistillConfig
from lightprobe.core.config.prediction import PredictConfig
from lightprobe.core.config.reconstruction import DecomposeConfig
from lightprobe.core.errors import ConfigError


class Preset(StrEnum):
    """Size of a run: `quick` for two CPU cores, `standard` for a GPU, `paper` for the paper's settings, `paper-small`
    for these at sizes for two CPU cores.
    """

    QUICK = "quick"
    STANDARD = "standard"
    PAPER = "paper"
    PAPER_SMALL = "paper-small"


@dataclass(frozen=True)
class Settings:
    """What a run is made with; fields are the names of option groups and of sections of config.json."""

    decompose: DecomposeConfig  # Phase I
    distill: DistillConfig  # Phase II
    predict: PredictConfig


def settings(preset: Preset | str) -> Settings:
    """Return the settings of a preset; raise `ConfigError` for a name that is none."""
    if preset not in list(Preset):
        raise ConfigError(f"There is no preset '{preset}'; choose one of {', '.join(Preset)}.")
    name = Preset(preset).value.replace("-", "_")
    return Settings(*(getattr(part, name)() for part in (reconstruction, distillation, prediction)))


def demo_settings() -> Settings:
    """Return the settings of the bundled scene: those of `quick` with fewer steps."""
    return Settings(reconstruction.demo(), distillation.demo(), prediction.quick())
