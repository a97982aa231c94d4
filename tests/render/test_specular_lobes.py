"""The lobes that stand for the specular reflection: shares, the blend of metal and dielectric, and gradients."""

import json
from pathlib import Path

import numpy as np
import pytest
import torch

import lightprobe
from lightprobe.render import brdf
from lightprobe.render.specular_lobes import dielectric_part, specular_lobes


def views(count=400, dtype=torch.float32):
    random = torch.Generator().manual_seed(0)
    cosine, roughness, dielectric = torch.rand(3, count, generator=random, dtype=dtype)
    return cosine, 0.08 + 0.92 * roughness, dielectric


def test_no_lobe_has_a_negative_share_and_none_lies_behind():
    cosine, roughness, dielectric = views()
    lobes = specular_lobes(brdf.view_taps(cosine, roughness), roughness, dielectric)
    assert float(lobes.share.min()) >= 0
    assert float(lobes.share.sum(1).max()) <= 1 + 1e-6
    assert float(lobes.roughness.min()) > 0
    assert float(lobes.bend.min()) > -0.5  # near the normal to beyond the mirror direction


def test_a_sharp_metal_is_a_mirror():
    """Of a smooth surface all lies in lobes around the mirror direction, about as wide as its roughness says."""
    cosine, roughness = torch.linspace(0.4, 1, 20), torch.full((20,), 0.1)
    lobes = specular_lobes(brdf.view_taps(cosine, roughness), roughness, torch.zeros(20))
    assert float(lobes.share.sum(1).min()) > 0.9
    bend = (lobes.share * lobes.bend).sum(1) / lobes.share.sum(1)
    torch.testing.assert_close(bend, torch.ones(20), atol=0.1, rtol=0)


def test_the_dielectric_s_part_at_both_ends():
    a, b, _ = brdf.environment_brdf(*views()[:2])
    ends = (torch.full_like(a, brdf.DIELECTRIC_F0), torch.ones_like(a))
    torch.testing.assert_close(dielectric_part(ends[0], a, b), torch.ones_like(a))
    torch.testing.assert_close(dielectric_part(ends[1], a, b), torch.zeros_like(a))
    f0, d = torch.rand(len(a), generator=torch.Generator().manual_seed(1)), brdf.DIELECTRIC_F0
    f0 = d + (1 - d) * f0
    metal = (f0 - d) / (1 - d) * (a + b)  # of f0 A + B; the rest is the dielectric's
    torch.testing.assert_close(dielectric_part(f0, a, b), 1 - metal / (f0 * a + b), atol=1e-5, rtol=0)


def test_gradients():
    cosine, roughness, dielectric = (x.clone().requires_grad_() for x in views(10, torch.float64))

    def lobes(cosine, roughness, dielectric):
        return tuple(vars(specular_lobes(brdf.view_taps(cosine, roughness), roughness, dielectric)).values())

    assert torch.autograd.gradcheck(lobes, (cosine, roughness, dielectric))


def bundled() -> np.ndarray:
    """Return the fitted parameters: metal and dielectric, by roughness, by the root of n.v."""
    table = Path(lightprobe.__file__).parent / "assets" / "specular_lobes.json"
    return np.array(json.loads(table.read_text()))


@pytest.mark.parametrize("dielectric", [0.0, 0.3, 1.0])
@pytest.mark.parametrize(("cosine", "roughness", "column", "row"), [(1.0, 1.0, -1, -1), (1.0, 0.0, -1, 0)])
def test_at_the_table_s_corners_the_lobes_are_the_fitted_ones(cosine, roughness, column, row, dielectric):
    metal, other = bundled()[:, row, column]
    expected = (1 - dielectric) * metal + dielectric * other
    taps = brdf.view_taps(torch.tensor([cosine]), torch.tensor([roughness]))
    lobes = specular_lobes(taps, torch.tensor([0.5]), torch.tensor([dielectric]))
    found = torch.cat([lobes.bend[0], lobes.roughness[0], lobes.share[0]])
    assert found.tolist() == pytest.approx([*expected[:2], *(0.5 * expected[2:4]), *expected[4:]], abs=1e-5)
