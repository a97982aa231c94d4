import dataclasses

import numpy as np
import pytest
import torch

from lightprobe.core.errors import ConfigError
from lightprobe.insertion.placement import Placement, ground_height, place
from lightprobe.insertion.virtual_object import load_virtual_object
from lightprobe.scene.camera import Similarity
from tests.insertion.glbs import box, write
from tests.shapes import camera_at, sphere

KNOWN = torch.from_numpy(sphere(3)[0])
CAMERA = camera_at((4.0, 0.0, 1.6), size=200, focal=170)
MASK = np.zeros((200, 200), np.float32)
MASK[60:140, 60:140] = 1
ONE = Similarity(np.zeros(3), 1.0)


@pytest.fixture
def virtual(tmp_path):
    return load_virtual_object(write(tmp_path / "box.glb", box()))


def test_a_bulge_under_the_foot_does_not_lower_the_ground():
    foot = torch.cat([KNOWN, torch.tensor([[0.3, 0.2, -1.03]])])
    assert ground_height(foot) == pytest.approx(-1, abs=0.04)
    assert ground_height(KNOWN) == pytest.approx(-1, abs=0.04)


def test_the_foot_stands_at_the_pixel_and_the_height_is_as_asked(virtual):
    placed = place(virtual, KNOWN, ONE, CAMERA, MASK, Placement(at=(150.0, 150.0), scale=0.5))
    assert placed.at == pytest.approx((150, 150), abs=1e-6)
    assert float(placed.virtual.size[2]) == pytest.approx(1.0, abs=1e-4)
    foot = placed.virtual.vertices[placed.virtual.vertices[:, 2] < placed.ground + 1e-3]
    foot = (foot.amin(0) + foot.amax(0)) / 2
    assert CAMERA.project(foot[None].numpy())[0, :2] == pytest.approx([150, 150], abs=0.1)


def test_by_default_it_stands_free_and_in_the_frame(virtual):
    placed = place(virtual, KNOWN, ONE, CAMERA, MASK, Placement(scale=0.3))
    pixel = CAMERA.project(placed.virtual.vertices.numpy().astype(np.float64))
    assert placed.warnings == ()
    assert (pixel[:, :2] > 0).all()
    assert (pixel[:, :2] < 200).all()
    assert MASK[pixel[:, 1].astype(int), pixel[:, 0].astype(int)].max() == 0


def test_the_files_height_counts_where_it_is_plausible(virtual):
    scale = place(virtual, KNOWN, ONE, CAMERA, MASK, Placement(at=(150, 150))).scale
    assert scale == pytest.approx(1.0, abs=0.01)
    odd = place(virtual, KNOWN, Similarity(np.zeros(3), 1e-3), CAMERA, MASK, Placement(at=(150, 150)))
    assert odd.scale == 0.6
    assert "--scale" in odd.warnings[0]


def test_turning_is_anticlockwise_from_above(virtual):
    long = dataclasses.replace(virtual, vertices=virtual.vertices * torch.tensor([3.0, 1, 1]))
    straight, turned = (
        place(long, KNOWN, ONE, CAMERA, MASK, Placement(at=(150, 150), scale=0.5, turn=angle)).virtual
        for angle in (0, 90)
    )
    middle = straight.vertices.mean(0)
    corner = (straight.vertices[0] - middle)[[1, 0, 2]] * torch.tensor([-1.0, 1, 1])
    torch.testing.assert_close(turned.vertices[0] - turned.vertices.mean(0), corner, atol=1e-4, rtol=0)


def test_a_place_in_the_object_is_told_and_the_sky_is_refused(virtual):
    inside = place(virtual, KNOWN, ONE, CAMERA, MASK, Placement(at=(100.0, 130.0), scale=0.5))
    assert "within the known object" in inside.warnings[0]
    with pytest.raises(ConfigError, match="horizon"):
        place(virtual, KNOWN, ONE, CAMERA, MASK, Placement(at=(100.0, 2.0)))
    with pytest.raises(ConfigError, match="outside"):
        place(virtual, KNOWN, ONE, CAMERA, MASK, Placement(at=(300.0, 150.0)))
    with pytest.raises(ConfigError, match="--scale"):
        place(virtual, KNOWN, ONE, CAMERA, MASK, Placement(scale=-1.0))


@pytest.mark.parametrize("thickness", [0.0, 0.01])
def test_a_flat_object_is_measured_by_its_longest_side(virtual, thickness):
    """A rug of twice the object's height is no towering slab, and one without thickness has a foot, too."""
    shape = torch.tensor([4.0, 2.0, thickness]) / virtual.size.max()
    rug = dataclasses.replace(virtual, vertices=virtual.vertices * shape)
    longest = float(rug.size.max())
    placed = place(rug, KNOWN, ONE, CAMERA, MASK, Placement(at=(150, 150)))
    assert not any("times as high" in warning for warning in placed.warnings)
    assert float(placed.virtual.size.max()) == pytest.approx(longest, rel=1e-3)
    scaled = place(rug, KNOWN, ONE, CAMERA, MASK, Placement(at=(150, 150), scale=0.5))
    assert float(scaled.virtual.size.max()) == pytest.approx(1.0, rel=1e-2)
    assert float(scaled.virtual.vertices[:, 2].amin()) == pytest.approx(scaled.ground, abs=1e-4)
