"""Its presence puts the repository's root on the path, so that tests can share `tests.shapes` and `tests.toy_scene`.

The tools are scripts beside the package: their folder is put on the path the way running them does.
Where there is no GPU, Triton's kernels are run by its interpreter, which must be asked for before Triton is imported.
"""

import os
import sys
from pathlib import Path

import torch

sys.path.insert(0, str(Path(__file__).parents[1] / "tools"))
if not torch.cuda.is_available():
    os.environ.setdefault("TRITON_INTERPRET", "1")
