"""Speed of culled stacking beside that of all pairs; time them with `pytest --benchmark-enable` on this file."""

import pytest
import torch

from lightprobe.kernels import stack_probes
from lightprobe.light import cubemap
from lightprobe.light.culled_stacking import stack_on_cubemap


@pytest.fixture
def probes():
    """4096 pixels of a sphere in the order of the photo, mirrors to matte, for 6 x 128 x 128 texels: 403 M pairs."""
    y, x = torch.meshgrid(torch.linspace(-1, 1, 73), torch.linspace(-1, 1, 73), indexing="ij")
    inside = x * x + y * y < 0.98
    x, y = x[inside], y[inside]
    normals = torch.stack([x, y, (1 - x * x - y * y).sqrt()], dim=1)
    views = torch.nn.functional.normalize(torch.tensor([0.0, 0.0, 4.0]) - normals, dim=1)
    roughness = (0.35 + 0.3 * torch.sin(5 * x) * torch.cos(4 * y)).clamp(0.08, 1)
    return torch.rand(len(x), 3), normals, views, roughness**4


@pytest.mark.benchmark(group="stacking, 4096 pixels, 6 x 128 x 128 texels")
def test_all_pairs(benchmark, probes):
    directions = cubemap.directions(128).reshape(-1, 3)
    benchmark(lambda: stack_probes(*probes, directions))


@pytest.mark.benchmark(group="stacking, 4096 pixels, 6 x 128 x 128 texels")
def test_culled(benchmark, probes):
    benchmark(lambda: stack_on_cubemap(*probes, 128))
