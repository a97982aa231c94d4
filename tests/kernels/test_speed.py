"""Speed of the kernels at the sizes the design names; time them with `pytest --benchmark-enable` on this file.

Without that option each body runs once, so that the suite cannot rot. `extra_info` names the work in one call.
"""

import math

import pytest
import torch

from lightprobe.kernels import gather_rows, hash_encode, probe_weight, rasterize, stack_probes, weighted_gather


def unit(count):
    return torch.nn.functional.normalize(torch.randn(count, 3), dim=1)


def run_backward(benchmark, out, wanted):
    """Time the backward pass alone."""
    grad = torch.randn_like(out)
    benchmark(lambda: torch.autograd.grad(out, wanted, grad, retain_graph=True))


@pytest.fixture
def probes():
    """1024 pixels and 6 x 64 x 64 texels: 25 million pairs."""
    torch.manual_seed(0)
    normals, views = unit(1024), unit(1024)
    views = views * (normals * views).sum(dim=1, keepdim=True).sign()
    alpha2 = (0.08 + 0.92 * torch.rand(1024)) ** 4
    return torch.rand(1024, 3, requires_grad=True), normals, views, alpha2, unit(6 * 64 * 64)


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
    """81 796 faces that fill most of 512 x 512 pixels."""
    rings, size = 143, 512
    polar, around = torch.linspace(0, math.pi, rings + 1)[:, None], torch.arange(2 * rings)[None] * math.pi / rings
    radius = 1 + 0.1 * torch.sin(5 * polar) * torch.cos(4 * around)
    x, y, z = radius * polar.sin() * around.cos(), radius * polar.cos(), radius * polar.sin() * around.sin()
    points = torch.stack([x, y, 3 - z], dim=2).reshape(-1, 3)
    screen = torch.cat([size / 2 + 1.15 * size * points[:, :2] / points[:, 2:], points[:, 2:]], dim=1)
    i, j = torch.meshgrid(torch.arange(rings), torch.arange(2 * rings), indexing="ij")
    a, b = i * 2 * rings + j, i * 2 * rings + (j + 1) % (2 * rings)
    below = 2 * rings
    faces = torch.cat([torch.stack([a, b, a + below], dim=2), torch.stack([b, b + below, a + below], dim=2)])
    return screen, faces.reshape(-1, 3).int()


@pytest.mark.benchmark(group="rasteriser, 82 k faces, 512 x 512")
def test_rasterize(benchmark, bumpy_sphere):
    benchmark.extra_info["faces"] = len(bumpy_sphere[1])
    seen = benchmark(lambda: rasterize(*bumpy_sphere, 512, 512))
    assert float((seen.face >= 0).float().mean()) > 0.5


@pytest.fixture
def grid():
    """65 536 points, 8 levels of 2^17 rows, 2 features."""
    torch.manual_seed(0)
    cells = torch.tensor([int(12 * (256 / 12) ** (level / 7) + 1e-6) for level in range(8)])
    return torch.rand(65536, 3), torch.randn(8, 2**17, 2, requires_grad=True), cells


@pytest.mark.benchmark(group="hash grid, 65 k points x 8 levels x 2")
def test_hash_encode_forward(benchmark, grid):
    benchmark(lambda: hash_encode(*grid))


@pytest.mark.benchmark(group="hash grid, 65 k points x 8 levels x 2")
def test_hash_encode_backward(benchmark, grid):
    run_backward(benchmark, hash_encode(*grid), grid[1])


@pytest.fixture
def taps():
    """65 536 queries of 8 rows among 32 768 rows of 3 channels."""
    torch.manual_seed(0)
    index = torch.randint(0, 32768, (65536, 8), dtype=torch.int32)
    return torch.randn(32768, 3, requires_grad=True), index, torch.rand(65536, 8, requires_grad=True)


@pytest.mark.benchmark(group="gather, 65 k x 8 taps x 3")
def test_weighted_gather_forward(benchmark, taps):
    benchmark(lambda: weighted_gather(*taps))


@pytest.mark.benchmark(group="gather, 65 k x 8 taps x 3")
def test_weighted_gather_backward(benchmark, taps):
    run_backward(benchmark, weighted_gather(*taps), (taps[0], taps[2]))


@pytest.mark.benchmark(group="gather, 65 k x 8 taps x 3")
def test_gather_rows_backward(benchmark, taps):
    run_backward(benchmark, gather_rows(taps[0], taps[1]), taps[0])
