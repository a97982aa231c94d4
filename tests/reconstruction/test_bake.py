"""From the lattice to a textured mesh: it shows what the model shows, and caves that no photo sees are filled."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from lightprobe.core.config import DecomposeConfig, SdfMode
from lightprobe.core.errors import ConvergenceError
from lightprobe.geometry.mesh import edge_faces, face_normals, is_closed, uv_tangents
from lightprobe.geometry.texels import texel_points
from lightprobe.reconstruction.bake import bake, fill_unseen
from lightprobe.reconstruction.lattice_model import LatticeModel
from lightprobe.reconstruction.start import start_from_hull
from lightprobe.render.asset import asset_gbuffer
from lightprobe.render.surface import View, visible_surface
from lightprobe.scene.hull import Hull
from tests.lit_sphere import CORNER, CPU
from tests.shapes import camera_at

CONFIG = DecomposeConfig(
    hash_levels=4,
    hash_finest=32,
    surface_smoothing=0,
    texture_size=256,
    unwrap_seconds=0.0,
    shadows=False,
    normal_ramp=0.0,
)


@pytest.fixture(scope="module")
def model():
    """Return a ball on a lattice, with materials and bent normals that change over its surface."""
    axis = np.linspace(-1.15, 1.15, 24)
    ball = sum(a**2 for a in np.meshgrid(axis, axis, axis)) < 0.8
    hull = Hull(ball, ball.astype(np.float32), np.full(3, -1.15), np.full(3, 1.15))
    model = LatticeModel(start_from_hull(hull, 16), CONFIG, CPU, 0)
    with torch.no_grad():
        model.material.field.table[:1].normal_(generator=torch.Generator().manual_seed(0))
        model.material.field.weights[-1].mul_(10)
    return model


@pytest.fixture(scope="module")
def baked(model):
    said = []
    return bake(model, CONFIG, CPU, said.append), said


def test_the_asset_shows_what_the_model_shows(model, baked):
    """In every channel, but for what lies between texels and what creases of the coarse ball do to normals."""
    asset, view = baked[0], View.of(CORNER, CPU)
    mine = asset_gbuffer(asset, visible_surface(asset.mesh.vertices, asset.mesh.faces, view), view)
    theirs = next(model.gbuffers([view], 1.0))
    assert torch.equal(mine.pixel, theirs.pixel)
    for name, tolerance in (
        ("position", 1e-5),
        ("base_color", 0.01),
        ("roughness", 0.01),
        ("metallic", 0.01),
    ):
        found, expected = getattr(mine, name), getattr(theirs, name)
        assert float((found - expected).abs().mean()) < tolerance, name
        assert name == "position" or float(expected.std(0).min()) > 3 * tolerance, name
    assert float((mine.normal * theirs.normal).sum(1).mean()) > 0.995
    assert (
        float((torch.nn.functional.normalize(mine.position, dim=1) * mine.normal).sum(1).mean()) < 0.99
    )  # bent


def test_the_surface_loses_the_lattice_s_ripples(model, baked):
    smoothed = bake(model, replace(CONFIG, surface_smoothing=5), CPU, print).mesh
    turns = []
    for mesh in (baked[0].mesh, smoothed):
        normal = torch.nn.functional.normalize(face_normals(mesh.vertices, mesh.faces), dim=1)
        first, second = edge_faces(mesh.faces).faces.unbind(1)
        turns.append(float((normal[first] * normal[second]).sum(1).clamp(-1, 1).acos().mean()))
    assert turns[1] < 0.9 * turns[0]
    assert float(smoothed.vertices.norm(dim=1).mean()) == pytest.approx(
        float(baked[0].mesh.vertices.norm(dim=1).mean()), rel=2e-3
    )


def test_a_texel_holds_the_material_of_its_point(model, baked):
    asset = baked[0]
    face, barycentric, texel = texel_points(asset.mesh, asset.textures.size)
    position = (asset.mesh.vertices[asset.mesh.faces[face].long()] * barycentric[..., None]).sum(1)
    with torch.no_grad():
        expected = model.material(position)
    torch.testing.assert_close(asset.textures.flat()[texel, :5], expected[:, :5])


def test_normals_in_tangent_space_are_the_bent_ones_in_the_world(model, baked):
    asset = baked[0]
    mesh, (face, barycentric, texel) = asset.mesh, texel_points(asset.mesh, asset.textures.size)
    position = (mesh.vertices[mesh.faces[face].long()] * barycentric[..., None]).sum(1)
    normal = (mesh.normals()[mesh.normal_index[face].long()] * barycentric[..., None]).sum(1)
    normal = torch.nn.functional.normalize(normal, dim=1)
    with torch.no_grad():
        bent = torch.nn.functional.normalize(normal + model.material(position)[:, 5:], dim=1)
    mapped = asset.textures.flat()[texel, 5:]
    tangent = (uv_tangents(mesh)[mesh.uv_faces[face].long()] * barycentric[..., None]).sum(1)
    tangent = torch.nn.functional.normalize(tangent - (tangent * normal).sum(1, keepdim=True) * normal, dim=1)
    torch.testing.assert_close(mapped[:, 2], (bent * normal).sum(1), atol=1e-4, rtol=0)
    torch.testing.assert_close(mapped[:, 0], (bent * tangent).sum(1), atol=1e-4, rtol=0)
    torch.testing.assert_close(mapped.norm(dim=1), torch.ones(len(mapped)))


def test_an_unwrapper_out_of_time_is_told(baked):
    asset, said = baked
    assert asset.textures.size == CONFIG.texture_size or "triangles on a grid" in said[0]
    assert asset.visibility is None


def test_small_pieces_are_no_surface(model, monkeypatch):
    nothing = np.zeros((0, 3), np.float32), np.zeros((0, 3), np.int32)
    monkeypatch.setattr(model, "extract", lambda: nothing)
    with pytest.raises(ConvergenceError, match="only small pieces"):
        bake(model, CONFIG, CPU, print)


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
