import numpy as np
import pytest
import torch
import trimesh

from lightprobe.core.config import DecomposeConfig
from lightprobe.geometry import atlas
from lightprobe.geometry.mesh import (
    Mesh,
    clean,
    crease_normals,
    decimate,
    edge_faces,
    face_normals,
    smooth,
    uv_tangents,
    vertex_normals,
)
from lightprobe.geometry.texels import texel_points
from tests.shapes import sphere


def uv_overlap(uvs, uv_faces, size=256):
    counts = np.zeros((size, size), int)
    y, x = np.mgrid[:size, :size] + 0.5
    for tri in uvs[uv_faces] * size:
        (ax, ay), (bx, by), (cx, cy) = tri
        w0 = (bx - ax) * (y - ay) - (by - ay) * (x - ax)
        w1 = (cx - bx) * (y - by) - (cy - by) * (x - bx)
        w2 = (ax - cx) * (y - cy) - (ay - cy) * (x - cx)
        counts += ((w0 > 0) & (w1 > 0) & (w2 > 0)) | ((w0 < 0) & (w1 < 0) & (w2 < 0))
    return counts.max()


def test_triangle_atlas_stays_in_the_unit_square_without_overlap():
    uvs, faces = atlas.triangle_atlas(33, 256)
    assert uvs.min() >= 0
    assert uvs.max() <= 1
    assert uv_overlap(uvs, faces) == 1


@pytest.mark.slow
def test_unwrap_keeps_the_mesh_and_charts_do_not_overlap():
    vertices, faces = sphere(2)
    mesh, size = atlas.unwrap(vertices, faces, 256, time_limit=60)
    assert size == 256
    assert np.array_equal(mesh.vertices.numpy(), vertices)
    assert np.array_equal(mesh.faces.numpy(), faces)
    assert mesh.uv_faces.max() < len(mesh.uvs)
    assert uv_overlap(mesh.uvs.numpy(), mesh.uv_faces.numpy()) == 1


def test_unwrap_falls_back_when_time_is_up():
    vertices, faces = sphere(1)
    mesh, size = atlas.unwrap(vertices, faces, 128, time_limit=0.0)
    assert len(mesh.uvs) == 3 * len(faces)
    assert size >= 128


def test_the_fallback_gives_every_face_of_the_default_preset_texels():
    config = DecomposeConfig()
    faces = np.arange(3 * config.max_faces).reshape(-1, 3) % 999
    mesh, size = atlas.unwrap(np.zeros((999, 3)), faces, config.texture_size, time_limit=0.0)
    assert size <= 1024
    face, _, _ = texel_points(mesh, size)
    assert len(face.unique()) == config.max_faces


@pytest.mark.slow
def test_tangents_are_unit_and_point_along_u():
    vertices, faces = sphere(2)
    mesh, _ = atlas.unwrap(vertices, faces, 256, time_limit=60)
    t = uv_tangents(mesh)
    assert torch.allclose(t.norm(dim=1), torch.ones(len(t)), atol=1e-5)
    # Moving along the tangent must raise u: check it edge by edge on faces far from chart borders.
    p, uv = mesh.vertices[mesh.faces.long()], mesh.uvs[mesh.uv_faces.long()]
    along = ((p[:, 1] - p[:, 0]) * t[mesh.uv_faces[:, 0].long()]).sum(1)
    du = (uv[:, 1] - uv[:, 0])[:, 0]
    clear = du.abs() > 0.3 * (uv[:, 1] - uv[:, 0]).norm(dim=1)
    assert (torch.sign(along[clear]) == torch.sign(du[clear])).float().mean() > 0.98


def test_clean_drops_crumbs_and_decimate_keeps_the_shape():
    vertices, faces = sphere(4)
    crumb_v, crumb_f = sphere(0)
    both_v = np.concatenate([vertices, crumb_v * 0.02 + 2]).astype(np.float32)
    both_f = np.concatenate([faces, crumb_f + len(vertices)]).astype(np.int32)
    v, f = clean(both_v, both_f)
    assert len(v) == len(vertices)
    v, f = decimate(v, f, 1000)
    assert len(f) <= 1000
    assert abs(np.linalg.norm(v, axis=1) - 1).max() < 0.02
    edges = edge_faces(torch.from_numpy(f))
    assert (edges.faces[:, 0] != edges.faces[:, 1]).all()


def test_smoothing_takes_out_ripples_and_keeps_form_and_size():
    round_one, faces = sphere(4)
    egg = round_one * (1 + 0.1 * round_one[:, 2:] ** 2)
    rippled = egg * np.random.default_rng(3).normal(1, 0.01, (len(egg), 1))
    smoothed = smooth(rippled, faces, 5)
    before, after = (np.linalg.norm(v, axis=1) / np.linalg.norm(egg, axis=1) - 1 for v in (rippled, smoothed))
    assert smoothed.dtype == np.float32
    assert after.std() < 0.5 * before.std()
    assert abs(after.mean()) < 1e-3
    assert np.ptp(smooth(egg, faces, 5), axis=0) == pytest.approx(np.ptp(egg, axis=0), rel=1e-3)


def test_clean_drops_what_bounds_a_void_inside_and_keeps_what_stands_beside():
    vertices, faces = sphere(3)
    void, beside = (0.5 * vertices, faces[:, ::-1] + len(vertices)), (vertices + 3, faces + 2 * len(vertices))
    all_v = np.concatenate([vertices, void[0], beside[0]]).astype(np.float32)
    all_f = np.concatenate([faces, void[1], beside[1]]).astype(np.int32)
    v, f = clean(all_v, all_f)
    assert len(v) == 2 * len(vertices)
    assert len(f) == 2 * len(faces)
    assert np.linalg.norm(v, axis=1).min() > 0.9


def test_vertex_normals_of_a_sphere_point_outwards():
    vertices, faces = (torch.from_numpy(a) for a in sphere(3))
    assert (vertex_normals(vertices, faces) * vertices).sum(1).min() > 0.999


def test_creases_split_the_normals_of_a_box_but_not_of_a_sphere():
    box = trimesh.creation.box().subdivide().subdivide()
    vertices, faces = (
        torch.tensor(box.vertices, dtype=torch.float32),
        torch.tensor(box.faces, dtype=torch.int32),
    )
    index = crease_normals(vertices, faces, 40.0)
    mesh = Mesh(vertices, faces, torch.zeros(1, 2), torch.zeros_like(faces), index)
    flat = torch.nn.functional.normalize(face_normals(vertices, faces), dim=1)
    assert torch.allclose(mesh.normals()[index.long()], flat[:, None].expand(-1, 3, -1), atol=1e-5)
    assert torch.equal(
        crease_normals(vertices, faces, 180.0).max(), torch.tensor(len(vertices) - 1, dtype=torch.int32)
    )
    round_vertices, round_faces = (torch.from_numpy(part) for part in sphere(3))
    assert int(crease_normals(round_vertices, round_faces, 40.0).max()) + 1 == len(round_vertices)
