"""The scene that is shipped: complete, small, and true to its README."""

import json
from pathlib import Path

import numpy as np
import pytest

import demo_scene
import lightprobe
from demo_scene.files import read_exr, read_obj, read_png, srgb_decode
from demo_scene.lights import LARGEST, PHOTOGRAPHED, photographed_light

ROOT = Path(lightprobe.__path__[0]) / "assets" / "demo"
SPLITS = {
    name: json.loads((ROOT / f"transforms_{name}.json").read_text()) for name in ("train", "test", "relight")
}


def test_it_is_small():
    assert sum(path.stat().st_size for path in ROOT.rglob("*") if path.is_file()) <= 3_000_000


def test_there_are_enough_photos_each_under_its_own_light():
    assert len(SPLITS["train"]["frames"]) >= 48
    assert len(SPLITS["test"]["frames"]) >= 8
    lights = [
        (frame["hdri"], frame["hdri_shift_deg"])
        for name in ("train", "test")
        for frame in SPLITS[name]["frames"]
    ]
    assert len(set(lights)) == len(lights)
    names = {name: {frame["hdri"] for frame in scene["frames"]} for name, scene in SPLITS.items()}
    assert not names["train"] & names["test"]
    assert not names["relight"] & (names["train"] | names["test"])


def test_every_test_light_is_a_photographed_one():
    frames = SPLITS["test"]["frames"]
    assert {frame["hdri"] for frame in frames} == set(PHOTOGRAPHED)
    assert len(PHOTOGRAPHED) >= 2
    for index, frame in enumerate(frames):
        light = photographed_light(frame["hdri"], 7, 1000 + index)
        assert frame["hdri_shift_deg"] == light.shift_degrees
        np.testing.assert_allclose(
            read_exr(ROOT / frame["env_path"], "RGB"),
            np.minimum(light.radiance * frame["exposure"], LARGEST),
            rtol=1.05 * 2 ** -(light.bits + 1),  # rounded twice: to half, then to its bits
        )


def test_its_readme_is_the_generators():
    template = Path(demo_scene.__path__[0]) / "scene_readme.md"
    assert (ROOT / "README.md").read_text() == template.read_text()


def test_readmes_name_the_photographed_lights_and_their_licence():
    bundled, project = ((folder / "README.md").read_text() for folder in (ROOT, ROOT.parents[3]))
    assert all(name in bundled for name in PHOTOGRAPHED)
    assert "(src/lightprobe/assets/demo/README.md)" in project
    assert all(word in text for text in (bundled, project) for word in ("Poly Haven", "CC0"))


def test_every_named_file_is_there_and_no_other():
    named = {"README.md", "generation.json", "mesh.obj", *(f"transforms_{name}.json" for name in SPLITS)}
    for scene in SPLITS.values():
        for frame in scene["frames"]:
            named.add(frame["file_path"].removeprefix("./") + ".png")
            named |= {
                value.removeprefix("./")
                for key, value in frame.items()
                if key.endswith("_path") and "." in value[2:]
            }
    assert {str(path.relative_to(ROOT)) for path in ROOT.rglob("*") if path.is_file()} == named


@pytest.mark.parametrize("split", SPLITS)
def test_photos_show_the_whole_mesh_where_the_cameras_say(split):
    vertices, _ = read_obj(ROOT / "mesh.obj")
    side = SPLITS[split]["w"]
    focal = 0.5 * side / np.tan(0.5 * SPLITS[split]["camera_angle_x"])
    for frame in SPLITS[split]["frames"]:
        alpha = read_png(ROOT / f"{frame['file_path']}.png")[..., 3]
        assert alpha.shape == (side, side)
        assert max(edge.max() for edge in (alpha[0], alpha[-1], alpha[:, 0], alpha[:, -1])) == 0
        pose = np.array(frame["transform_matrix"])
        local = (vertices - pose[:3, 3]) @ pose[:3, :3]
        x, y = side / 2 - focal * local[:, 0] / local[:, 2], side / 2 + focal * local[:, 1] / local[:, 2]
        assert (alpha[y.astype(int), x.astype(int)] > 0).mean() > 0.995
        rows, columns = np.nonzero(alpha.max(axis=1) > 0)[0], np.nonzero(alpha.max(axis=0) > 0)[0]
        np.testing.assert_allclose(
            [rows[0], rows[-1] + 1, columns[0], columns[-1] + 1],
            [y.min(), y.max(), x.min(), x.max()],
            atol=1.5,
        )


def test_photos_are_their_linear_renders_clipped():
    for split in ("test", "relight"):
        for frame in SPLITS[split]["frames"]:
            photo, linear = (
                read_png(ROOT / f"{frame['file_path']}.png"),
                read_exr(ROOT / frame["hdr_path"], "RGBA"),
            )
            solid = linear[..., 3] > 0.999
            expected = np.clip(linear[solid][:, :3], 0, 1)
            np.testing.assert_allclose(srgb_decode(photo[solid][:, :3]), expected, atol=0.01)
