"""Scenes that no program should have written: numbers beyond all bounds, names that are no names, broken
models.

Each of them is one sentence, and an inspection still finds what else is wrong.
"""

import json
import os
import struct

import numpy as np
import pytest
from PIL import Image

from lightprobe.core.errors import InputError
from lightprobe.imaging import write_png
from lightprobe.scene import Camera, load_scene, read_camera
from lightprobe.scene.frame import Problems
from lightprobe.scene.hull import Hull, visual_hull
from lightprobe.scene.inspect import inspect
from lightprobe.scene.loading import read_folder, unposed_images
from lightprobe.scene.normalise import find_similarity
from tests.scene.worlds import (
    edit_json,
    expected_camera,
    picture,
    refused,
    views,
    write_blender,
    write_colmap,
    write_nerd,
)
from tests.shapes import camera_at

COUNT = 4
HUGE = (1e200, 1e308, -1e308)
LONG = int("9" * 400)  # an integer that no float holds


def others_are_found(root, pattern):
    """Assert that an inspection reports `pattern` and, beside it, that the mask of view_03 shows no object."""
    Image.new("L", (72, 60)).save(root / "masks" / "view_03.png")
    refused(root, pattern, "view_03.png shows no object")


def edit_frame(root, change):
    edit_json(root / "transforms.json", lambda data: data["frames"][1].update(change))


@pytest.fixture(autouse=True)
def coarse(monkeypatch):
    """Hulls small enough for as many inspections."""
    monkeypatch.setattr("lightprobe.scene.soundness._RESOLUTION", 24)


# Cameras beyond all bounds


@pytest.mark.filterwarnings("ignore::RuntimeWarning")
@pytest.mark.parametrize("value", [*HUGE, np.nan, np.inf])
@pytest.mark.parametrize("field", ["fx", "fy", "cx", "cy", "position"])
def test_the_hull_trusts_no_camera(field, value):
    """Not even one that was never checked: what projects to no number lies in no photo."""
    good = camera_at((3.0, 0.5, 0.2), size=16)
    bad = Camera(**{**good.__dict__, "camera_to_world": good.camera_to_world.copy(), "fx": 20.0})
    if field == "position":
        bad.camera_to_world[0, 3] = value
    else:
        bad = Camera(**{**bad.__dict__, field: value})
    for low in (-1.0, -1e154, -1e308):
        hull = visual_hull([good, bad], [np.ones((16, 16), np.float32)] * 2, 12, lo=[low] * 3, hi=[-low] * 3)
        assert hull.score.shape == (12, 12, 12)
    solid = Hull(np.ones((8, 8, 8), bool), np.ones((8, 8, 8), np.float32), -np.ones(3), np.ones(3))
    assert solid.silhouette(bad).shape == (16, 16)


def test_rays_from_afar_come_to_an_end():
    """So far away that the next voxel is nearer than the numbers are apart."""
    pose = np.eye(4)
    pose[:3] = [[0, 0, 1, 2e15], [1, 0, 0, -62500], [0, 1, 0, -62500]]  # looks along -x
    wall = np.zeros((64, 64, 64), bool)
    wall[:, 36] = True
    hull = Hull(wall, wall.astype(np.float32), -np.ones(3), np.ones(3))
    assert hull.silhouette(Camera(pose, 1.0, 1.0, 0.5, 0.5, 1, 1)).shape == (1, 1)


@pytest.mark.parametrize("value", [*HUGE[:2], LONG])
@pytest.mark.parametrize("key", ["fl_x", "fl_y", "cx", "cy"])
def test_intrinsics_beyond_all_bounds(nerfstudio, key, value):
    edit_frame(nerfstudio, {key: value})
    others_are_found(nerfstudio, r"view_01\.jpg\).*(focal length|principal point|must be a finite number)")


@pytest.mark.parametrize("place", range(4))
@pytest.mark.parametrize(("binary", "value"), [(False, 1e200), (True, -1e308)])
def test_colmap_intrinsics_beyond_all_bounds(tmp_path, place, value, binary):
    root = write_colmap(tmp_path / "scene", views(COUNT), binary=binary)
    if binary:
        data = bytearray((root / "sparse/0/cameras.bin").read_bytes())
        struct.pack_into("<d", data, 8 + 56 + 24 + 8 * place, value)
        (root / "sparse/0/cameras.bin").write_bytes(data)
    else:
        lines = (root / "sparse/0/cameras.txt").read_text().splitlines()
        words = lines[2].split()
        words[4 + place] = repr(value)
        lines[2] = " ".join(words)
        (root / "sparse/0/cameras.txt").write_text("\n".join(lines))
    refused(root, r"view_01\.jpg\).*(focal lengths? |principal point)")


@pytest.mark.parametrize(
    ("change", "pattern"),
    [
        ({"w": LONG}, r"'w' must be a finite number"),
        ({"w": 1e300, "h": 1e300}, r"image size"),
        ({"camera_angle_x": 5e-324, "fl_x": None}, r"focal length"),
        ({"camera_model": ["OPENCV"]}, r"camera model \['OPENCV'\]"),
        (
            {"transform_matrix": [[1, 0, 0, 1e200], *np.eye(4)[1:].tolist()]},
            r"view_01\.jpg\).*camera stands at",
        ),
        ({"transform_matrix": [[LONG] * 4] * 4}, r"'transform_matrix' must be a 4x4 matrix of numbers"),
        ({"k1": 1e308, "k2": -1e308}, r"lens distortion"),
        ({"file_path": "images/\0.jpg"}, r"names 'images/\\x00\.jpg', which is no file name"),
        ({"file_path": "images/\ud800.jpg"}, r"names 'images/\\ud800\.jpg', which is no file name"),
        ({"file_path": "images/" + "x" * 5000}, r"names 'images/x+\.\.\..*', which is no file name"),
        ({"file_path": "a\nb"}, r"names the photo 'a\\nb', which does not exist"),
        ({"mask_path": "masks/\0"}, r"names 'masks/\\x00', which is no file name"),
        ({"mask_path": [["x" * 5000] * 9]}, r"'mask_path' must be text, not .{1,200}$"),
        ({"env_path": "\0"}, r"names '\\x00', which is no file name"),
    ],
)
def test_odd_frames(nerfstudio, change, pattern):
    edit_frame(nerfstudio, change)
    others_are_found(nerfstudio, pattern)


def test_links_in_a_loop(nerfstudio):
    (nerfstudio / "images" / "loop.jpg").symlink_to("loop.jpg")
    edit_frame(nerfstudio, {"file_path": "images/loop.jpg"})
    words = r"names 'images/loop\.jpg', which is no file name|loop\.jpg', which does not exist"
    others_are_found(nerfstudio, words)


def test_a_guessed_suffix_leads_out_of_the_folder_no_more_than_a_written_one(nerfstudio, tmp_path):
    Image.new("RGB", (72, 60)).save(tmp_path / "secret.png")
    edit_frame(nerfstudio, {"file_path": "../secret"})
    others_are_found(nerfstudio, r"names '\.\./secret', which lies outside")


@pytest.mark.parametrize(
    ("text", "pattern"),
    [
        ("[" * 100_000, r"nested too deeply"),
        ('{"frames": ' + "[" * 100_000 + "]" * 100_000 + "}", r"nested too deeply"),
        ('{"frames": [' + "9" * 5000 + "]}", r"number of too many digits"),
    ],
)
def test_json_beyond_all_bounds(nerfstudio, text, pattern):
    (nerfstudio / "transforms.json").write_text(text)
    refused(nerfstudio, pattern)


def test_one_broken_file_does_not_hide_the_other(tmp_path):
    root = write_blender(tmp_path / "scene", views(17))
    (root / "transforms_test.json").write_text("[" * 100_000)
    edit_json(root / "transforms_train.json", lambda data: data["frames"][2].update(file_path="train/none"))
    found = inspect(root)
    assert len(found.photos) == 14
    assert all(sum(words in p for p in found.problems) == 1 for words in ("nested too deeply", "train/none"))


# poses_bounds.npy

HEADER = b"{'descr': '<f8', 'fortran_order': False, 'shape': (1000000000000, 17)}".ljust(117) + b"\n"


def archive(path):
    np.savez(path.with_suffix(".npz"), np.zeros((COUNT, 17)))
    path.with_suffix(".npz").rename(path)


@pytest.mark.parametrize(
    "write",
    [
        archive,
        lambda path: path.write_bytes(b"PK\x03\x04 broken"),
        lambda path: path.write_bytes(b"\x93NUMPY broken"),
        lambda path: path.write_bytes(
            b"\x93NUMPY\x01\x00" + struct.pack("<H", len(HEADER)) + HEADER + bytes(99)
        ),
        lambda path: np.save(path, np.array([{"a": 1}], dtype=object), allow_pickle=True),
    ],
)
def test_poses_that_are_no_array(nerd, write):
    write(nerd / "poses_bounds.npy")
    refused(nerd, r"poses_bounds\.npy cannot be read as a NumPy array")


@pytest.mark.parametrize("dtype", ["c16", "S30", "M8[s]", [("a", "f8"), ("b", "f8")]])
def test_poses_that_are_no_real_numbers(nerd, dtype):
    np.save(nerd / "poses_bounds.npy", np.zeros((COUNT, 17), dtype))
    refused(nerd, r"poses_bounds\.npy must hold 17 numbers per photo")


# COLMAP


@pytest.mark.slow
def test_all_cameras_are_one(tmp_path):
    root = write_colmap(tmp_path / "scene", [views(COUNT)[0]] * COUNT, binary=False)
    refused(root, r"Masks and cameras do not agree|cameras look away|cameras .* stand at one place")


@pytest.mark.parametrize("value", [1e155, 1e308, np.inf, np.nan])
def test_a_degenerate_model(value):
    """Whatever cameras come here unchecked: a sentence, and nothing from the algebra below."""
    shots = views(COUNT)
    cameras = [expected_camera(view) for view in shots]
    for camera in cameras[1:]:
        camera.camera_to_world[0, 3] = value
    with pytest.raises(InputError, match="cameras"):
        find_similarity(cameras, [picture(view)[1] / 255 for view in shots])


def test_degenerate_translations(tmp_path):
    root = write_colmap(tmp_path / "scene", views(COUNT), binary=False)
    path = root / "sparse/0/images.txt"
    lines = path.read_text().splitlines()
    words = lines[1].split()
    words[5] = "1e200"
    path.write_text("\n".join([lines[0], " ".join(words), *lines[2:]]))
    refused(root, r"view_00\.jpg\).*camera stands at")
    words[5], words[1] = "0", "1e300"
    path.write_text("\n".join([lines[0], " ".join(words), *lines[2:]]))
    refused(root, r"view_00\.jpg\): the pose contains NaN or a zero quaternion|quaternion")


def test_every_bad_line_of_a_model_is_found(tmp_path):
    root = write_colmap(tmp_path / "scene", views(6), binary=False)
    path = root / "sparse/0/images.txt"
    lines = path.read_text().splitlines()
    lines[1], lines[5] = "1 2 3", lines[5].replace("view_02.jpg", "gone.jpg")
    path.write_text("\n".join(lines) + "\n")
    found = inspect(root)
    assert len(found.photos) == 4
    for words in ("line 2 is not an image", "gone.jpg"):
        assert sum(words in problem for problem in found.problems) == 1
    cameras = root / "sparse/0/cameras.txt"
    cameras.write_text(cameras.read_text().replace("PINHOLE", "PINHOLE x", 1))
    assert sum("line 2 is not a camera" in problem for problem in inspect(root).problems) == 1


def test_what_precedes_a_cut_is_inspected(tmp_path):
    root = write_colmap(tmp_path / "scene", views(6), binary=True)
    path = root / "sparse/0/images.bin"
    path.write_bytes(path.read_bytes()[:-5])
    found = inspect(root)
    assert len(found.photos) >= 4
    assert sum("images.bin is cut short" in problem for problem in found.problems) == 1


def test_photos_that_lie_elsewhere(tmp_path):
    """`images` may be a link to another disk, with equal names in its folders."""
    root = write_colmap(tmp_path / "scene", views(COUNT), binary=False, masks=None, suffix=".png")
    (root / "images" / "left").mkdir()
    (root / "images" / "view_01.png").rename(root / "images" / "left" / "view_00.png")
    path = root / "sparse/0/images.txt"
    path.write_text(path.read_text().replace("view_01.png", "left/view_00.png"))
    (root / "images").rename(tmp_path / "disk")
    (root / "images").symlink_to(tmp_path / "disk")
    for name in ("view_00", "view_02", "view_03", "left/view_00"):
        write_png(root / "masks" / f"{name}.png", np.pad(np.ones((40, 40, 3)), ((10, 10), (16, 16), (0, 0))))
    scene = load_scene(root)
    names = {photo.name for photo in (*scene.train, *scene.test)}
    assert len(names) == COUNT
    assert all(name.endswith(("view_00", "view_02", "view_03")) for name in names)
    masks = {photo.mask_path.relative_to(root / "masks").as_posix() for photo in (*scene.train, *scene.test)}
    assert masks == {"view_00.png", "view_02.png", "view_03.png", "left/view_00.png"}
    reading = read_folder(root, Problems())
    assert unposed_images(reading.root, reading.files) == []


# --camera


def camera_file(tmp_path, value):
    (tmp_path / "camera.json").write_text(value if isinstance(value, str) else json.dumps(value))
    return tmp_path / "camera.json"


GOOD = camera_at((3.0, 0.5, 0.2), size=8).to_json()
FRAME = {"file_path": "a.png", "transform_matrix": GOOD["camera_to_world"]}


def frames(*entries, **settings):
    return {"fl_x": 9, "w": 8, "h": 8, **settings, "frames": list(entries)}


def record(photo, root="/"):
    return {"root": root, "photos": {"train": {"a": photo}}}


PHOTO = {"image": "a.png", "camera": GOOD}


@pytest.mark.parametrize(
    ("value", "pattern"),
    [
        ([], "must hold a JSON object"),
        (3, "must hold a JSON object"),
        ("text", "is not valid JSON"),
        ('"text"', "must hold a JSON object"),
        ("[" * 100_000, "nested too deeply"),
        (frames({**FRAME, "file_path": 3}, FRAME), "file_path.*must be text, not 3"),
        (frames({**FRAME, "file_path": None}), "file_path.*must be text, not None"),
        (frames(FRAME, w=LONG), "'w' must be a finite number"),
        ('{"fl_x": 9, "w": 1e999, "h": 8, "frames": [{"file_path": "a"}]}', "no image size"),
        ({"frames": []}, "holds no camera"),
        ({"photos": {}}, "holds no camera"),
        ({"photos": {"train": []}}, "photos of 'train' are not an object"),
        ({"photos": {"train": 7}}, "photos of 'train' are not an object"),
        (record(PHOTO, root=[]), "'root' must be text"),
        (record(PHOTO, root=5), "'root' must be text"),
        (record({"camera": GOOD}), "'a' has no 'image' and 'camera'"),
        (record({"image": 3, "camera": GOOD}), "'a' has no 'image' and 'camera'"),
        (record({"image": "a.png"}), "'a' has no 'image' and 'camera'"),
        (record({"image": "a.png", "camera": 7}), "must hold a JSON object"),
        ({**GOOD, "fx": 1e200}, "focal length"),
        ({**GOOD, "cx": -1e308}, "principal point"),
        ({**GOOD, "width": LONG}, "image size"),
        ({**GOOD, "fx": LONG}, "not a number"),
        ({**GOOD, "fx": "x\n" * 5000}, "not a number"),
        ({**GOOD, "camera_to_world": 1}, "must be a 4x4 matrix"),
        ({**GOOD, "camera_to_world": {"a": 1}}, "not a number"),
    ],
)
def test_camera_files(tmp_path, value, pattern):
    with pytest.raises(InputError, match=pattern) as caught:
        read_camera(camera_file(tmp_path, value), tmp_path / "a.png")
    message = str(caught.value)
    assert "\n" not in message
    assert message.endswith(".")
    assert not message.endswith("..")
    assert len(message) < 500 + len(str(tmp_path))


@pytest.mark.parametrize("name", ["\0.png", "\ud800", "loop"])
def test_names_that_are_no_files_belong_to_no_photo(tmp_path, name):
    """Of several cameras the photo's is taken, whatever the others are called."""
    os.symlink("loop", tmp_path / "loop")
    path = camera_file(tmp_path, frames({**FRAME, "file_path": name}, FRAME))
    assert read_camera(path, tmp_path / "a.png").width == 8
    photos = {"b": {"image": name, "camera": {**GOOD, "width": 9}}, "a": {"image": "a.png", "camera": GOOD}}
    path = camera_file(tmp_path, {"root": name, "photos": {"train": photos}})
    assert read_camera(path, tmp_path / "a.png").width == 8


# Photos named twice


def test_a_photo_named_twice(nerfstudio):
    edit_json(nerfstudio / "transforms.json", lambda data: data["frames"].append(data["frames"][1]))
    others_are_found(nerfstudio, r"view_01\.jpg is named twice")
    assert len(inspect(nerfstudio).photos) == COUNT - 1


def test_a_photo_with_two_cameras(nerfstudio):
    def spoil(data):
        other = {**data["frames"][2], "file_path": "./images/../images/view_01.jpg"}
        data["frames"].append(other)

    edit_json(nerfstudio / "transforms.json", spoil)
    others_are_found(nerfstudio, r"view_01\.jpg is named twice, with different cameras")


def test_a_photo_to_train_and_to_test_on(tmp_path):
    root = write_blender(tmp_path / "scene", views(17))
    frame = json.loads((root / "transforms_train.json").read_text())["frames"][3]
    edit_json(root / "transforms_test.json", lambda data: data["frames"].append(frame))
    refused(
        root, r"train/r_3\.png is named twice, by .*transforms_train\.json .* and .*transforms_test\.json"
    )


def test_an_image_named_twice_by_colmap(tmp_path):
    root = write_colmap(tmp_path / "scene", views(COUNT), binary=False)
    path = root / "sparse/0/images.txt"
    path.write_text(path.read_text().replace("view_02.jpg", "view_01.jpg"))
    refused(root, r"view_01\.jpg is named twice, with different cameras")


def test_links_to_one_photo(tmp_path):
    root = write_nerd(tmp_path / "scene", views(COUNT))
    (root / "images" / "view_02.png").unlink()
    (root / "images" / "view_02.png").symlink_to("view_01.png")
    refused(root, r"view_01\.png is named twice, with different cameras")
