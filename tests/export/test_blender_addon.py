"""The add-on in Blender itself: mesh, world and lamps lie where the user's photos have them, as bright."""

import importlib.util
import json
import math
import os
import subprocess
import sys
from importlib import resources
from pathlib import Path

import numpy as np
import pytest
import torch

from lightprobe.core.config.export import ColorSpace
from lightprobe.export import SceneLight, export, write_mesh
from lightprobe.geometry.textures import Textures
from lightprobe.light import cubemap
from lightprobe.light.environment import Environment
from lightprobe.light.sources import LightSource
from lightprobe.models import Decomposition
from lightprobe.render.asset import Asset
from tests.marked_light import SIMILARITY, marked_cubemap
from tests.shapes import sphere_mesh

SCRIPT = Path(__file__).with_name("blender_scene.py")
TOLD = {"format": "lightprobe light", "version": 1}
LAMP = {
    "direction": [0, 0, 2],
    "angular_radius_deg": 0.5,
    "irradiance_rgb": [2.0, 1.0, 0.5],
    "uncertainty": 0.1,
}
ROOT = Path(__file__).parents[2]


def blender_python() -> str | None:
    """Return a Python that has bpy: named by LIGHTPROBE_BPY, installed by .ci/test_tools, or this one."""
    chosen, installed = os.environ.get("LIGHTPROBE_BPY"), ROOT / "build" / "bpy" / "bin" / "python"
    if chosen or installed.is_file():
        return chosen or str(installed)
    return sys.executable if importlib.util.find_spec("bpy") else None


pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(
        blender_python() is None, reason="needs bpy; name a Python that has it in LIGHTPROBE_BPY"
    ),
]


def in_blender(folder: Path, *files: str, **given) -> dict:
    """Import files through the add-on and return what is in Blender then."""
    addon = resources.files("lightprobe") / "assets" / "blender" / "lightprobe_import.py"
    with resources.as_file(addon) as addon:
        given |= {"addon": str(addon), "folder": str(folder), "files": files}
        command = [blender_python(), str(SCRIPT), json.dumps(given)]
        done = subprocess.run(command, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout.strip().splitlines()[-1])


def white_ball() -> Asset:
    one, up = torch.ones(8, 8), torch.tensor([0.0, 0.0, 1.0]).expand(8, 8, 3)
    return Asset(sphere_mesh(3), Textures(torch.ones(8, 8, 3), one, 0 * one, up))


@pytest.fixture(scope="module")
def exported(tmp_path_factory):
    """A white matte ball, as `lightprobe export` writes it, with a light of six colours in env/."""
    folder = tmp_path_factory.mktemp("exported")
    write_mesh(white_ball(), SIMILARITY, folder / "mesh.glb")
    Environment(marked_cubemap()).save(folder / "env" / "six.exr")
    return folder


def seen_from(direction: tuple[float, ...]) -> list[float]:
    """Return where a camera stands that the ball fills more than the middle of the picture of."""
    away = np.array(direction) / np.linalg.norm(direction)
    return (SIMILARITY.center + 4 * SIMILARITY.scale * away).tolist()


def received(light: torch.Tensor, normal: tuple[float, ...]) -> np.ndarray:
    """Return the irradiance (3,) of a surface under a light (6, R, R, 3)."""
    n = torch.nn.functional.normalize(torch.tensor(normal), dim=0)
    size = light.shape[1]
    weight = (cubemap.directions(size) @ n).clamp(min=0) * cubemap.solid_angles(size)
    return (light * weight[..., None]).sum((0, 1, 2)).numpy()


def assert_lambert(pixel: list[float], irradiance: np.ndarray) -> None:
    """Check the radiance of a white matte surface, less what its varnish of F0 = .04 keeps."""
    share = math.pi * np.array(pixel) / irradiance
    assert share.min() > 0.8, share
    assert share.max() < 1.05, share


def light_file(path: Path, sun: str, **changed) -> None:
    path.write_text(json.dumps({**TOLD, "map": {"sun": sun}, "sources": [LAMP | changed]}))


def test_mesh_and_world_are_in_the_user_s_frame(exported):
    center = SIMILARITY.center
    normals = {"side": (2.0, -1.0, 0.5), "top": (0.3, 0.2, 1.0)}  # tell all mirrors apart
    views = {name: seen_from(normal) for name, normal in normals.items()}
    found = in_blender(exported, "mesh.glb", views=views, target=center.tolist(), side=9)
    assert found["result"] == ["FINISHED"]
    assert found["low"] == pytest.approx(center - SIMILARITY.scale, abs=0.05)
    assert found["high"] == pytest.approx(center + SIMILARITY.scale, abs=0.05)
    assert found["map"] == [str(exported / "env" / "six.exr")]
    assert found["lamps"] == []
    assert (found["view_transform"], found["distributions"]) == ("Standard", ["GGX"])
    for name, normal in normals.items():
        assert_lambert(found["pixels"][name], received(marked_cubemap(), normal))


def test_a_map_in_acescg_is_as_coloured_as_one_in_srgb(exported, tmp_path):
    light, normal = Environment(marked_cubemap()), (2.0, -1.0, 0.5)
    (tmp_path / "mesh.glb").write_bytes((exported / "mesh.glb").read_bytes())
    light.save(tmp_path / "light.exr", color_space=ColorSpace.ACESCG)
    view = {"side": seen_from(normal)}
    found = in_blender(tmp_path, "mesh.glb", views=view, target=SIMILARITY.center.tolist(), side=9)
    usual = in_blender(exported, "mesh.glb", views=view, target=SIMILARITY.center.tolist(), side=9)
    assert found["map"] == [str(tmp_path / "light.exr")]
    assert found["pixels"]["side"] == pytest.approx(usual["pixels"]["side"], rel=0.01)


def test_lamps_shine_from_where_the_file_says_as_bright_as_it_says(exported):
    Environment(torch.zeros(6, 8, 8, 3)).save(exported / "dark.exr")
    light_file(exported / "dark.light.json", "separate")
    center = SIMILARITY.center
    given = {"views": {"above": seen_from((0, 0, 1))}, "target": center.tolist(), "side": 9}
    found = in_blender(exported, "mesh.glb", "dark.exr", **given)
    lamp = found["lamps"][0]
    assert lamp["towards"] == pytest.approx([0, 0, 1], abs=1e-5)
    assert lamp["angle"] == pytest.approx(math.radians(1))
    assert np.multiply(lamp["energy"], lamp["color"]) == pytest.approx([2, 1, 0.5])
    assert_lambert(found["pixels"]["above"], np.array([2, 1, 0.5]))


def test_lamps_that_the_glb_has_too_shine_once(tmp_path):
    lamp = LightSource((0.0, 0.6, 0.8), math.radians(3), (2.0, 1.0, 0.5))
    decomposition = Decomposition(white_ball(), {}, SIMILARITY)
    export(decomposition, tmp_path, {}, light=SceneLight(np.ones((64, 128, 3), np.float32), (lamp,)))
    ways = (in_blender(tmp_path, "scene.glb", with_light=given) for given in (True, False))
    (found,), (alone,) = (way["lamps"] for way in ways)
    assert found["angle"] == pytest.approx(math.radians(6), abs=1e-5)
    for one_lamp in (found, alone):  # that of the file beside the map, and the GLB's own
        assert one_lamp["towards"] == pytest.approx(lamp.direction, abs=1e-5)
        assert np.multiply(one_lamp["energy"], one_lamp["color"]) == pytest.approx(lamp.irradiance)


def test_what_is_in_the_map_is_not_lit_twice_and_a_bad_file_says_so(exported):
    for name, sun, changed in (
        ("inside", "inside", {}),
        ("bad", "separate", {"irradiance_rgb": ["much", 1, 1]}),
    ):
        Environment(torch.ones(6, 8, 8, 3)).save(exported / f"{name}.exr")
        light_file(exported / f"{name}.light.json", sun, **changed)
    assert in_blender(exported, "inside.exr")["lamps"] == []
    found = in_blender(exported, "mesh.glb", "bad.exr")
    assert "bad.light.json is no light file" in found["error"]
    assert found["objects"] == 0  # told before the mesh is imported
    (exported / "bad.light.json").write_text(json.dumps({**TOLD, "version": 2, "map": {"sun": "separate"}}))
    assert "no light file of version 1" in in_blender(exported, "bad.exr")["error"]
    assert "Choose a .glb file" in in_blender(exported, "mesh.txt")["error"]


def test_another_light_takes_the_lamps_of_the_one_before_away(exported):
    for name, sun in (("bare", "separate"), ("full", "inside")):
        Environment(torch.ones(6, 8, 8, 3)).save(exported / f"{name}.exr")
        light_file(exported / f"{name}.light.json", sun)
    assert len(in_blender(exported, "bare.exr", then=[["bare.exr"]])["lamps"]) == 1
    assert in_blender(exported, "bare.exr", then=[["full.exr"]])["lamps"] == []


def test_another_scene_of_the_file_keeps_its_lamps(exported):
    Environment(torch.ones(6, 8, 8, 3)).save(exported / "bare.exr")
    light_file(exported / "bare.light.json", "separate")
    assert in_blender(exported, "bare.exr", then=[["new scene"], ["bare.exr"]])["lamps_by_scene"] == [1, 1]


def test_a_light_file_of_the_other_format_s_map_brings_no_lamps(exported):
    Environment(torch.ones(6, 8, 8, 3)).save(exported / "two.exr")
    told = {**TOLD, "map": {"file": "two.hdr", "copies": [], "sun": "separate"}, "sources": [LAMP]}
    (exported / "two.light.json").write_text(json.dumps(told))
    assert in_blender(exported, "two.exr")["lamps"] == []
    told["map"]["copies"] = ["two.exr"]
    (exported / "two.light.json").write_text(json.dumps(told))
    assert len(in_blender(exported, "two.exr")["lamps"]) == 1
