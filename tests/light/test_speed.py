"""Speed of culled stacking beside that of all pairs; time them with `pytest --benchmark-enable` on this file."""

import pytest

from lightprobe.kernels import stack_probes
from lightprobe.light import cubemap
from lightprobe.light.culled_stacking import stack_on_cubemap
from benchmarks.speed import cases


@pytest.fixture
def probes():
    """4096 pixels of a sphere in the order of the photo, mirrors to matte, for 6 x 128 x 128 texels: 403 M
    pairs.
    """
    return cases.sphere_pixels()


@pytest.mark.slow
@pytest.mark.benchmark(group="stacking, 4096 pixels, 6 x 128 x 128 texels")
def test_all_pairs(benchmark, probes):
    directions = cubemap.directions(128).reshape(-1, 3)
    benchmark(lambda: stack_probes(*probes, directions))


@pytest.mark.benchmark(group="stacking, 4096 pixels, 6 x 128 x 128 texels")
def test_culled(benchmark, probes):
    benchmark(lambda: stack_on_cubemap(*probes, 128))
