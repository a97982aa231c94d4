"""The energy of a probe's lobe, and a furnace for stacked probes."""

import math

import pytest
import scipy.integrate
import torch

from lightprobe.core.config.distillation import AlphaRule
from lightprobe.light import cubemap
from lightprobe.models.probe_distribution import alpha2, mean_distribution, stack, stack_everywhere
from lightprobe.models.probe_pixels import ProbePixels

R = 32


def pixels(roughness: float, count: int = 6) -> ProbePixels:
    """Pixels that are seen along their normals, where the lobe's integral is known."""
    random = torch.Generator().manual_seed(4)
    normal = torch.nn.functional.normalize(torch.randn(count, 3, generator=random), dim=1)
    grey = torch.full((count, 3), 0.5)
    return ProbePixels(grey, grey, grey, normal, normal, torch.full((count,), roughness), grey)


@pytest.mark.parametrize("rule", list(AlphaRule))
@pytest.mark.parametrize("roughness", [0.3, 0.6, 1.0])
def test_the_energy_of_a_lobe(roughness, rule):
    """With v = n: (n.h)^2 = (1 + n.w) / 2, so that the integral over the half sphere is one over the cosine."""
    a2 = float(alpha2(torch.tensor(roughness), rule))

    def ring(cosine: float) -> float:
        return 2 * a2 * cosine / ((1 + cosine) / 2 * (a2 - 1) + 1) ** 2

    expected = scipy.integrate.quad(ring, 0, 1, points=[1 - 4 * a2] if a2 < 0.2 else None)[0]
    directions = cubemap.directions(4 * R).reshape(-1, 3)
    density = mean_distribution(pixels(roughness), directions, rule)
    assert float((density * cubemap.solid_angles(4 * R).reshape(-1)).sum()) == pytest.approx(
        expected, rel=0.02
    )
    if roughness == 1:
        assert expected == pytest.approx(1.0)  # a cosine over pi


@pytest.mark.parametrize("roughness", [0.3, 1.0])
def test_probes_of_one_colour_stack_to_it_wherever_any_looks(roughness):
    probes, color = pixels(roughness), torch.tensor([0.2, 0.5, 0.9])
    colors = color.expand(len(probes), 3).contiguous()
    radiance, density = stack(probes, colors, cubemap.directions(R).reshape(-1, 3), AlphaRule.R4)
    seen = density > 1e-6
    assert math.isclose(float(seen.float().mean()), 1.0, abs_tol=0.3)
    torch.testing.assert_close(radiance[seen], color.expand(int(seen.sum()), 3), rtol=1e-4, atol=1e-5)
    everywhere, _ = stack_everywhere(probes, colors, R, AlphaRule.R4)
    assert float(everywhere.max()) <= 0.9 * (1 + 1e-3)
