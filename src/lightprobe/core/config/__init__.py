"""All configuration: of both phases (`reconstruction`, `distillation`), of predictions, and the presets of
all three.

Every field can be set on the command line; what a run was made with is written to its folder as JSON.
"""

from lightprobe.core.config.distillation import DistillConfig
from lightprobe.core.config.prediction import Method, OptimizeConfig, PredictConfig, SolveConfig
from lightprobe.core.config.presets import Preset, Settings, demo_settings, settings
from lightprobe.core.config.reconstruction import (
    DecomposeConfig,
    ImageLoss,
    LightUpdate,
    SdfMode,
    Smoothed,
    StartShape,
    VertexUnit,
)

__all__ = [
    "DecomposeConfig",
    "DistillConfig",
    "ImageLoss",
    "LightUpdate",
    "Method",
    "OptimizeConfig",
    "PredictConfig",
    "Preset",
    "SdfMode",
    "Settings",
    "Smoothed",
    "SolveConfig",
    "StartShape",
    "VertexUnit",
    "demo_settings",
    "settings",
]
