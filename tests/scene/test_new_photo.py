"""The camera of one photo out of files that hold many."""

import json
from pathlib import Path

import numpy as np
import pytest

from lightprobe.core.errors import InputError, LightprobeWarning
from lightprobe.core.files import checksum
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
            found.append(
                {"file_path": f"./{folder}/{name}", "transform_matrix": camera.camera_to_world.tolist()}
            )
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


def test_a_name_is_none_of_a_camera_without_one(tmp_path):
    (tmp_path / "camera.json").write_text(json.dumps(camera_at((3.0, 0.5, 0.2), size=8, focal=9.0).to_json()))
    assert distance(read_camera(tmp_path / "camera.json")) == 3.0
    with pytest.raises(InputError, match="one camera, of no named photo; leave out the name 'r_003'"):
        read_camera(tmp_path / "camera.json", Path("r_003"))


def test_a_copy_of_a_photo_is_known_by_its_content(tmp_path):
    """Where other splits have photos of its name, or where its name is another one."""
    photos = {}
    for distance_, split in ((3.0, "train"), (4.0, "test")):
        file = tmp_path / "gone" / split / "a.png"
        write_png(file, np.full((8, 8, 3), distance_ / 5), np.ones((8, 8)))
        camera = camera_at((distance_, 0.5, 0.2), size=8, focal=9.0).to_json()
        photos[split] = {"a": {"image": f"{split}/a.png", "camera": camera, "image_checksum": checksum(file)}}
    (tmp_path / "scene.json").write_text(json.dumps({"root": str(tmp_path / "elsewhere"), "photos": photos}))
    assert distance(read_camera(tmp_path / "scene.json", tmp_path / "gone" / "test" / "a.png")) == 4.0
    (tmp_path / "mine.png").write_bytes((tmp_path / "gone" / "train" / "a.png").read_bytes())
    assert distance(read_camera(tmp_path / "scene.json", tmp_path / "mine.png")) == 3.0
    with pytest.raises(InputError, match=r"holds 2 cameras \(a, a\), not exactly one for a"):
        read_camera(tmp_path / "scene.json", Path("a"))


def test_the_only_camera_is_that_of_its_photo(frames):
    value = json.loads(frames.read_text())
    frames.write_text(json.dumps({**value, "frames": value["frames"][:1]}))
    assert distance(read_camera(frames, Path("a"))) == 3.0
    assert distance(read_camera(frames)) == 3.0
    with pytest.raises(InputError, match="no camera of 'b', only that of 'a'"):
        read_camera(frames, Path("b"))
    with pytest.warns(LightprobeWarning, match="the camera of 'a', which is taken for .*b.png"):
        assert distance(read_camera(frames, frames.parent / "left" / "b.png")) == 3.0
