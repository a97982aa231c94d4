"""One world written in every layout: the cameras must come back the same, and the marks must lie where they
belong.
"""

import json

import numpy as np
import pytest

from lightprobe.scene import load_pixels, load_scene
from tests.scene.worlds import BALLS, LAYOUTS, MIDDLE, expected_camera, views, write_nerfstudio


@pytest.fixture(scope="module", params=LAYOUTS)
def loaded(request, tmp_path_factory):
    root, shots = LAYOUTS[request.param](tmp_path_factory.mktemp(request.param) / "scene")
    return request.param, load_scene(root), shots


def photos_in_order(layout, scene):
    """Return the photos in the order of the views they were made from."""
    if layout == "blender":
        return [*sorted(scene.train, key=lambda p: int(p.name.rsplit("_", 1)[1])), *scene.test]
    return sorted((*scene.train, *scene.test), key=lambda p: p.name)


def test_cameras_come_back_identical(loaded):
    layout, scene, shots = loaded
    photos = photos_in_order(layout, scene)
    assert len(photos) == len(shots) == 18
    for photo, view in zip(photos, shots, strict=True):
        expected = expected_camera(view)
        np.testing.assert_allclose(photo.camera.camera_to_world, expected.camera_to_world, atol=1e-12)
        found = [getattr(photo.camera, key) for key in ("fx", "fy", "cx", "cy", "width", "height")]
        assert found == pytest.approx(
            [getattr(expected, key) for key in ("fx", "fy", "cx", "cy", "width", "height")]
        )


def test_projections_agree_with_opencv(loaded):
    layout, scene, shots = loaded
    for photo, view in zip(photos_in_order(layout, scene), shots, strict=True):
        for center, _, _ in BALLS:
            u, v, depth = photo.camera.project(np.array([center]))[0]
            assert (u, v) == pytest.approx(view.project(center), abs=1e-9)
            assert depth > 0


def test_marks_are_seen_where_the_camera_puts_them(loaded):
    """The ball nearest to the camera is seen at its own centre, in its colour; all masks contain it."""
    _, scene, _ = loaded
    for photo in (*scene.train, *scene.test):
        pixels, camera = load_pixels(photo)
        center, _, color = min(BALLS, key=lambda ball: np.linalg.norm(ball[0] - camera.position) - ball[1])
        u, v, _ = camera.project(np.array([center]))[0]
        if not (0 <= u < camera.width and 0 <= v < camera.height):
            continue
        assert pixels.alpha[int(v), int(u)] == 1
        np.testing.assert_allclose(pixels.color[int(v), int(u)], np.array(color) / 255, atol=0.05)


def test_split(loaded):
    layout, scene, _ = loaded
    if layout == "blender":
        assert (len(scene.train), len(scene.test)) == (15, 3)
        assert all(photo.name.startswith("test_") for photo in scene.test)
    else:
        assert [photo.name for photo in scene.test] == ["view_00", "view_16"]  # every 16th of the sorted list
        assert len(scene.train) == 16
    assert scene.relight == ()


def test_similarity_centres_the_object_with_radius_one(loaded):
    _, scene, _ = loaded
    farthest = max(np.linalg.norm(np.array(center) - MIDDLE) + radius for center, radius, _ in BALLS)
    np.testing.assert_allclose(scene.similarity.center, MIDDLE, atol=0.07)
    assert scene.similarity.scale == pytest.approx(farthest, rel=0.12)


def test_format_and_unique_names(loaded):
    layout, scene, _ = loaded
    assert scene.format == {"nerd": "nerd", "blender": "transforms", "nerfstudio": "transforms"}.get(
        layout, "colmap"
    )
    names = [photo.name for photo in (*scene.train, *scene.test)]
    assert len(set(names)) == len(names)


def test_reading_twice_gives_the_same_bits(loaded):
    _, scene, _ = loaded
    again = load_scene(scene.root)
    assert (again.similarity.center == scene.similarity.center).all()
    assert again.similarity.scale == scene.similarity.scale


@pytest.mark.parametrize(
    ("lists", "train", "test"),
    [
        ({"test_filenames": [1]}, [0, 2, 3, 4], [1]),
        ({"train_filenames": [0, 2], "test_filenames": [1]}, [0, 2], [1]),
        ({"train_filenames": [0, 2], "val_filenames": [3], "test_filenames": [1]}, [0, 2], [1]),
        ({"train_filenames": [0, 2], "val_filenames": [3]}, [0, 2], [3]),
        ({"train_filenames": [0, 2]}, [0, 2], [1, 3, 4]),
    ],
)
def test_nerfstudio_s_lists_of_photos(tmp_path, lists, train, test):
    root = write_nerfstudio(tmp_path / "scene", views(5))
    settings = json.loads((root / "transforms.json").read_text())
    files = [frame["file_path"] for frame in settings["frames"]]
    named = {key: [files[i] for i in numbers] for key, numbers in lists.items()}
    (root / "transforms.json").write_text(json.dumps({**settings, **named}))
    scene = load_scene(root)
    assert [photo.name for photo in scene.train] == [f"view_{i:02d}" for i in train]
    assert [photo.name for photo in scene.test] == [f"view_{i:02d}" for i in test]
