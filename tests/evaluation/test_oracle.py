"""The known object of `tests.known_scene`, gathered again from its own truth maps."""

import dataclasses

import numpy as np
import pytest
import torch

from lightprobe.core.errors import InputError
from lightprobe.evaluation.oracle import can_be_oracle, oracle_decomposition
from lightprobe.render.asset import rasterize_asset
from lightprobe.scene.photo import Scene
from tests.known_scene import CPU, SIMILARITY, known_decomposition, write_photo

AROUND = {"a": (3, 1, 1), "bb": (-1, 3, 0.5), "ccc": (-2, -2, -1.5), "dddd": (1, -1, -3), "eeeee": (0.5, 0.5, 3)}


@pytest.fixture(scope="module")
def scene(tmp_path_factory):
    folder, decomposition = tmp_path_factory.mktemp("oracle"), known_decomposition()
    photos = tuple(write_photo(folder, name, decomposition, place) for name, place in AROUND.items())
    vertices = SIMILARITY.invert(decomposition.asset.mesh.vertices.numpy())
    lines = [f"v {x} {y} {z}" for x, y, z in vertices]
    lines += [f"f {a + 1} {b + 1} {c + 1}" for a, b, c in decomposition.asset.mesh.faces.tolist()]
    (folder / "mesh.obj").write_text("\n".join(lines))
    return Scene(folder, "transforms", photos[:1], photos, (), SIMILARITY)


@pytest.fixture(scope="module")
def oracle(scene, tmp_path_factory):
    wrong = dataclasses.replace(known_decomposition(), asset=None)  # nothing of the run's own object is looked at
    return oracle_decomposition(wrong, scene, tmp_path_factory.mktemp("kept") / "asset.safetensors")


def test_the_true_object_is_found_again(oracle, scene):
    """RasterisedView from a camera that no photo has, in every channel that shading uses."""
    camera = dataclasses.replace(scene.test[0].camera).normalised(SIMILARITY)
    pose = camera.camera_to_world.copy()
    turn = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])
    pose[:3] = turn @ pose[:3]
    camera = dataclasses.replace(camera, camera_to_world=pose)
    mine, true = (rasterize_asset(asset, camera, CPU) for asset in (oracle.asset, known_decomposition().asset))
    common = np.intersect1d(mine.pixel.numpy(), true.pixel.numpy())
    assert len(common) > 0.97 * len(true.pixel)
    a, b = (g.select(torch.from_numpy(np.searchsorted(g.pixel.numpy(), common))) for g in (mine, true))
    for name, tolerance in (("base_color", 0.02), ("roughness", 0.02), ("metallic", 0.01), ("position", 0.01)):
        assert float((getattr(a, name) - getattr(b, name)).abs().mean()) < tolerance, name
    angle = torch.rad2deg(torch.acos((a.normal * b.normal).sum(1).clamp(-1, 1)))
    assert float(angle.mean()) < 2
    assert oracle.asset.visibility is not None


def test_it_is_made_once_and_kept(oracle, scene, tmp_path):
    kept = tmp_path / "asset.safetensors"
    oracle.asset.save(kept)
    (scene.root / "mesh.obj").rename(scene.root / "hidden.obj")
    try:
        assert not can_be_oracle(scene)
        with pytest.raises(InputError, match=r"no mesh\.obj"):
            oracle_decomposition(known_decomposition(), scene)
    finally:
        (scene.root / "hidden.obj").rename(scene.root / "mesh.obj")
    again = oracle_decomposition(known_decomposition(), scene, kept)
    assert torch.equal(again.asset.textures.base_color, oracle.asset.textures.base_color)
    assert list(again.lights) == ["light"]


def test_a_mesh_in_another_frame_or_none_at_all_is_noticed(scene, tmp_path):
    moved = dataclasses.replace(scene, root=tmp_path)
    (tmp_path / "mesh.obj").write_text("v 90 0 0\nv 90 1 0\nv 90 0 1\nf 1 2 3\n")
    with pytest.raises(InputError, match="one frame"):
        oracle_decomposition(known_decomposition(), moved)
    (tmp_path / "mesh.obj").write_text("v one two three\nf 1 1 1\n")
    with pytest.raises(InputError, match="cannot be read as a mesh"):
        oracle_decomposition(known_decomposition(), moved)
