"""Speed of the kernels at the sizes the design names; time them with `pytest --benchmark-enable` on this
file.

Without that option each body runs once, so that the suite cannot rot. `extra_info` names the work in one
call.
"""

import pytest
import torch

from lightprobe.kernels import (
    gather_rows,
    hash_encode,
    occluded_light,
    occluded_light_adjoint,
    probe_weight,
    rasterize,
    stack_probes,
    weighted_gather,
)
from benchmarks.speed import cases


def run_backward(benchmark, out, wanted):
    """Time the backward pass alone."""
    grad = torch.randn_like(out)
    benchmark(lambda: torch.autograd.grad(out, wanted, grad, retain_graph=True))


@pytest.fixture
def probes():
    colors, *lobes = cases.probes()
    return colors.requires_grad_(), *lobes


@pytest.mark.benchmark(group="stacking, 25 M pairs")
def test_stack_forward(benchmark, probes):
    benchmark.extra_info["pairs"] = 1024 * 6 * 64 * 64
    benchmark(lambda: stack_probes(*probes))


@pytest.mark.benchmark(group="stacking, 25 M pairs")
def test_stack_backward(benchmark, probes):
    benchmark.extra_info["pairs"] = 1024 * 6 * 64 * 64
    run_backward(benchmark, stack_probes(*probes)[0], probes[0])


@pytest.mark.benchmark(group="stacking, 25 M pairs")
def test_probe_weight(benchmark, probes):
    benchmark.extra_info["pairs"] = 1024 * 6 * 64 * 64
    benchmark(lambda: probe_weight(*probes[1:]))


@pytest.fixture
def bumpy_sphere():
    return cases.bumpy_sphere()


@pytest.mark.benchmark(group="rasteriser, 82 k faces, 512 x 512")
def test_rasterize(benchmark, bumpy_sphere):
    benchmark.extra_info["faces"] = len(bumpy_sphere[1])
    seen = benchmark(lambda: rasterize(*bumpy_sphere, 512, 512))
    assert float((seen.face >= 0).float().mean()) > 0.5


@pytest.fixture
def grid():
    points, table, cells = cases.grid()
    return points, table.requires_grad_(), cells


@pytest.mark.benchmark(group="hash grid, 65 k points x 8 levels x 2")
def test_hash_encode_forward(benchmark, grid):
    benchmark(lambda: hash_encode(*grid))


@pytest.mark.benchmark(group="hash grid, 65 k points x 8 levels x 2")
def test_hash_encode_backward(benchmark, grid):
    run_backward(benchmark, hash_encode(*grid), grid[1])


@pytest.fixture
def taps():
    values, index, weight = cases.taps()
    return values.requires_grad_(), index, weight.requires_grad_()


@pytest.mark.benchmark(group="gather, 65 k x 8 taps x 3")
def test_weighted_gather_forward(benchmark, taps):
    benchmark(lambda: weighted_gather(*taps))


@pytest.mark.benchmark(group="gather, 65 k x 8 taps x 3")
def test_weighted_gather_backward(benchmark, taps):
    run_backward(benchmark, weighted_gather(*taps), (taps[0], taps[2]))


@pytest.mark.benchmark(group="gather, 65 k x 8 taps x 3")
def test_gather_rows_backward(benchmark, taps):
    run_backward(benchmark, gather_rows(taps[0], taps[1]), taps[0])


@pytest.mark.benchmark(group="occluded light, 12 k pixels x 384 directions")
def test_occluded_light(benchmark):
    case = cases.shadowed()
    benchmark(lambda: occluded_light(*case))


@pytest.mark.benchmark(group="occluded light, 12 k pixels x 384 directions")
def test_occluded_light_adjoint(benchmark):
    case = cases.shadowed()
    arriving = torch.rand(len(case[1]), 6)
    benchmark(lambda: occluded_light_adjoint(arriving, *case[1:]))
