"""Arguments that several commands share."""

from pathlib import Path
from typing import Annotated

from tyro.conf import FlagCreatePairsOff, Positional, arg

SceneArg = Annotated[Positional[Path], arg(metavar="SCENE", help="Folder with photos and cameras.")]
RunArg = Annotated[Positional[Path], arg(metavar="RUN", help="Run folder made by fit or train.")]
RunOut = Annotated[Path, arg(aliases=["-o"], metavar="RUN", help="Run folder to make or to go on with.")]
CameraArg = Annotated[
    Path,
    arg(
        metavar="C.json",
        help="Camera of the view: camera_to_world, fx, fy, cx, cy, width, height; or a file with many.",
    ),
]
EnvironmentArg = Annotated[Path, arg(metavar="ENV.exr", help="Equirectangular environment, EXR or Radiance HDR.")]
Device = Annotated[str, arg(metavar="auto|cpu|cuda", help="Where to compute.")]
Seed = Annotated[int, arg(help="Equal seeds give equal results on a CPU.")]
Restart = Annotated[
    FlagCreatePairsOff[bool],
    arg(help="Begin anew: throw away what this command, and all that builds on it, has left in the run."),
]
Hdri = Annotated[
    Path | None,
    arg(metavar="DIR", help="Folder of .exr or .hdr environments, z up: the predictor also trains under them."),
]
