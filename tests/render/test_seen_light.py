"""What backgrounds show of the light: by direction, on the plane below, and by several photos."""

import math
from dataclasses import replace

import numpy as np
import pytest
import torch

from lightprobe.light import cubemap
from lightprobe.render.seen_light import SeenLight, seen_together
from lightprobe.scene.background import Background
from lightprobe.scene.support import SupportPlane
from tests.backgrounds import CAMERA, LIGHT, around
from tests.lit_sphere import CPU, glossy_sphere, photograph
from tests.shapes import camera_at

TABLE = SupportPlane(np.array([0.0, 0.0, 1.0]), -0.8)


@pytest.fixture(scope="module")
def background():
    return around(photograph(glossy_sphere(), CAMERA, LIGHT), LIGHT)


def test_the_background_is_gathered_by_direction(background):
    seen = SeenLight.of(background, 16, CPU)
    whole = seen.share > 0.9
    assert int(whole.sum()) > 20
    torch.testing.assert_close(seen.radiance[whole], LIGHT[whole], rtol=1e-5, atol=1e-6)
    ahead = cubemap.directions(16) @ -torch.tensor(CAMERA.camera_to_world[:3, 2], dtype=torch.float32)
    assert float(ahead[seen.share > 0].min()) > math.cos(math.atan(math.hypot(32, 32) / 60)) - 0.1
    everything = SeenLight.of(replace(background, seen=np.ones((64, 64), bool)), 16, CPU)
    size = float((everything.share * cubemap.solid_angles(16)).sum())
    edge = math.atan2(1, 60 * 60 / 32 / 32 * math.sqrt(1 + 2 * (32 / 60) ** 2))  # a quarter of the picture
    assert size == pytest.approx(4 * edge, rel=0.03)


def test_several_backgrounds_are_brought_to_one_exposure(background):
    one = SeenLight.of(background, 16, CPU)
    other = SeenLight(3 * one.radiance, one.share, one.clipped)
    both = SeenLight.joined([one, other], torch.tensor([1.0, 3.0]))
    seen = one.share > 0
    torch.testing.assert_close(both.radiance[seen], one.radiance[seen])
    assert float(both.share.max()) == 1
    clipped = SeenLight(one.radiance, one.share, torch.ones_like(one.clipped))
    long = replace(clipped, radiance=torch.ones_like(one.radiance))  # white, at four times the exposure
    both = SeenLight.joined([one, long], torch.tensor([1.0, 4.0]))
    assert not both.clipped[seen].any()
    torch.testing.assert_close(both.radiance[seen], one.radiance[seen])
    bounds = SeenLight.joined([clipped, long], torch.tensor([1.0, 4.0]))
    assert bounds.clipped.all()
    torch.testing.assert_close(bounds.radiance[seen], one.radiance[seen].clamp(min=0.25))


def over_a_table(place, gain=1.0) -> Background:
    """Return the picture of a table of two colours, the border at x = 0.5 of it, and of black above it."""
    camera = camera_at(place, size=128, focal=100.0)
    row, column = np.mgrid[:128, :128]
    local = np.stack(
        [(column + 0.5 - camera.cx) / 100, -(row + 0.5 - camera.cy) / 100, -np.ones((128, 128))], -1
    )
    ray = local @ camera.camera_to_world[:3, :3].T
    t = (camera.position[2] + 0.8) / np.where(ray[..., 2] < 0, -ray[..., 2], np.nan)
    color = np.where(
        (camera.position[0] + t * ray[..., 0] > 0.5)[..., None], (0.2, 0.3, 0.4), (0.6, 0.5, 0.4)
    )
    clipped = np.zeros((128, 128, 3), bool)
    return Background((gain * color).astype(np.float32), np.isfinite(t), clipped, camera)


def test_a_table_is_seen_from_the_centre_at_the_same_place_by_all_photos():
    parts = [SeenLight.of(over_a_table(at), 32, CPU, TABLE) for at in ((3.0, 0.5, 1.0), (-1.0, 2.5, 1.5))]
    direction = cubemap.directions(32)
    for part in parts:
        table = (part.share > 0.9) & (direction[..., 2] < -0.3)
        assert int(table.sum()) > 300
        across = direction[..., 0] / -direction[..., 2] * 0.8 - 0.5
        dark = part.radiance[..., 0] < 0.4
        sure = table & (across.abs() > 0.1)
        assert torch.equal(dark[sure], across[sure] > 0)
        assert bool(dark[sure].any())
        assert not bool(dark[sure].all())
    both = (parts[0].share > 0.9) & (parts[1].share > 0.9)
    assert float((parts[0].radiance - parts[1].radiance)[both].abs().median()) < 1e-4


def test_what_is_seen_of_a_table_covers_its_solid_angle():
    """The whole half below, where a camera above the object sees nothing else."""
    above = replace(over_a_table((0.01, 0.0, 1.0)), seen=np.ones((128, 128), bool))
    seen = SeenLight.of(above, 16, CPU, TABLE)
    size = float((seen.share * cubemap.solid_angles(16)).sum())
    half = 0.64 * 1.8 / 0.8  # half an edge of the square that the camera sees, over the centre's height
    corner = math.atan2(half * half, math.sqrt(1 + 2 * half * half))
    assert size == pytest.approx(4 * corner, rel=0.06)  # from the camera it is less than half of that


def test_photos_of_one_light_share_what_they_see_in_the_exposure_of_each():
    gains = 1.0, 0.25, 3.0
    places = (3.0, 0.5, 1.0), (-1.0, 2.5, 1.5), (1.0, -2.5, 1.2)
    parts = [SeenLight.of(over_a_table(*each), 16, CPU, TABLE) for each in zip(places, gains, strict=True)]
    shared = seen_together(parts)
    for part, own, gain in zip(shared, parts, gains, strict=True):
        whole = own.share > 0.9
        torch.testing.assert_close(
            part.radiance[whole], own.radiance[whole], rtol=0.2, atol=0
        )  # at the border
        assert float(part.share.sum()) > 1.2 * float(own.share.sum())
        torch.testing.assert_close(part.radiance / gain, shared[0].radiance, rtol=0.03, atol=1e-3)


def test_photos_that_nothing_links_do_not_share_what_they_see():
    near, far = (SeenLight.of(over_a_table((3.0, 0.5, 1.0), gain), 16, CPU, TABLE) for gain in (1.0, 5.0))
    elsewhere = replace(far, share=torch.where(near.share > 0, 0.0, 1.0))
    parts = [near, elsewhere, near.divided(torch.tensor(0.5)), near]
    for part, own in zip(seen_together(parts), parts, strict=True):
        seen = own.share > 0
        assert torch.equal(part.share > 0, seen)
        torch.testing.assert_close(part.radiance[seen], own.radiance[seen], rtol=1e-4, atol=1e-6)
    assert torch.equal(seen_together([near])[0].share, near.share)
