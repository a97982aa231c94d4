"""Measures kernels, predictions and training on the CPU beside the machine's limits, and writes benchmarks/SPEED.md.

    python tools/measure_speed.py [-o benchmarks/SPEED.md] [--run RUN [--scene FOLDER]] [--quick]

    limits      the rates of copying and of multiply-adds, measured in the same process with the same threads
    kernels     Numba and reference bodies, the work that the formula asks for, its share of the limit (speed.kernels)
    prediction  at 512 x 512 onto 6 x 128 x 128 by the default method, and its memory, in a process of its own; only
                with a finished RUN, as it needs a trained model (speed.target)
    stages      of a prediction by `solve`, growing with object pixels, texels and triangles (speed.stages)
    training    steps growing with photos, a profile of the steps of Phase I, and what the log of RUN says of the whole
                (speed.training)

Where no RUN is needed the object is a ball of many triangles with blotchy material under a smooth light. Times are
medians after a call to warm up; exponents are fitted to logarithms. `--quick` takes small cases once, to see that all
of it works.
"""

import argparse
import sys
from pathlib import Path

from lightprobe.core.errors import LightprobeError
from lightprobe.core.files import write_bytes
from speed.page import Plan, page


def main() -> None:
    """Read the command line, measure and write."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("-o", "--output", type=Path, default=Path("benchmarks/SPEED.md"))
    parser.add_argument(
        "--run", type=Path, help="finished run folder: its model and asset predict, its log is read"
    )
    parser.add_argument("--scene", type=Path, help="where the run's photos are, if they have moved")
    parser.add_argument("--quick", action="store_true", help="small cases, one repeat")
    given = parser.parse_args()
    try:
        write_bytes(given.output, page(Plan(given.quick, given.run, given.scene)).encode())
    except LightprobeError as error:
        sys.exit(str(error))
    print(f"Speed: {given.output}")


if __name__ == "__main__":
    main()
