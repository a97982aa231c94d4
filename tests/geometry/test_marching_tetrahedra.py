import numpy as np
import pytest
import torch

from lightprobe.geometry.marching_tetrahedra import CASES, Crossing, marching_tetrahedra, sign_change_loss
from lightprobe.geometry.mesh import edge_faces, face_normals
from lightprobe.geometry.tet_lattice import TET_EDGES, build_lattice, kuhn_tetrahedra


def cube_lattice(cells: int = 12):
    return build_lattice(np.ones((cells,) * 3, bool), np.full(3, -1.0), 2.0 / cells)


def test_the_six_tetrahedra_fill_the_cube_with_positive_volumes():
    corners = np.array([[c & 1, c >> 1 & 1, c >> 2 & 1] for c in range(8)], float)
    p = corners[kuhn_tetrahedra()]
    volumes = np.linalg.det(p[:, 1:] - p[:, :1]) / 6
    assert np.allclose(volumes, 1 / 6)


def test_every_case_uses_exactly_the_crossed_edges():
    for code in range(16):
        crossed = {e for e, (a, b) in enumerate(TET_EDGES) if (code >> a & 1) != (code >> b & 1)}
        assert set(CASES[code][CASES[code] >= 0].tolist()) == crossed


def test_lattice_border_is_marked():
    lattice = cube_lattice(4)
    on_border = (lattice.vertices.abs() > 1 - 1e-6).any(1)
    assert torch.equal(lattice.boundary, on_border)


def test_sphere_is_closed_outward_and_has_the_right_volume():
    lattice = cube_lattice(24)
    distance = lattice.vertices.norm(dim=1) - 0.7
    vertices, faces = marching_tetrahedra(lattice, Crossing.of(lattice, distance), lattice.vertices, distance)
    edges = edge_faces(faces)
    assert (edges.faces[:, 0] != edges.faces[:, 1]).all()
    assert len(vertices) - len(edges.vertices) + len(faces) == 2
    a, b, c = vertices[faces.long()].unbind(1)
    volume = float((torch.linalg.cross(a, b) * c).sum() / 6)
    assert volume == pytest.approx(4 / 3 * np.pi * 0.7**3, rel=0.01)
    assert ((face_normals(vertices, faces) * a).sum(1) > 0).float().mean() > 0.999
    assert (vertices.norm(dim=1) - 0.7).abs().max() < 0.01


@pytest.mark.slow
def test_gradient_reaches_distances_and_positions():
    lattice = cube_lattice(3)
    distance = (lattice.vertices.norm(dim=1) - 0.77).double().requires_grad_()
    positions = lattice.vertices.double().requires_grad_()

    def volume(p, s):
        vertices, faces = marching_tetrahedra(lattice, Crossing.of(lattice, s), p, s)
        a, b, c = vertices[faces.long()].unbind(1)
        return (torch.linalg.cross(a, b) * c).sum()

    assert torch.autograd.gradcheck(volume, (positions, distance), eps=1e-6, atol=1e-5)


def test_sign_change_loss_falls_when_a_floater_goes():
    lattice = cube_lattice(8)

    def loss(distance):
        return sign_change_loss(lattice, Crossing.of(lattice, distance), distance)

    clean = lattice.vertices.norm(dim=1) - 0.6
    floater = clean.clone()
    floater[(lattice.vertices - 0.75).norm(dim=1) < 0.2] = -0.1
    assert loss(floater) > loss(clean)
