"""Measurements of the program, run from a checkout with lightprobe installed: python -m benchmarks NAME --help."""

import argparse
import sys
from pathlib import Path

# generated scenes and the comparison of runs are scripts of the folder beside this one
sys.path.append(str(Path(__file__).parents[1] / "tools"))


def command_line(about: str | None) -> argparse.ArgumentParser:
    """Return a parser that shows a module's docstring as it is."""
    return argparse.ArgumentParser(description=about, formatter_class=argparse.RawDescriptionHelpFormatter)
