"""The command: python -m benchmarks NAME ..., where NAME is a module of this package with a function `main`."""

import importlib
import sys

from lightprobe.core.errors import INTERRUPTED, LightprobeError

MEASUREMENTS = {
    "adapt": "no measurement: makes scenes of published data sets with true lights",
    "run": "every scene and method trained and scored, into records/ and RESULTS.md",
    "tables": "RESULTS.md from the records alone",
    "speed": "kernels, predictions and training on the CPU, into SPEED.md",
    "gpu": "kernels, trainings and predictions on a GPU, into GPU.md",
    "golden": "the scores that tests/runs/test_golden.py holds later code to",
    "fleet": "a fleet's cost beside the work itself, and a machine that dies",
    "insertion": "a virtual object put into a photo, against path-traced truth",
    "locate": "poses of new photos, and photos without the object",
    "make": "no measurement: makes the benchmark scenes with their truth",
    "memory": "peak memory of commands by the size of a photo",
    "object": "Phase I alone against the true object and lights",
    "paper": "steps and memory of `--preset paper`, and a full run projected",
    "population": "Phase I on two dozen random objects against their truth",
    "score": "predicted maps of any program against true ones",
    "prepare": "cameras and masks of plain photos against known ones",
    "shoot": "no measurement: makes simulated photo shoots with their truth",
    "service": "the service under load, with hostile requests and killed workers",
}


def main(words: list[str]) -> int:
    """Run a measurement with the words behind its name and return the exit code."""
    if not words or words[0] not in MEASUREMENTS:
        print("usage: python -m benchmarks NAME ...   (NAME --help explains one)\n")
        print("\n".join(f"  {name:<10} {about}" for name, about in MEASUREMENTS.items()))
        return 0 if words and words[0] in ("-h", "--help") else 2
    sys.argv[0] = f"python -m benchmarks {words[0]}"
    try:
        return importlib.import_module(f"benchmarks.{words[0]}").main(words[1:]) or 0
    except LightprobeError as error:
        print(error, file=sys.stderr)
        return error.exit_code
    except KeyboardInterrupt:
        return INTERRUPTED


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
