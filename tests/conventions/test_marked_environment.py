"""A light of six colours through every way out of the program: each colour must come from where it belongs.

The look-ups of Blender and three.js are written here from their own documentation, not from ours.
"""

import math

import numpy as np
import pytest
import torch

from lightprobe.export import write_mesh
from lightprobe.geometry.mesh import Mesh
from lightprobe.geometry.textures import Textures
from lightprobe.imaging import read_hdr
from lightprobe.light.environment import Environment
from lightprobe.render.asset import Asset
from tests.export.glb_reader import Glb
from tests.marked_light import COLORS, SIMILARITY, marked_cubemap
from tests.shapes import sphere_mesh


def blender_lookup(image: np.ndarray, direction: np.ndarray) -> np.ndarray:
    """Blender's Environment Texture, equirectangular: u = -atan2(y, x) / 2 pi + 1/2, v = atan2(z, |xy|) / pi
    + 1/2.

    u runs to the right and v upwards over the picture; the frame is Blender's, z up.
    """
    x, y, z = direction
    u = -math.atan2(y, x) / (2 * math.pi) + 0.5
    v = math.atan2(z, math.hypot(x, y)) / math.pi + 0.5
    return texel(image, u, 1 - v)


def three_lookup(image: np.ndarray, direction: np.ndarray) -> np.ndarray:
    """three.js' equirectUv: u = atan(dir.z, dir.x) / 2 pi + 1/2, v = asin(dir.y) / pi + 1/2; y up, v upwards."""
    x, y, z = direction
    return texel(image, math.atan2(z, x) / (2 * math.pi) + 0.5, 1 - (math.asin(y) / math.pi + 0.5))


def texel(image: np.ndarray, across: float, down: float) -> np.ndarray:
    height, width = image.shape[:2]
    return image[min(int(down * height), height - 1), int(across * width) % width]


def blender_import(position: np.ndarray) -> np.ndarray:
    """Blender's glTF importer turns (x, y, z) into (x, -z, y)."""
    return np.array([position[0], -position[2], position[1]])


@pytest.fixture(scope="module", params=[".exr", ".hdr"])
def environment_file(request, tmp_path_factory):
    path = tmp_path_factory.mktemp("env") / f"marked{request.param}"
    Environment(marked_cubemap()).save(path)
    return path


@pytest.fixture(scope="module")
def glb_directions(tmp_path_factory):
    """For each axis of the user's frame, where the GLB has the vertex there, seen from the object's centre."""
    ball = sphere_mesh(2)
    axes = torch.tensor(list(COLORS), dtype=torch.float32)
    vertices = ball.vertices.clone()
    nearest = (ball.vertices @ axes.T).argmax(0)
    vertices[nearest] = 2.0 * axes  # a spike along every axis, the longest of all
    mesh = Mesh(vertices, ball.faces, ball.uvs, ball.uv_faces)
    flat = torch.ones(8, 8)
    up = torch.tensor([0.0, 0.0, 1.0]).expand(8, 8, 3)
    path = tmp_path_factory.mktemp("glb") / "spikes.glb"
    write_mesh(Asset(mesh, Textures(torch.ones(8, 8, 3), flat, 0 * flat, up)), SIMILARITY, path)
    positions = np.unique(Glb(path.read_bytes()).positions(), axis=0)
    x, y, z = SIMILARITY.center
    spikes = positions - np.array([x, z, -y])
    spikes = spikes[np.linalg.norm(spikes, axis=1) > 1.5 * SIMILARITY.scale]
    assert len(spikes) == 6
    return spikes / np.linalg.norm(spikes, axis=1, keepdims=True)


@pytest.mark.parametrize("axis", COLORS)
def test_blender_sees_each_colour_where_it_belongs(environment_file, axis):
    found = blender_lookup(read_hdr(environment_file), np.array(axis, float))
    assert found == pytest.approx(COLORS[axis], rel=1e-4)


def test_blender_lights_the_imported_mesh_from_the_right_sides(environment_file, glb_directions):
    image = read_hdr(environment_file)
    for spike in glb_directions:
        world = blender_import(spike)
        axis = tuple(int(v) for v in world.round())
        assert blender_lookup(image, world) == pytest.approx(COLORS[axis], rel=1e-4)


def test_three_js_lights_the_imported_mesh_from_the_right_sides(environment_file, glb_directions):
    image = read_hdr(environment_file)
    for spike in glb_directions:
        axis = tuple(int(v) for v in blender_import(spike).round())
        assert three_lookup(image, spike / np.linalg.norm(spike)) == pytest.approx(COLORS[axis], rel=1e-4)


def test_between_the_axes_nothing_is_mirrored(environment_file):
    """Off-axis directions tell a mirrored or turned map from a right one where the axes alone may not."""
    image = read_hdr(environment_file)
    for x, y, z in ((0.8, 0.3, 0.1), (0.3, 0.8, -0.2), (-0.7, -0.4, 0.3), (0.1, -0.8, 0.3), (0.2, 0.3, 0.9)):
        direction = np.array([x, y, z]) / math.hypot(x, y, z)
        axis = max(COLORS, key=lambda a: float(np.dot(a, direction)))
        assert blender_lookup(image, direction) == pytest.approx(COLORS[axis], rel=1e-4)
        assert three_lookup(image, np.array([direction[0], direction[2], -direction[1]])) == pytest.approx(
            COLORS[axis], rel=1e-4
        )


def test_the_map_reads_back_as_the_light_it_was(environment_file):
    again = Environment.load(environment_file, resolution=16).texels
    interior = again.reshape(6, 16, 16, 3)[:, 4:12, 4:12]
    assert torch.allclose(interior, marked_cubemap()[:, 4:12, 4:12], rtol=1e-3)
