"""The tools are scripts beside the package; put their folder on the path the way running them does."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[2] / "tools"))
