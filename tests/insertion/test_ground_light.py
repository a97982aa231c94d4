import math

import pytest
import torch

from lightprobe.insertion.ground_light import Caster, SkyPatches, plan_ground_light
from lightprobe.light import cubemap
from lightprobe.light.environment import Environment

R = 16
FAR = torch.tensor([[50.0, 50, 0], [50, 51, 0], [50, 50, 1]])
AWAY = Caster(FAR, torch.tensor([[0, 1, 2]]).int(), torch.zeros(1, 3))


def plate(height: float, radiance: float = 0.0) -> Caster:
    """A square of edge 1 over the origin."""
    v = torch.tensor([[-0.5, -0.5, height], [0.5, -0.5, height], [0.5, 0.5, height], [-0.5, 0.5, height]])
    return Caster(v, torch.tensor([[0, 1, 2], [0, 2, 3]]).int(), torch.full((2, 3), radiance))


def plan(sky: torch.Tensor, known: Caster, virtual: Caster):
    patches = SkyPatches.of(Environment(sky))
    return plan_ground_light(patches, known, virtual, 0.0, torch.tensor([-4.0, -4.0]), 0.05, 160), patches


def sun(direction: tuple[float, float, float]) -> torch.Tensor:
    sky = torch.zeros(6, R, R, 3)
    texel = cubemap.nearest_texel(torch.tensor(direction), R)
    sky.reshape(-1, 3)[texel] = 100
    return sky


def test_patches_hold_the_whole_irradiance():
    torch.manual_seed(0)
    sky = torch.rand(6, R, R, 3) ** 4
    patches = SkyPatches.of(Environment(sky))
    direction, angle = cubemap.directions(R), cubemap.solid_angles(R)[..., None]
    wanted = (sky * direction[..., 2:].clamp(min=0) * angle).sum((0, 1, 2))
    torch.testing.assert_close(patches.total(), wanted, rtol=0.08, atol=0)
    assert float(patches.angle.sum()) == pytest.approx(math.pi, rel=5e-3)
    assert (patches.direction[:, 2] > 0).all()


def test_a_plate_takes_the_form_factor_of_a_uniform_sky():
    light, patches = plan(torch.ones(6, R, R, 3), AWAY, plate(0.5))
    # The form factor of a square of edge 1 over a point below its middle at 1/2: four times that of a
    # quarter.
    a = 0.5 / 0.5
    quarter = (a / math.sqrt(1 + a * a)) * math.atan(a / math.sqrt(1 + a * a)) / math.pi
    lost = -float(light.added[80, 80, 0]) / float(patches.total()[0])
    assert lost == pytest.approx(4 * quarter, abs=0.03)
    assert float(light.factor()[2, 2].min()) > 0.99


def test_what_blocks_the_sky_gives_its_own_light():
    black, grey = (plan(torch.ones(6, R, R, 3), AWAY, plate(0.5, radiance))[0] for radiance in (0.0, 1.0))
    assert float(black.factor()[80, 80].mean()) < 0.5
    # as bright as the sky
    torch.testing.assert_close(grey.factor(), torch.ones(160, 160, 3), rtol=0, atol=0.01)


def test_a_suns_shadow_lies_where_the_sun_is_not():
    light, _ = plan(sun((1.0, 0.0, 1.0)), AWAY, plate(1.0))
    shadow = light.factor()[..., 0] < 0.5
    row, column = shadow.nonzero().float().mean(0)
    assert float(column) == pytest.approx((-1 + 4) / 0.05, abs=3)  # one height away from the sun
    assert float(row) == pytest.approx(80, abs=3)
    assert int(shadow.sum()) == pytest.approx(400, rel=0.15)  # of cells


def test_a_shadow_in_a_shadow_changes_nothing():
    light, _ = plan(sun((1.0, 0.0, 1.0)), plate(1.0), plate(1.2))
    alone, _ = plan(sun((1.0, 0.0, 1.0)), AWAY, plate(1.2))
    assert float(light.added[:, 55:65].abs().sum()) < 0.5 * float(alone.added[:, 55:65].abs().sum())
    assert float((light.without + light.added).min()) > -1e-3
