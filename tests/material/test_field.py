"""The material as a function of position: always valid, what it starts from, and its gradients."""

import pytest
import torch
from lightprobe.material.field import (
    CHANNELS,
    MAX_NORMAL_OFFSET,
    MIN_ROUGHNESS,
    START_BASE,
    MaterialField,
    activate,
    level_resolutions,
)


def field(seed=0, **change):
    settings = {"levels": 4, "features": 2, "log2_size": 8, "finest": 32, "extent": 1.2, **change}
    return MaterialField(**settings, generator=torch.Generator().manual_seed(seed))


def points(count=300, seed=0, size=2.0):
    return size * (torch.rand(count, 3, generator=torch.Generator().manual_seed(seed)) - 0.5)


def test_any_numbers_become_a_valid_material():
    raw = torch.cat(
        [torch.randn(100, CHANNELS, generator=torch.Generator().manual_seed(0)) * 5, torch.zeros(1, 8)]
    )
    material = activate(torch.cat([raw, torch.full((1, 8), 1e4), torch.full((1, 8), -1e4)]))
    assert 0 <= float(material[:, :5].min()) <= float(material[:, :5].max()) <= 1
    assert float(material[:, 3].min()) == pytest.approx(MIN_ROUGHNESS)
    assert float(material[:, 5:].abs().max()) == pytest.approx(MAX_NORMAL_OFFSET)


def test_resolutions_are_a_geometric_ladder():
    assert level_resolutions(4, 16, 128).tolist() == [16, 32, 64, 128]
    assert level_resolutions(1, 12, 256).tolist() == [12]
    ladder = level_resolutions(8, 12, 256)
    assert ladder[0] == 12
    assert ladder[-1] == 256
    ratio = ladder[1:] / ladder[:-1]
    assert float(ratio.max() / ratio.min()) < 1.1


def test_a_new_field_is_dark_grey_half_rough_and_a_third_metallic():
    material = field()(points()).detach()
    mean = material.mean(0)
    torch.testing.assert_close(mean[:3], torch.full((3,), START_BASE), atol=0.02, rtol=0)
    assert float(mean[3]) == pytest.approx((1 + MIN_ROUGHNESS) / 2, abs=0.03)
    assert float(mean[4]) == pytest.approx(0.3, abs=0.03)
    assert float(material[:, 5:].abs().max()) < 0.1


def test_equal_generators_make_equal_fields():
    one, again, other = (field(seed)(points()) for seed in (1, 1, 2))
    assert torch.equal(one, again)
    assert not torch.equal(one, other)


def test_beyond_the_cube_its_border_goes_on():
    material = field()
    inside, beyond = points(), points() * 5
    torch.testing.assert_close(material(beyond), material(beyond.clamp(-1.2, 1.2)))
    assert not torch.equal(material(inside), material(inside.clamp(-0.5, 0.5)))


def test_gradients_reach_table_network_and_points():
    material, at = (
        field(levels=2, log2_size=4, finest=16, extent=1.0).double(),
        points(7).double().requires_grad_(),
    )
    names, values = zip(*material.named_parameters(), strict=True)

    def shown(at, *values):
        return torch.func.functional_call(material, dict(zip(names, values, strict=True)), (at,))

    with torch.no_grad():
        material.table.normal_(
            generator=torch.Generator().manual_seed(3)
        )  # far from the kinks of relu at zero
    values = tuple(value.detach().requires_grad_() for value in values)
    assert torch.autograd.gradcheck(shown, (at, *values), fast_mode=True)
