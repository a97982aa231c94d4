import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest
import torch

from lightprobe.core.errors import InputError
from lightprobe.export import export, write_mesh
from lightprobe.geometry.mesh import vertex_normals
from lightprobe.light.environment import Environment
from lightprobe.models import Decomposition
from lightprobe.render.asset import Asset
from lightprobe.render.visibility import VertexVisibility
from tests.export.glb_reader import Glb
from tests.export.toy_asset import SIMILARITY, difficult_mesh, toy_textures
from tests.shapes import sphere_mesh

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    folder = tmp_path_factory.mktemp("glb")
    asset = Asset(difficult_mesh(), toy_textures())
    write_mesh(asset, SIMILARITY, folder / "mesh.glb")
    return asset, folder


@pytest.fixture(scope="module")
def glb(written):
    return Glb((written[1] / "mesh.glb").read_bytes())


def test_vectors_are_unit_and_tangents_orthogonal(glb):
    normals, tangents = glb.attribute("NORMAL"), glb.attribute("TANGENT")
    assert np.abs(np.linalg.norm(normals, axis=1) - 1).max() < 1e-6
    assert np.abs(np.linalg.norm(tangents[:, :3], axis=1) - 1).max() < 1e-6
    assert np.abs((normals * tangents[:, :3]).sum(1)).max() < 1e-6
    assert set(np.unique(tangents[:, 3])) == {-1.0, 1.0}


def test_every_array_is_finite_and_has_one_row_per_vertex(glb):
    arrays = [glb.attribute(name) for name in ("POSITION", "NORMAL", "TANGENT", "TEXCOORD_0")]
    assert len({len(array) for array in arrays}) == 1
    assert all(np.isfinite(array).all() for array in arrays)
    assert glb.faces().max() < len(arrays[0])
    assert len(np.unique(glb.faces())) == len(arrays[0])


def test_positions_are_the_users_turned_y_up(written, glb):
    mesh = written[0].mesh
    x, y, z = SIMILARITY.invert(mesh.vertices.numpy())[mesh.faces.numpy().ravel()].T
    expected = np.stack([x, z, -y], axis=1)
    assert np.abs(glb.positions()[glb.faces().ravel()] - expected).max() < 1e-5


def test_corners_keep_their_texture_coordinates_and_normals(written, glb):
    mesh = written[0].mesh
    expected = mesh.uvs.numpy()[mesh.uv_faces.numpy().ravel()]
    assert np.array_equal(glb.attribute("TEXCOORD_0")[glb.faces().ravel()], expected)
    x, y, z = vertex_normals(mesh.vertices, mesh.faces).numpy()[mesh.faces.numpy()[:-1].ravel()].T
    found = glb.attribute("NORMAL")[glb.faces()[:-1].ravel()]
    assert np.abs(found - np.stack([x, z, -y], axis=1)).max() < 1e-5


def test_normal_map_means_in_gltf_what_it_means_in_the_renderer(written, glb):
    """The bitangent w (n x t) points up in the picture (towards -v), as in glTF and Blender's MikkTSpace."""
    position, uv, faces = glb.attribute("POSITION").astype(float), glb.attribute("TEXCOORD_0"), glb.faces()
    normals, tangents = glb.attribute("NORMAL"), glb.attribute("TANGENT")
    bitangent = np.cross(normals, tangents[:, :3]) * tangents[:, 3:]
    e1, e2 = position[faces[:, 1]] - position[faces[:, 0]], position[faces[:, 2]] - position[faces[:, 0]]
    (u1, v1), (u2, v2) = (uv[faces[:, 1]] - uv[faces[:, 0]]).T, (uv[faces[:, 2]] - uv[faces[:, 0]]).T
    det = u1 * v2 - u2 * v1
    usable = np.abs(det) > 1e-9
    along_v = (e2 * u1[:, None] - e1 * u2[:, None])[usable] / det[usable, None]
    along_u = (e1 * v2[:, None] - e2 * v1[:, None])[usable] / det[usable, None]
    first = faces[usable, 0]
    assert ((along_u * tangents[first, :3]).sum(1) > 0).all()
    assert ((along_v * bitangent[first]).sum(1) < 0).all()


def test_pictures_hold_the_material(written, glb):
    textures = written[0].textures
    color, orm, normal = (glb.picture(i).astype(float) / 255 for i in range(3))
    linear = np.where(color <= 0.04045, color / 12.92, ((color + 0.055) / 1.055) ** 2.4)
    assert np.abs(linear - textures.base_color.numpy()).max() < 0.006
    assert np.abs(orm[..., 1] - textures.roughness.numpy()).max() < 0.003
    assert np.abs(orm[..., 2] - textures.metallic.numpy()).max() < 0.003
    assert (orm[..., 0] == 1).all()
    assert np.abs(normal * 2 - 1 - textures.normal.numpy()).max() < 0.005
    material = glb.document["materials"][0]
    assert material["pbrMetallicRoughness"]["baseColorTexture"]["index"] == 0
    assert material["pbrMetallicRoughness"]["metallicRoughnessTexture"]["index"] == 1
    assert material["normalTexture"]["index"] == 2
    assert material["occlusionTexture"]["index"] == 1


def test_occlusion_is_dark_where_the_object_blocks_the_light(tmp_path):
    mesh = sphere_mesh(2)
    table = torch.full((len(mesh.vertices), 384), 255, dtype=torch.uint8)
    table[mesh.vertices[:, 2] > 0] = 0
    around = VertexVisibility(table, torch.zeros(len(table), 3))
    write_mesh(Asset(mesh, toy_textures(128), around), SIMILARITY, tmp_path / "mesh.glb")
    occlusion = Glb((tmp_path / "mesh.glb").read_bytes()).picture(1)[..., 0] / 255
    assert occlusion.min() == 0
    assert occlusion.max() == 1
    assert 0.3 < occlusion.mean() < 0.7


def test_loose_textures_are_the_embedded_ones(written, glb):
    for i, name in enumerate(("base_color", "orm", "normal")):
        view = glb.document["images"][i]["bufferView"]
        assert (written[1] / f"{name}.png").read_bytes() == glb.view(view)


def test_another_reader_sees_the_same_object(written):
    import trimesh

    loaded = trimesh.load(written[1] / "mesh.glb", force="mesh")
    center = np.array([SIMILARITY.center[0], SIMILARITY.center[2], -SIMILARITY.center[1]])
    distance = np.linalg.norm(loaded.vertices - center, axis=1)
    assert distance[distance < 1].min() > 0.499
    assert loaded.visual.material.baseColorTexture.size == (32, 32)


@pytest.mark.skipif(
    shutil.which("node") is None or not (ROOT / "node_modules" / "gltf-validator").is_dir(),
    reason="needs node and `npm install --no-save gltf-validator`",
)
def test_khronos_validator_has_nothing_to_say(written):
    command = ["node", "tools/validate_glb.mjs", str(written[1] / "mesh.glb")]
    result = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
    assert result.returncode == 0, result.stdout + result.stderr


def test_a_light_whose_name_is_a_path_is_refused_before_anything_is_written(tmp_path):
    asset = Asset(sphere_mesh(1), toy_textures(8))
    (tmp_path / "precious.exr").write_bytes(b"mine")
    for name in ("../../precious", str(tmp_path / "precious"), ".."):
        light = Environment(torch.ones(6, 8, 8, 3))
        with pytest.raises(InputError, match="plain name"):
            export(Decomposition(asset, {}, SIMILARITY), tmp_path / "out", {name: light})
    assert [path.name for path in tmp_path.iterdir()] == ["precious.exr"]
    assert (tmp_path / "precious.exr").read_bytes() == b"mine"
