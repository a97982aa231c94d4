"""Depth maps: axes that are right-handed, and points blocked by what stands before them and by nothing else."""

import pytest
import torch

from lightprobe.geometry.mesh import vertex_normals
from lightprobe.render.depth_maps import DepthMaps, frames
from tests.shapes import ball_over_floor, sphere


def directions(count=50):
    random = torch.Generator().manual_seed(0)
    axes = torch.cat([torch.eye(3), -torch.eye(3)])
    return torch.nn.functional.normalize(torch.cat([axes, torch.randn(count - 6, 3, generator=random)]), dim=1)


def test_frames_are_rotations_onto_the_direction():
    towards = directions()
    axes = frames(towards)
    torch.testing.assert_close(axes @ axes.mT, torch.eye(3).expand(50, 3, 3), atol=1e-6, rtol=0)
    torch.testing.assert_close(torch.linalg.det(axes), torch.ones(50))
    assert torch.equal(axes[:, 2], towards)


def test_of_a_ball_the_side_towards_the_light_is_lit():
    vertices, faces = (torch.from_numpy(part) for part in sphere(3))
    normals = vertex_normals(vertices, faces)
    maps = DepthMaps.of(vertices, faces, vertices, normals, 256)
    for axes in frames(directions(8)):
        lit, before = maps.visibility(axes)
        cosine = normals @ axes[2]
        assert (lit[cosine > 0.1] > 0.999).all()
        assert (lit[cosine < -0.3] < 0.001).all()
        assert (before[cosine < -0.3] >= 0).all()


@pytest.mark.parametrize("away", [0.0, 0.5])
def test_the_face_before_a_point_is_the_ball_s(away):
    """Straight up from the floor's middle stands the ball; half a unit beside it, nothing."""
    vertices, faces, middle = ball_over_floor(0.2, 0.5)
    point = vertices[middle] + torch.tensor([[away, 0.0, 0.0]])
    maps = DepthMaps.of(vertices, faces, point, torch.tensor([[0.0, 0, 1]]), 256)
    lit, before = maps.visibility(frames(torch.tensor([[0.0, 0, 1]]))[0])
    if away:
        assert float(lit) == 1
    else:
        assert float(lit) == 0
        assert (faces[before] >= 41 * 41).all()


def test_an_open_mesh_and_a_closed_one_block_alike():
    """Of a closed mesh only the faces that look at the light are drawn."""
    vertices, faces = (torch.from_numpy(part) for part in sphere(3))
    normals = vertex_normals(vertices, faces)
    closed, opened = (DepthMaps.of(vertices, f, vertices, normals, 256) for f in (faces, faces[:-1]))
    assert closed.outward is not None
    assert opened.outward is None
    for axes in frames(directions(8)):
        one, other = closed.visibility(axes)[0], opened.visibility(axes)[0]
        assert (one != other).float().mean() < 0.01
