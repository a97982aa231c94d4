"""The object under an environment that is turned around it, seen by one of the run's cameras.

    python examples/03_relight.py runs/pot src/lightprobe/assets/demo/env_relight/e_0.exr -o relit --turns 4

Any equirectangular EXR or Radiance HDR file will do, such as one that 02_predict.py wrote.
"""

import argparse
import math
from pathlib import Path

import torch

import lightprobe
from lightprobe.core.run import RunFolder
from lightprobe.light.environment import Environment
from lightprobe.runs.outputs import write_picture
from lightprobe.scene.record import read_record


def about_z(angle: float) -> torch.Tensor:
    """Return the rotation (3, 3) by `angle` radians about the vertical."""
    c, s = math.cos(angle), math.sin(angle)
    return torch.tensor([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def main() -> None:
    """Render as the command line says."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("run", type=Path)
    parser.add_argument("environment", type=Path, help="equirectangular .exr or .hdr")
    parser.add_argument("-o", "--output", type=Path, default=Path("relit"), help="folder for the pictures")
    parser.add_argument("--turns", type=int, default=4)
    parser.add_argument("--stops", type=float, default=0.0, help="exposure: 1 is twice as bright")
    given = parser.parse_args()

    decomposition = lightprobe.Predictor.load(given.run).decomposition
    camera = next(iter(read_record(RunFolder.open(given.run)).cameras["test"].values()))
    light = Environment.load(given.environment).scaled(2.0**given.stops)
    given.output.mkdir(parents=True, exist_ok=True)
    for turn in range(given.turns):
        turned = light.rotated(about_z(2 * math.pi * turn / given.turns))
        image, coverage = lightprobe.relight(decomposition, turned, camera)  # linear, premultiplied
        write_picture(given.output / f"{turn:03d}.png", image, coverage)
    print(f"{given.turns} pictures in {given.output}")


if __name__ == "__main__":
    main()
