"""The camera of one photo out of files that hold many."""

import json

import numpy as np
import pytest

from lightprobe.core.errors import InputError
from lightprobe.imaging import write_png
from lightprobe.scene import load_photo, read_camera
from tests.shapes import camera_at


@pytest.fixture
def frames(tmp_path):
    """A transforms file with photos of the same name in two folders, their cameras 3 and 4 away."""
    found = []
    for distance, folder in ((3.0, "left"), (4.0, "right")):
        for name in ("a", "b"):
            camera = camera_at((distance, 0.5, 0.2), size=8, focal=9.0)
            write_png(tmp_path / folder / f"{name}.png", np.full((8, 8, 3), 0.5), np.ones((8, 8)))
            found.append({"file_path": f"./{folder}/{name}", "transform_matrix": camera.camera_to_world.tolist()})
    (tmp_path / "transforms.json").write_text(json.dumps({"fl_x": 9.0, "w": 8, "h": 8, "frames": found}))
    return tmp_path / "transforms.json"


def distance(camera) -> float:
    return round(float(camera.position[0]), 3)


@pytest.mark.parametrize(("folder", "expected"), [("left", 3.0), ("right", 4.0)])
def test_the_folder_decides_between_equal_names(frames, folder, expected):
    assert distance(read_camera(frames, frames.parent / folder / "b.png")) == expected
    pixels, camera = load_photo(frames.parent / folder / "b.png", frames)
    assert distance(camera) == expected
    assert pixels.color.shape == (8, 8, 3)


def test_a_photo_that_no_camera_or_two_belong_to(frames, tmp_path):
    for image in (tmp_path / "elsewhere" / "a.png", tmp_path / "left" / "c.png", None):
        with pytest.raises(InputError, match="holds 4 cameras"):
            read_camera(frames, image)


def test_a_name_is_enough_where_it_is_the_only_one(frames):
    value = json.loads(frames.read_text())
    frames.write_text(json.dumps({**value, "frames": value["frames"][:2]}))
    assert distance(read_camera(frames, frames.parent / "scaled" / "b.png")) == 3.0
