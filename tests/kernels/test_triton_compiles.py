"""Every Triton kernel compiles for a GPU, with none in this machine."""

import os
import subprocess
import sys

import pytest

KERNELS = {
    "_gather",
    "_scatter",
    "_row_products",
    "_encode",
    "_encode_backward",
    "_encode_backward_to_points",
    "_stack",
    "_project",
    "_forward",
    "_totals",
    "_spread",
    "_turn",
    "_draw_small",
    "_draw_large",
    "_multiply",
}


@pytest.mark.long
@pytest.mark.parametrize(("kind", "architecture"), [("cuda", "80"), ("cuda", "90"), ("hip", "gfx942")])
def test_every_kernel_compiles(kind, architecture, tmp_path):
    pytest.importorskip("triton")
    environment = {name: value for name, value in os.environ.items() if name != "TRITON_INTERPRET"}
    done = subprocess.run(
        [sys.executable, "-m", "tests.kernels.triton_compilation", kind, architecture],
        env=environment | {"TRITON_CACHE_DIR": str(tmp_path)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert set(done.stdout.split()) == KERNELS
