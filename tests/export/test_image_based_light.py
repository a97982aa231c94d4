"""The map in scene.glb, as Babylon.js loads it and its shaders look it up."""

import base64
import io
import json
import math
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest
import torch
from PIL import Image

from lightprobe.export import SceneLight, export
from lightprobe.export.image_based_light import LEVELS, SIDE, ImageBasedLight
from lightprobe.light import equirect
from lightprobe.light.environment import Environment
from lightprobe.models import Decomposition
from lightprobe.render.asset import Asset
from tests.export.toy_asset import SIMILARITY, difficult_mesh, toy_textures
from tests.marked_light import COLORS, marked_cubemap

ROOT, SCRIPT = Path(__file__).parents[2], Path(__file__).with_name("babylon_light.mjs")
SPOT = (slice(10, 14), slice(40, 48))  # rows and columns
OBLIQUE = ((0.8, 0.3, 0.1), (0.3, 0.8, -0.2), (-0.7, -0.4, 0.3), (0.1, -0.8, 0.3), (0.2, 0.3, 0.9))
# OpenGL's specification, table 8.19: of each face the axes of s and t, as rows to multiply a direction by
FACES = {
    (0, 1): ((0, 0, -1), (0, -1, 0)),
    (0, -1): ((0, 0, 1), (0, -1, 0)),
    (1, 1): ((1, 0, 0), (0, 0, 1)),
    (1, -1): ((1, 0, 0), (0, 0, -1)),
    (2, 1): ((1, 0, 0), (0, -1, 0)),
    (2, -1): ((-1, 0, 0), (0, -1, 0)),
}


class Seen:
    """A light as Babylon.js' materials see it."""

    def __init__(self, glb: Path):
        done = subprocess.run(["node", SCRIPT, glb], capture_output=True, text=True, timeout=120)
        assert done.returncode == 0, done.stderr
        told = json.loads(done.stdout.splitlines()[-1])  # after its greeting
        self.levels = [[self._decoded(face) for face in faces] for faces in told["levels"]]
        self.intensity, self.harmonics, self.meshes = told["intensity"], told["harmonics"], told["meshes"]
        self._turns = [np.reshape(told[name], (4, 4))[:3, :3] for name in ("world", "turn")]  # of row vectors
        self._mirror = np.array([1, 1, -1 if told["opposite_z"] else 1])

    @staticmethod
    def _decoded(png: str) -> np.ndarray:
        """Its fromRGBD: to linear by a power of 2.2, over the fourth channel."""
        values = np.asarray(Image.open(io.BytesIO(base64.b64decode(png))), np.float64) / 255
        return values[..., :3] ** 2.2 / values[..., 3:]

    def _local(self, direction) -> np.ndarray:
        """Turn a direction of the user's z-up frame as glTF, the loader and its reflection shader do."""
        x, y, z = direction
        return np.array([x, z, -y]) @ self._turns[0] @ self._turns[1] * self._mirror

    def radiance(self, direction, level: int = 0) -> np.ndarray:
        local = self._local(direction)
        axis = int(np.abs(local).argmax())
        sign = 1 if local[axis] > 0 else -1
        s, t = (0.5 + 0.5 * np.dot(row, local) / abs(local[axis]) for row in FACES[axis, sign])
        face = self.levels[level][list(FACES).index((axis, sign))]
        places = np.array([t, s]) * len(face) - 0.5  # bilinear, as textures are filtered
        (y, x), (down, across) = np.floor(places).astype(int), places % 1
        upper, lower = (face[row, x] + across * (face[row, x + 1] - face[row, x]) for row in (y, y + 1))
        return self.intensity * (upper + down * (lower - upper))

    def irradiance_over_pi(self, direction) -> np.ndarray:
        """Its computeEnvironmentIrradiance; the factors of the functions are in the harmonics already."""
        x, y, z = self._local(direction)
        functions = [1, y, z, x, y * x, y * z, 3 * z * z - 1, z * x, x * x - y * y]
        return np.array(functions) @ np.array(self.harmonics)


def seen(folder: Path, image: np.ndarray) -> Seen:
    asset = Asset(difficult_mesh(), toy_textures(8))
    export(Decomposition(asset, {}, SIMILARITY), folder, {}, light=SceneLight(image, ()))
    return Seen(folder / "scene.glb")


def sky(scale: float = 1.0) -> np.ndarray:
    """A map whose red rises with x, green with y and blue with z."""
    return scale * (1 + 0.5 * equirect.directions(64).numpy()).astype(np.float32)


babylon = pytest.mark.skipif(
    shutil.which("node") is None or not (ROOT / "node_modules" / "@babylonjs" / "loaders").is_dir(),
    reason="needs node and Babylon.js: CI=true sh .ci/test_tools",
)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:light.jpg holds radiance")
@babylon
def test_each_colour_and_a_lamp_come_from_where_they_belong(tmp_path):
    image = Environment(marked_cubemap(32)).panorama()
    image[SPOT] = (30.0, 20.0, 10.0)
    light = seen(tmp_path, image)
    assert light.meshes == 2  # the loader's root, and the object
    assert [len(faces[0]) for faces in light.levels] == [SIDE >> level for level in range(LEVELS)]
    for axis, color in COLORS.items():
        assert light.radiance(axis) == pytest.approx(color, rel=0.02)
    for direction in OBLIQUE:
        nearest = max(COLORS, key=lambda axis: float(np.dot(axis, direction)))
        assert light.radiance(direction) == pytest.approx(COLORS[nearest], rel=0.02)
    towards = equirect.directions(64)[SPOT].reshape(-1, 3).mean(0)
    assert light.radiance(towards.tolist()) == pytest.approx([30.0, 20.0, 10.0], rel=0.02)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:light.jpg holds radiance")
@babylon
@pytest.mark.parametrize("scale", [1e-3, 1.0, 1e4])
def test_irradiance_and_rough_levels_are_those_of_the_light(tmp_path, scale):
    light, texels = seen(tmp_path, sky(scale)), torch.from_numpy(sky(scale)).double()
    towards, angle = equirect.directions(64).double(), equirect.solid_angles(64)[..., None]
    for direction in (*COLORS, *OBLIQUE):
        n = torch.nn.functional.normalize(torch.tensor(direction).double(), dim=0)
        cosine = (towards @ n).clamp(min=0)[..., None]
        true = ((texels * cosine * angle).sum((0, 1)) / math.pi).numpy()
        assert light.irradiance_over_pi(n.tolist()) == pytest.approx(true, rel=0.02)
        assert light.radiance(n.tolist(), LEVELS - 1) == pytest.approx(
            true, rel=0.02
        )  # roughness 1: a cosine
    sides = [light.radiance((1, 0, 0), level)[0] for level in range(LEVELS)]
    assert sides == sorted(sides, reverse=True)


def test_a_black_map_has_black_faces_and_no_irradiance():
    light = ImageBasedLight.of(np.zeros((64, 128, 3), np.float32))
    assert light.intensity == 1
    assert np.abs(light.irradiance).max() == 0
    face = np.asarray(Image.open(io.BytesIO(light.faces[0][0])))
    assert face.shape == (SIDE, SIDE, 4)
    assert face[..., :3].max() == 0
    assert face[..., 3].min() == 255
