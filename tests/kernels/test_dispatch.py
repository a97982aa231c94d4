"""Choice of the backend: by device and dtype, and what happens where Triton is missing."""

import sys
from pathlib import Path

import pytest
import torch

import lightprobe
from lightprobe.kernels import dispatch
from lightprobe.kernels.numba import stacking as numba_stacking
from lightprobe.kernels.reference import stacking as reference_stacking


@pytest.fixture
def fresh():
    dispatch._has_triton.cache_clear()
    yield
    dispatch._has_triton.cache_clear()


def test_the_cpu_gets_numba_in_float32_and_the_reference_in_float64():
    index = torch.zeros(3, dtype=torch.int32)
    assert dispatch.choose("stacking", torch.zeros(3), index) is numba_stacking
    assert dispatch.choose("stacking", torch.zeros(3).double(), index) is reference_stacking


def test_a_gpu_without_triton_gets_the_reference_and_says_so(monkeypatch, fresh):
    monkeypatch.setitem(sys.modules, "triton", None)
    with pytest.warns(UserWarning, match="slow reference kernels"):
        assert dispatch.backend_for("cuda") is dispatch.Backend.REFERENCE


def test_a_gpu_with_triton_gets_it(monkeypatch):
    monkeypatch.setattr(dispatch, "_has_triton", lambda: True)
    assert dispatch.backend_for("cuda") is dispatch.Backend.TRITON
    assert dispatch.backend_for("mps") is dispatch.Backend.REFERENCE


def test_loops_are_compiled_here_alone():
    """But for two file formats, whose loops are the format itself."""
    source = Path(lightprobe.__file__).parent
    texts = {str(path.relative_to(source)): path.read_text() for path in source.rglob("*.py")}
    compiling = {path for path, text in texts.items() if "@compiled(" in text}
    assert {path for path in compiling if not path.startswith("kernels/numba/")} == {
        "imaging/png16.py",
        "imaging/radiance.py",
    }
