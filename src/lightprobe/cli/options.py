"""Arguments that several commands share, and how all of them are shown."""

import functools
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Annotated, Any

from tyro.conf import FlagCreatePairsOff, Positional, arg

from lightprobe.core.config_predict import PredictConfig

_UNSAID = ("", "None", "False")  # defaults that tell nobody anything


def _default(label: str) -> str:
    return "" if label in _UNSAID else f"(default: {label})"


option = functools.partial(arg, help_behavior_hint=_default)

SceneArg = Annotated[Positional[Path], option(metavar="SCENE", help="Folder with photos and cameras.")]
RunArg = Annotated[Positional[Path], option(metavar="RUN", help="Run folder made by fit or train.")]
RunOut = Annotated[Path, option(aliases=["-o"], metavar="RUN", help="Run folder to make or to go on with.")]
CameraArg = Annotated[
    Path,
    option(
        metavar="C.json",
        help="Camera of the view: camera_to_world, fx, fy, cx, cy, width, height; or a file with many.",
    ),
]
EnvironmentArg = Annotated[Path, option(metavar="ENV.exr", help="Equirectangular environment, EXR or Radiance HDR.")]
Device = Annotated[str, option(metavar="auto|cpu|cuda", help="Where to compute.")]
Seed = Annotated[int, option(help="Equal seeds give equal results on a CPU.")]
Restart = Annotated[
    FlagCreatePairsOff[bool],
    option(help="Begin anew: throw away what this command, and all that builds on it, has left in the run."),
]
Hdri = Annotated[
    Path | None,
    option(metavar="DIR", help="Folder of .exr or .hdr environments, z up: the predictor also trains under them."),
]


@dataclass(frozen=True)
class PredictionOptions:
    """What a command changes of how its run predicts (`PredictConfig`); what is not given stays as the run has it."""

    light_resolution: int | None = None
    """Texels along each cubemap edge of the maps, a power of two; by default what the run was trained with."""
    max_pixels: int | None = None
    """Photos with more object pixels are reduced; by default what the run was trained with."""
    sampled_share: float | None = None
    """Share of the object's pixels that become light probes; by default what the run was trained with."""
    unseen_share: float | None = None
    """Weight of the usual light where hardly a pixel looks; by default what the run was trained with."""

    def over(self, config: PredictConfig) -> PredictConfig:
        """Return a run's configuration with what was given in its place; raise `ConfigError` for unusable values."""
        return replace(config, **self.given())

    def given(self) -> dict[str, Any]:
        """Return what was given, by name."""
        values = {field.name: getattr(self, field.name) for field in fields(self)}
        return {name: value for name, value in values.items() if value is not None}


Prediction = Annotated[PredictionOptions, arg(name="")]
UNCHANGED = PredictionOptions()
