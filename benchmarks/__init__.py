"""Measurements of the program, run from a checkout with lightprobe installed: python -m benchmarks NAME --help."""

import sys
from pathlib import Path

# generated scenes and the comparison of runs are scripts of the folder beside this one
sys.path.append(str(Path(__file__).parents[1] / "tools"))
