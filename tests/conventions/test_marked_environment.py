"""A light of six colours through every way out of the program: each colour must come from where it belongs.

The look-ups of Blender and three.js are written here from their own documentation, not from ours.
"""

import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
import OpenEXR
import pytest
import torch

from lightprobe.core.config.export import ColorSpace
from lightprobe.export import write_mesh
from lightprobe.export.ultra_hdr import write_ultra_hdr
from lightprobe.geometry.mesh import Mesh
from lightprobe.geometry.textures import Textures
from lightprobe.imaging import read_hdr
from lightprobe.light.environment import Environment
from lightprobe.render.asset import Asset
from tests.export.glb_reader import Glb
from tests.marked_light import COLORS, SIMILARITY, marked_cubemap
from tests.shapes import sphere_mesh

# From linear sRGB, as ACES' own configuration of OpenColorIO has it
TO_ACESCG = [[0.613097, 0.339523, 0.047379], [0.070194, 0.916354, 0.013452], [0.020616, 0.109570, 0.869815]]


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


def read_exr(path: Path) -> np.ndarray:
    """Return what OpenEXR's library reads, in linear sRGB."""
    file = OpenEXR.File(str(path))
    pixels = file.channels()["RGB"].pixels
    return pixels @ np.linalg.inv(TO_ACESCG).T if "chromaticities" in file.header() else pixels


def read_ultra_hdr(path: Path) -> np.ndarray:
    """Return what libultrahdr reads."""
    codecs = pytest.importorskip("imagecodecs")
    return codecs.ultrahdr_decode(path.read_bytes(), dtype="float16")[..., :3].astype(np.float32)


@pytest.fixture(scope="module")
def environment_files(tmp_path_factory) -> Path:
    folder, light = tmp_path_factory.mktemp("env"), Environment(marked_cubemap())
    light.save(folder / "marked.exr")
    light.save(folder / "marked.hdr")
    light.save(folder / "acescg.exr", color_space=ColorSpace.ACESCG)
    write_ultra_hdr(folder / "marked.jpg", light.panorama(64))
    return folder


@pytest.fixture(scope="module", params=["marked.exr", "marked.hdr", "acescg.exr", "marked.jpg"])
def written(request, environment_files) -> Callable[[np.ndarray, np.ndarray], None]:
    """Return a check that the map has a colour where a program looks it up."""
    path = environment_files / request.param
    readers = {".exr": read_exr, ".jpg": read_ultra_hdr, ".hdr": read_hdr}
    image = readers[path.suffix](path)
    close = 0.02 if path.suffix == ".jpg" else 1e-4

    def check(lookup: Callable, direction: np.ndarray, color: tuple[float, ...]) -> None:
        assert lookup(image, direction) == pytest.approx(color, rel=close)

    return check


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
def test_blender_sees_each_colour_where_it_belongs(written, axis):
    written(blender_lookup, np.array(axis, float), COLORS[axis])


def test_blender_lights_the_imported_mesh_from_the_right_sides(written, glb_directions):
    for spike in glb_directions:
        world = blender_import(spike)
        axis = tuple(int(v) for v in world.round())
        written(blender_lookup, world, COLORS[axis])


def test_three_js_lights_the_imported_mesh_from_the_right_sides(written, glb_directions):
    for spike in glb_directions:
        axis = tuple(int(v) for v in blender_import(spike).round())
        written(three_lookup, spike / np.linalg.norm(spike), COLORS[axis])


def test_between_the_axes_nothing_is_mirrored(written):
    """Off-axis directions tell a mirrored or turned map from a right one where the axes alone may not."""
    for x, y, z in ((0.8, 0.3, 0.1), (0.3, 0.8, -0.2), (-0.7, -0.4, 0.3), (0.1, -0.8, 0.3), (0.2, 0.3, 0.9)):
        direction = np.array([x, y, z]) / math.hypot(x, y, z)
        axis = max(COLORS, key=lambda a: float(np.dot(a, direction)))
        written(blender_lookup, direction, COLORS[axis])
        written(three_lookup, np.array([direction[0], direction[2], -direction[1]]), COLORS[axis])


@pytest.mark.parametrize("name", ["marked.exr", "marked.hdr", "acescg.exr"])
def test_the_map_reads_back_as_the_light_it_was(environment_files, name):
    again = Environment.load(environment_files / name, resolution=16).texels
    interior = again.reshape(6, 16, 16, 3)[:, 4:12, 4:12]
    assert torch.allclose(interior, marked_cubemap()[:, 4:12, 4:12], rtol=1e-3)
