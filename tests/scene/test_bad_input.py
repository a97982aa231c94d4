"""Every way a scene folder can be wrong: one sentence that says what, where and what to do."""

import json
import struct
import zlib

import numpy as np
import pytest
from PIL import Image

from lightprobe.core.errors import InputError
from lightprobe.scene import Camera, load_pixels, load_scene
from lightprobe.scene.inspect import inspect
from lightprobe.scene.normalise import first_guess
from tests.scene.worlds import (
    COUNT,
    edit_json,
    names,
    picture,
    refused,
    views,
    write_blender,
    write_colmap,
    write_colmap_model,
    write_nerd,
)

# Folders, poses_bounds.npy, photos and masks


def png_header(path, width, height):
    """Write a PNG of which only the header is sound."""
    chunk = b"IHDR" + struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    data = b"\x89PNG\r\n\x1a\n" + struct.pack(">I", 13) + chunk + struct.pack(">I", zlib.crc32(chunk))
    path.write_bytes(data + struct.pack(">I", 9) + b"IDAT" + bytes(13))


def edit_poses(root, change):
    rows = np.load(root / "poses_bounds.npy")
    change(rows)
    np.save(root / "poses_bounds.npy", rows)


def apart(root):
    """Masks that share no point of space."""
    for i, name in enumerate(names(COUNT)):
        mask = np.zeros((60, 72), np.uint8)
        mask[(0, -1)[i % 2], (0, -1)[i // 2]] = 255
        Image.fromarray(mask).save(root / "masks" / f"{name}.png")


SPOILT = {
    "pose count": (
        lambda root: (root / "images" / "view_03.png").unlink(),
        r"poses_bounds\.npy holds 4 poses, but .*images holds 3 photos",
    ),
    "pose shape": (
        lambda root: np.save(root / "poses_bounds.npy", np.zeros((4, 12))),
        r"17 numbers per photo, but its shape is \(4, 12\)",
    ),
    "NaN pose": (
        lambda root: edit_poses(root, lambda rows: rows[2].__setitem__(3, np.nan)),
        r"row 2 \(view_02\.png\) contains NaN",
    ),
    "mirrored pose": (
        lambda root: edit_poses(root, lambda rows: rows[1, 0:15:5].__imul__(-1)),
        r"row 1 \(view_01\.png\): camera_to_world is not a rotation",
    ),
    "huge header": (
        lambda root: png_header(root / "images" / "view_02.png", 60000, 60000),
        r"view_02\.png announces 60000 x 60000 pixels",
    ),
    "mask of another size": (
        lambda root: Image.new("L", (30, 40), 255).save(root / "masks" / "view_01.png"),
        r"masks/view_01\.png has 30 x 40 pixels, but its photo has 72 x 60",
    ),
    "mask without object": (
        lambda root: Image.new("L", (72, 60), 1).save(root / "masks" / "view_03.png"),
        r"masks/view_03\.png shows no object \(its brightest pixel is 1 of 255\)",
    ),
    "missing mask": (
        lambda root: (root / "masks" / "view_02.png").unlink(),
        r"images/view_02\.png has no mask: .*masks/view_02\.png",
    ),
    "another shape than the camera": (
        lambda root: Image.new("RGB", (72, 72)).save(root / "images" / "view_01.png"),
        r"view_01\.png has 72 x 72 pixels, but .*poses_bounds\.npy row 1 .* 72 x 60",
    ),
    "masks that share no point": (apart, r"Masks and cameras do not agree|cameras look away"),
}


@pytest.mark.parametrize("kind", SPOILT)
def test_a_folder_with_one_wrong_thing(nerd, kind):
    spoil, pattern = SPOILT[kind]
    spoil(nerd)
    refused(nerd, pattern)


def test_folders_that_are_no_scene(tmp_path):
    refused(tmp_path / "nowhere", r"nowhere does not exist")
    refused(tmp_path, r"is empty; a scene folder has poses_bounds\.npy.*transforms\.json.*COLMAP")
    (tmp_path / "a.txt").write_text("x")
    refused(tmp_path / "a.txt", r"a\.txt is not a folder")
    Image.new("RGB", (8, 8)).save(tmp_path / "a.png")
    refused(tmp_path, r"holds photos but no cameras; a scene folder has")
    refused(write_nerd(tmp_path / "scene", views(1)), r"holds 1 photos with cameras; two or more")


def test_truncated_jpeg(nerfstudio):
    path = nerfstudio / "images" / "view_01.jpg"
    path.write_bytes(path.read_bytes()[:-200])
    photo = next(p for p in load_scene(nerfstudio).train if p.name == "view_01")
    with pytest.raises(InputError, match=r"view_01\.jpg cannot be decoded"):
        load_pixels(photo)
    assert any("view_01.jpg cannot be decoded" in problem for problem in inspect(nerfstudio).problems)


# transforms.json


def test_malformed_json(nerfstudio):
    (nerfstudio / "transforms.json").write_text('{"frames": [')
    refused(nerfstudio, r"transforms\.json is not valid JSON \(line 1")


@pytest.mark.parametrize("value", [[], {}, {"frames": []}, {"frames": {"a": 1}}])
def test_no_frames(nerfstudio, value):
    (nerfstudio / "transforms.json").write_text(json.dumps(value))
    refused(nerfstudio, r"transforms\.json has no list of 'frames'")


@pytest.mark.parametrize("key", ["file_path", "mask_path"])
@pytest.mark.parametrize("path", ["../../etc/passwd", "/etc/passwd"])
def test_path_outside_the_folder(nerfstudio, key, path):
    edit_json(nerfstudio / "transforms.json", lambda data: data["frames"][1].update({key: path}))
    refused(nerfstudio, rf"transforms\.json names '{path}', which lies outside")


@pytest.mark.parametrize(
    ("change", "pattern"),
    [
        ({"file_path": "images/none.jpg"}, r"names the photo 'images/none\.jpg', which does not exist"),
        ({"file_path": 3}, r"frame 1 has no 'file_path'"),
        ({"mask_path": "masks/none.png"}, r"names the mask 'masks/none\.png', which does not exist"),
        ({"mask_path": 5}, r"'mask_path' must be text, not 5"),
        ({"fl_x": None}, r"view_01\.jpg\) has no focal length"),
        ({"fl_x": "long"}, r"'fl_x' must be a finite number, not 'long'"),
        ({"fl_x": float("nan")}, r"'fl_x' must be a finite number, not nan"),
        ({"fl_x": -3.0}, r"focal lengths and image size must be positive"),
        ({"fl_x": None, "camera_angle_x": 4.0}, r"focal lengths and image size must be positive"),
        ({"w": 0.2}, r"focal lengths and image size must be positive"),
        ({"transform_matrix": [[1, 0], [0, 1]]}, r"'transform_matrix' must be a 4x4 matrix"),
        ({"transform_matrix": "eye"}, r"'transform_matrix' must be a 4x4 matrix"),
        ({"transform_matrix": np.diag([2.0, 2, 2, 1]).tolist()}, r"camera_to_world is not a rotation"),
        ({"transform_matrix": np.full((4, 4), np.nan).tolist()}, r"contains NaN or infinity"),
        ({"k1": -5}, r"lens distortion that folds the picture over within its borders"),
        ({"k2": 1e9}, r"lens distortion with coefficients that no lens has"),
        ({"camera_model": "EQUIRECTANGULAR"}, r"camera model EQUIRECTANGULAR, which is not read; undistort"),
        ({"w": 500}, r"view_01\.jpg has 72 x 60 pixels, but .* 500 x 60"),
    ],
)
def test_bad_frames(nerfstudio, change, pattern):
    edit_json(nerfstudio / "transforms.json", lambda data: data["frames"][1].update(change))
    refused(nerfstudio, pattern)


def test_harmless_distortion_is_accepted(nerfstudio):
    edit_json(nerfstudio / "transforms.json", lambda data: data.update(k1=1e-4, p1=1e-5))
    assert len(load_scene(nerfstudio).train) == COUNT - 1


@pytest.mark.slow
def test_missing_blender_test_photo(tmp_path):
    root = write_blender(tmp_path / "scene", views(17))
    (root / "test" / "r_1.png").unlink()
    refused(root, r"transforms_test\.json names the photo './test/r_1', which does not exist")


# COLMAP


@pytest.mark.parametrize("part", ["cameras", "images"])
def test_half_a_model(colmap, part):
    (colmap / "sparse/0" / f"{part}.bin").unlink()
    refused(colmap, rf"sparse/0/{part}\.bin is missing; a COLMAP model needs both")


@pytest.mark.parametrize("part", ["cameras", "images"])
def test_cut_model(colmap, part):
    path = colmap / "sparse/0" / f"{part}.bin"
    path.write_bytes(path.read_bytes()[:-5])
    refused(colmap, rf"{part}\.bin is cut short")


def colmap_of(root, binary, lens, extra):
    write_colmap(root, views(COUNT), binary=binary)
    files = [f"{n}.jpg" for n in names(COUNT)]
    write_colmap_model(root / "sparse/0", files, views(COUNT), binary=binary, lens=lens, extra=extra)
    return root


@pytest.mark.parametrize(
    ("lens", "extra", "pattern"),
    [
        ("RADIAL", (-6, 0), r"images\.txt \(view_00\.jpg\) has lens distortion that folds"),
        ("DIVISION", (0.0,), r"camera model DIVISION, which is not read; undistort"),
    ],
)
def test_lenses_that_cannot_be_used(tmp_path, lens, extra, pattern):
    refused(colmap_of(tmp_path / "scene", False, lens, extra), pattern)


@pytest.mark.parametrize(
    ("lens", "extra"), [("SIMPLE_RADIAL", (1e-5,)), ("OPENCV", (0, 0, 0, 0)), ("SIMPLE_PINHOLE", ())]
)
@pytest.mark.parametrize("binary", [False, True])
def test_lenses_that_are_nearly_pinhole(tmp_path, lens, extra, binary):
    root = colmap_of(tmp_path / "scene", binary, lens, extra)
    for photo, view in zip(load_scene(root).train, views(COUNT)[1:], strict=True):
        assert (photo.camera.fx, photo.camera.fy) == pytest.approx(view.focal)


@pytest.mark.parametrize(
    ("part", "line", "pattern"),
    [
        ("cameras", "1 PINHOLE 72", r"cameras\.txt line 1 is not a camera"),
        ("cameras", "1 PINHOLE 72 60 50 36", r"line 1: PINHOLE needs 4 parameters, not 2"),
        ("images", "1 1 0 0 0 x 0 0 7 a.jpg", r"images\.txt line 1 is not an image"),
        (
            "images",
            "1 1 0 0 0 0 0 0 99 view_00.jpg",
            r"'view_00\.jpg' uses camera 99, which is not in cameras\.txt",
        ),
        ("images", "1 1 0 0 0 0 0 0 7 gone.jpg", r"names the photo 'gone\.jpg', which is not in"),
        (
            "images",
            "1 0 0 0 0 0 0 0 7 view_00.jpg",
            r"view_00\.jpg\): the pose contains NaN or a zero quaternion",
        ),
        ("images", "1 nan 0 0 0 0 0 0 7 view_00.jpg", r"the pose contains NaN"),
        ("images", "1 1 0 0 0 0 0 0 7 ../../x.jpg", r"lies outside"),
        ("images", "# nothing", r"images\.txt holds no registered images"),
    ],
)
def test_bad_lines(tmp_path, part, line, pattern):
    root = write_colmap(tmp_path / "scene", views(COUNT), binary=False)
    (root / "sparse/0" / f"{part}.txt").write_text(line + "\n\n")
    refused(root, pattern)


def test_unknown_model_number(colmap):
    (colmap / "sparse/0/cameras.bin").write_bytes(struct.pack("<QiiQQ", 1, 7, 77, 72, 60))
    refused(colmap, r"cameras\.bin has the unknown camera model number 77")


def test_all_problems_at_once(nerfstudio):
    """Three photos are wrong in three ways: an inspection names each of them."""

    def spoil(data):
        data["frames"][0]["transform_matrix"][0][3] = float("nan")
        data["frames"][1]["file_path"] = "images/none.jpg"

    edit_json(nerfstudio / "transforms.json", spoil)
    Image.fromarray(np.zeros_like(picture(views(COUNT)[2])[1])).save(nerfstudio / "masks" / "view_02.png")
    problems = inspect(nerfstudio).problems
    for fragment in (
        "view_00.jpg): the camera contains NaN",
        "images/none.jpg",
        "view_02.png shows no object",
    ):
        assert sum(fragment in problem for problem in problems) == 1


def test_a_mask_of_specks_does_not_stop_the_others():
    shots = views(COUNT + 1)
    cameras = [Camera(view.opengl, *view.focal, *view.center, view.width, view.height) for view in shots]
    cut = np.ones((60, 72), np.float32)  # by the border, so that not only whole masks are looked at
    speck = np.zeros((60, 72), np.float32)  # what a small picture leaves of it
    alphas = [*[cut] * COUNT, speck]
    center, radius = first_guess(cameras, alphas)
    assert np.isfinite(center).all()
    assert radius > 0
    with pytest.raises(InputError, match="specks"):
        first_guess(cameras, [speck] * len(cameras))
