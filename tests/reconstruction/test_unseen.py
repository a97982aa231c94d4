"""Caves that no photo sees into are filled; what is seen, and what lies out of all pictures, stays."""

import numpy as np
import pytest
import torch
from lightprobe.reconstruction.unseen import fill_unseen

from lightprobe.core.config import DecomposeConfig, SdfMode
from lightprobe.geometry.mesh import is_closed
from lightprobe.reconstruction.lattice_model import LatticeModel
from lightprobe.reconstruction.start import start_from_hull
from lightprobe.render.surface import View, visible_surface
from lightprobe.scene.hull import Hull
from tests.shapes import camera_at

CPU = torch.device("cpu")
ABOVE = [(2.6 * np.cos(a), 2.6 * np.sin(a), 1.3) for a in np.linspace(0, 6, 8)]


def views(places, focal=110.0):
    return [View.of(camera_at(place, size=128, focal=focal), CPU) for place in places]


def model_of(inside, config, cells=40):
    """Return a ball of radius .8 on a lattice, without what `inside` names: (x, y, z) -> bool."""
    axis = np.linspace(-1.15, 1.15, 24)
    ball = sum(a**2 for a in np.meshgrid(axis, axis, axis)) < 0.64
    hull = Hull(ball, ball.astype(np.float32), np.full(3, -1.15), np.full(3, 1.15))
    model = LatticeModel(start_from_hull(hull, cells), config, CPU, 0)
    if config.sdf is not SdfMode.MLP:
        cave = inside(*model.lattice.vertices.T) & (model.distances() < 0)
        model.reshape(torch.where(cave, torch.tensor(model.lattice.cell), model.distances().detach()))
    return model


@pytest.fixture
def config():
    return DecomposeConfig(hash_levels=2, hash_finest=16, shadows=False)


def cave(x, y, z):
    """A chamber in the middle, with a tunnel that opens at the bottom."""
    return (x**2 + y**2 + z**2 < 0.2) | ((x**2 + y**2 < 0.02) & (z < 0))


def area(model):
    vertices, faces = model.present()
    a, b, c = vertices.detach()[faces.long()].unbind(1)
    return float(torch.linalg.cross(b - a, c - a).norm(dim=1).sum() / 2)


@pytest.mark.slow
def test_a_cave_that_is_seen_from_nowhere_is_filled(config):
    model, plain = model_of(cave, config), model_of(lambda x, y, z: x > 9, config)
    before = [visible_surface(*model.present(), view) for view in views(ABOVE)]
    assert area(model) > 1.25 * area(plain)
    fill_unseen(model, views(ABOVE))
    assert area(model) == pytest.approx(area(plain), rel=0.02)
    assert is_closed(*(part.detach() for part in model.present()))
    for view, seen in zip(views(ABOVE), before, strict=True):
        after = visible_surface(*model.present(), view)
        assert torch.equal(after.pixel, seen.pixel)
        torch.testing.assert_close(after.position, seen.position, rtol=0, atol=1e-5)


def test_a_cave_that_one_photo_looks_into_stays_as_far_as_it_is_seen(config):
    model = model_of(cave, config)
    whole = area(model)
    fill_unseen(model, views([*ABOVE, (0.01, 0.0, -2.6)]))
    assert area(model) > 0.25 * whole + 0.75 * area(model_of(lambda x, y, z: x > 9, config))
    points, middle = model.positions(), model.distances()
    tunnel = (points[:, 0] ** 2 + points[:, 1] ** 2 < 0.005) & (points[:, 2] > -0.7) & (points[:, 2] < -0.2)
    assert (middle[tunnel] > 0).all()


def test_what_no_photo_frames_stays(config):
    model = model_of(cave, config)
    kept = model.distances().detach().clone()
    fill_unseen(
        model, views([(2.6, 0.0, 1.3)], focal=4000.0)
    )  # a close-up of the ball's front, past the cave's end
    changed = model.distances() != kept
    assert not changed.all()
    assert (
        model.distances()[model.lattice.vertices[:, 2] < -0.5] == kept[model.lattice.vertices[:, 2] < -0.5]
    ).all()
    fill_unseen(model, [])
    assert torch.equal(model.distances() != kept, changed)


@pytest.mark.slow
def test_a_network_of_distances_is_left_alone():
    config = DecomposeConfig(hash_levels=2, hash_finest=16, shadows=False, sdf=SdfMode.MLP)
    model = model_of(cave, config, cells=8)
    before = model.distances().detach().clone()
    fill_unseen(model, views(ABOVE))
    assert torch.equal(model.distances(), before)
