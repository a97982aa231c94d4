"""Arguments that several commands share, and how all of them are shown."""

import functools
from pathlib import Path
from typing import Annotated

from tyro.conf import FlagCreatePairsOff, Positional, arg

from lightprobe.core.config.prediction import PredictionOptions, Sun
from lightprobe.core.errors import ConfigError

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
EnvironmentArg = Annotated[
    Path, option(metavar="ENV.exr", help="Equirectangular environment, EXR or Radiance HDR.")
]
SizeArg = Annotated[
    str | None,
    option(
        metavar="WxH", help="Size of the maps, 128x64 to 4096x2048 by powers of two; else the prediction's."
    ),
]
SunArg = Annotated[Sun, option(metavar="inside|separate", help="Whether the maps have the suns and lamps.")]
MovedScene = Annotated[Path | None, option(metavar="FOLDER", help="Where the scene is now, if it has moved.")]
Device = Annotated[str, option(metavar="auto|cpu|cuda", help="Where to compute.")]
Seed = Annotated[int, option(help="Equal seeds give equal results on a CPU.")]
Restart = Annotated[
    FlagCreatePairsOff[bool],
    option(help="Begin anew: throw away what this command, and all that builds on it, has left in the run."),
]
Hdri = Annotated[
    Path | None,
    option(
        metavar="DIR", help="Folder of .exr or .hdr environments, z up: the predictor also trains under them."
    ),
]
FoundCameraArg = Annotated[
    Path | None,
    option(
        metavar="C.json", help="Camera of the photo, or many of which its name chooses; else it is found."
    ),
]
MaskArg = Annotated[
    Path | None,
    option(
        metavar="M",
        help="White object on black, or a folder with a .png for each photo; else the photo's alpha, or found.",
    ),
]
Prediction = Annotated[PredictionOptions, arg(name="")]


def numbers(text: str, option: str, wanted: str, counts: tuple[int, ...]) -> tuple[float, ...]:
    """Return the numbers of a text with commas; raise `ConfigError` unless they are as many as `counts` has.

    option, wanted: what the error says, the option and what it has to be.
    """
    try:
        found = tuple(float(part) for part in text.split(","))
    except ValueError:
        found = ()
    if len(found) not in counts:
        raise ConfigError(f"{option} must be {wanted}, not '{text[:60]}'.")
    return found
