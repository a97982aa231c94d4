"""Its presence puts the repository's root on the path, so that tests can share `tests.shapes` and `tests.toy_scene`.

Where there is no GPU, Triton's kernels are run by its interpreter, which must be asked for before Triton is imported.
"""

import os

import torch

if not torch.cuda.is_available():
    os.environ.setdefault("TRITON_INTERPRET", "1")
