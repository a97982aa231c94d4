import dataclasses

import numpy as np
import pytest
import torch

from lightprobe.insertion.occlusion import SurfacePoints, past, simplified
from lightprobe.insertion.virtual_object import load_virtual_object
from lightprobe.render.visibility import point_visibility
from tests.insertion.glbs import box, write
from tests.shapes import sphere


@pytest.fixture
def virtual(tmp_path):
    return load_virtual_object(write(tmp_path / "box.glb", box()))


def test_points_interpolate_any_place_of_large_faces(virtual):
    points = SurfacePoints.of(virtual)
    assert (points.cells > 4).all()
    barycentric = torch.from_numpy(np.random.default_rng(0).dirichlet([1, 1, 1], 500)).float()
    face = torch.arange(500) % len(virtual.faces)
    index, weight = points.taps(face, barycentric)
    wanted = (virtual.vertices[virtual.faces[face].long()] * barycentric[..., None]).sum(1)
    torch.testing.assert_close((points.points[index] * weight[..., None]).sum(1), wanted, atol=1e-5, rtol=0)
    torch.testing.assert_close(weight.sum(1), torch.ones(500))


def test_of_many_vertices_some_stand_for_their_neighbours(virtual):
    ball, faces = (torch.from_numpy(part) for part in sphere(7))
    fine = dataclasses.replace(
        virtual,
        vertices=ball,
        faces=faces,
        normals=ball,
        uvs=torch.zeros(len(ball), 4),
        colors=torch.ones(len(ball), 4),
        material=torch.zeros(len(faces), dtype=torch.long),
        twin=torch.full((len(faces),), -1),
    )
    points = SurfacePoints.of(fine)
    assert len(points.points) < 0.5 * len(ball)
    assert (points.points[points.vertex] - ball).norm(dim=1).max() < 0.05


@pytest.mark.slow
def test_directions_left_out_could_not_have_been_blocked():
    ball, faces = (torch.from_numpy(part) for part in sphere(2))
    colors, other = torch.full((len(faces), 3), 0.5), 0.6 * ball + torch.tensor([1.7, 0.2, -0.4])
    seen = past(other, faces, colors, ball, ball)
    middle = (other.amin(0) + other.amax(0)) / 2
    whole = point_visibility(other - middle, faces, colors, ball - middle, ball, 384)
    assert torch.equal(seen.unoccluded, whole.unoccluded)
    assert (seen.unoccluded[ball[:, 0] > 0.9] < 255).any()


def test_a_simplified_caster_is_welded(virtual):
    vertices, faces, colors = simplified(virtual.vertices, virtual.faces, torch.ones(12, 3))
    assert len(vertices) == 8
    assert len(faces) == len(colors) == 12
