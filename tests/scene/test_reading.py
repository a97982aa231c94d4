"""Masks, names, sizes, orientation and truth files: what a photo becomes."""

import json
import re
import time
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from lightprobe.core.errors import InputError
from lightprobe.imaging import resize_area, srgb_decode
from lightprobe.scene import load_alpha, load_pixels, load_scene
from lightprobe.scene.frame import Problems, Split, unique_names
from lightprobe.scene.inspect import inspect
from lightprobe.scene.loading import read_folder, unposed_images
from tests.scene.worlds import (
    names,
    picture,
    views,
    write_colmap,
    write_colmap_model,
    write_nerd,
    write_nerfstudio,
)

COUNT = 4


def photos(root):
    reading = read_folder(root, Problems())
    return sorted((photo for _, photo in reading.all_photos()), key=lambda photo: photo.name)


@pytest.mark.parametrize("masks", ["{stem}.png", "{name}.png", None])
@pytest.mark.parametrize("suffix", [".png", ".webp"])
def test_masks_by_name_or_alpha(tmp_path, masks, suffix):
    root = write_nerd(tmp_path / "scene", views(COUNT), masks=masks, suffix=suffix)
    for photo, view in zip(photos(root), views(COUNT), strict=True):
        np.testing.assert_array_equal(load_alpha(photo), picture(view)[1] / 255)
        assert (photo.mask_path is None) == (masks is None)


def test_pixels_are_zero_outside_the_mask_and_linear_inside(tmp_path):
    photo = photos(write_nerd(tmp_path / "scene", views(COUNT)))[0]
    pixels, camera = load_pixels(photo)
    color, mask = picture(views(COUNT)[0])
    assert camera == photo.camera
    assert pixels.color.dtype == pixels.alpha.dtype == np.float32
    assert (pixels.color[mask == 0] == 0).all()
    np.testing.assert_allclose(pixels.color[mask > 0], srgb_decode(color[mask > 0] / 255), atol=1e-6)


def test_downscaling_averages_premultiplied_linear_light(tmp_path):
    photo = photos(write_nerd(tmp_path / "scene", views(COUNT)))[0]
    full, _ = load_pixels(photo)
    small, camera = load_pixels(photo, 31)
    assert small.alpha.shape == (camera.height, camera.width) == (26, 31)
    assert load_alpha(photo, 31).shape == (26, 31)
    premultiplied = resize_area(full.color * full.alpha[..., None], 26, 31)
    np.testing.assert_allclose(small.color * small.alpha[..., None], premultiplied, atol=1e-6)
    assert small.alpha.mean() == pytest.approx(full.alpha.mean(), abs=1e-6)
    inside = small.alpha > 0
    # Balls of pure colours: the channels add up to one unless the grey background bleeds in at the rim.
    np.testing.assert_allclose(small.color[inside].sum(axis=1), 1, atol=1e-4)
    assert camera.fx / photo.camera.fx == pytest.approx(31 / 72)
    assert camera.fy / photo.camera.fy == pytest.approx(26 / 60)
    assert load_pixels(photo, 500)[1] == photo.camera


def test_downscaling_weighs_colour_by_coverage(tmp_path):
    """A half covered red pixel beside a fully covered green one: a third red, two thirds green."""
    root = write_nerd(tmp_path / "scene", views(COUNT), masks=None)
    samples = np.zeros((60, 72, 4), np.uint8)
    samples[:, 0::2], samples[:, 1::2] = (255, 0, 0, 127), (0, 255, 0, 254)
    Image.fromarray(samples).save(root / "images" / "view_00.png")
    pixels, _ = load_pixels(photos(root)[0], 36)
    np.testing.assert_allclose(pixels.color, np.broadcast_to([1 / 3, 2 / 3, 0], (30, 36, 3)), atol=1e-5)
    np.testing.assert_allclose(pixels.alpha, 0.75 * 254 / 255, atol=1e-5)


def test_scaled_photos_scale_their_cameras(tmp_path):
    root = write_nerd(tmp_path / "scene", views(COUNT))
    for folder in ("images", "masks"):
        for path in (root / folder).iterdir():
            image = Image.open(path)
            image.resize((36, 30), Image.Resampling.BOX).save(path)
    for photo, view in zip(photos(root), views(COUNT), strict=True):
        half = view.focal[0] / 2
        assert (photo.camera.fx, photo.camera.fy, photo.camera.cx) == (half, half, 18)
        assert (photo.camera.width, photo.camera.height) == (36, 30)


@pytest.mark.parametrize("camera_is_for", ["upright", "stored"])
def test_turned_photos(tmp_path, camera_is_for):
    """A phone stores a portrait lying down; some programs turn it before estimating its camera, some do not."""
    root = write_nerfstudio(tmp_path / "scene", views(COUNT))
    view = views(COUNT)[1]
    color, mask = picture(view)
    exif = Image.Exif()
    exif[0x0112] = 6
    stored = Image.fromarray(color)
    if camera_is_for == "upright":  # orientation 6: turn by 90 degrees clockwise to see it upright
        stored = stored.transpose(Image.Transpose.ROTATE_90)
    stored.save(root / "images" / "view_01.jpg", exif=exif, quality=98, subsampling=0)
    pixels, camera = load_pixels(photos(root)[1])
    assert (camera.width, camera.height) == (72, 60)
    np.testing.assert_allclose(pixels.color[mask > 0], srgb_decode(color[mask > 0] / 255), atol=0.2)


def test_photo_replaced_after_loading(tmp_path):
    photo = photos(write_nerd(tmp_path / "scene", views(COUNT)))[0]
    Image.new("RGB", (9, 9)).save(photo.image_path)
    with pytest.raises(InputError, match="no longer has the 72 x 60 pixels"):
        load_pixels(photo)


def test_exposure_is_read(tmp_path):
    root = write_nerfstudio(tmp_path / "scene", views(COUNT))
    exif = Image.Exif()
    exif.get_ifd(0x8769).update({0x829A: 0.01, 0x829D: 4.0, 0x8827: 100})
    Image.open(root / "images" / "view_02.jpg").save(root / "images" / "view_02.jpg", exif=exif)
    found = [photo.ev100 for photo in photos(root)]
    assert found[2] == pytest.approx(np.log2(1600), abs=1e-3)
    assert found[0] is None


def test_truth_files_and_relighting(tmp_path):
    root = tmp_path / "scene"
    view = views(1)[0]
    keys = {"env_path": "env.exr", "hdr_path": "hdr.exr", "basecolor_path": "b.png", "orm_path": "o.png"}
    for split in ("train", "test", "relight"):
        (root / split).mkdir(parents=True)
        frames = []
        for i in range(2):
            Image.fromarray(np.dstack(picture(view))).save(root / split / f"r_{i}.png")
            pose = view.opengl.tolist()
            light = {"hdri": "sky"} if i else {"hdri": 3}  # a name, and nothing that could be one
            frame = {"file_path": f"./{split}/r_{i}", "transform_matrix": pose, "normal_path": "none.exr"}
            frames.append({**frame, **keys, **light})
        (root / f"transforms_{split}.json").write_text(json.dumps({"camera_angle_x": 0.7, "frames": frames}))
    for name in keys.values():
        (root / name).write_bytes(b"x")
    reading = read_folder(root, Problems())
    assert [len(reading.photos[split]) for split in Split] == [2, 2, 2]
    truth = reading.photos[Split.RELIGHT][0].truth
    assert [truth.environment, truth.linear, truth.base_color, truth.orm] == [
        root / name for name in keys.values()
    ]
    assert truth.normal is None  # named, but not there
    assert [photo.truth.light for photo in reading.photos[Split.TEST]] == [None, "sky"]
    assert reading.photos[Split.TEST][1].name == "test_r_1"
    edit = json.loads((root / "transforms_train.json").read_text())
    edit["frames"][0]["env_path"] = "../outside.exr"
    (root / "transforms_train.json").write_text(json.dumps(edit))
    with pytest.raises(InputError, match="outside"):
        read_folder(root, Problems())


def test_validation_photos_test_when_there_are_no_test_photos(tmp_path):
    root = tmp_path / "scene"
    for split, count in (("train", 3), ("val", 2)):
        frames = []
        for i, view in enumerate(views(count)):
            (root / split).mkdir(parents=True, exist_ok=True)
            Image.fromarray(np.dstack(picture(view))).save(root / split / f"{split}{i}.png")
            frames.append({"file_path": f"{split}/{split}{i}", "transform_matrix": view.opengl[:3].tolist()})
        (root / f"transforms_{split}.json").write_text(json.dumps({"camera_angle_x": 0.7, "frames": frames}))
    reading = read_folder(root, Problems())
    assert [photo.name for photo in reading.photos[Split.TEST]] == ["val0", "val1"]


def test_missing_extension_and_shared_intrinsics(tmp_path):
    root = write_nerfstudio(tmp_path / "scene", views(COUNT))
    data = json.loads((root / "transforms.json").read_text())
    view = views(COUNT)[0]
    for frame in data["frames"]:
        for key in ("fl_x", "fl_y", "cx", "cy", "w", "h", "mask_path"):
            del frame[key]
        frame["file_path"] = "./" + frame["file_path"].removesuffix(".jpg")
    data["fl_x"] = view.focal[0]
    (root / "transforms.json").write_text(json.dumps(data))
    photo = photos(root)[0]
    assert (photo.camera.fx, photo.camera.fy) == (view.focal[0], view.focal[0])
    assert (photo.camera.cx, photo.camera.cy, photo.camera.width, photo.camera.height) == (36, 30, 72, 60)
    assert photo.mask_path == root / "masks" / "view_00.png"


def test_model_folder_itself(tmp_path):
    root = write_colmap(tmp_path / "scene", views(COUNT), binary=True)
    assert read_folder(root / "sparse/0", Problems()).root == root
    flat = tmp_path / "flat"
    (flat / "images").mkdir(parents=True)
    for i, view in enumerate(views(COUNT)):
        Image.fromarray(np.dstack(picture(view))).save(flat / "images" / f"photo {i}.png")
    write_colmap_model(flat, [f"photo {i}.png" for i in range(COUNT)], views(COUNT), binary=False)
    assert [photo.name for photo in photos(flat)] == [f"photo_{i}" for i in range(COUNT)]


def test_photos_without_pose_are_left_out(tmp_path):
    root = write_colmap(tmp_path / "scene", views(COUNT), binary=True)
    files = [f"{name}.jpg" for name in names(COUNT)][:-1]
    write_colmap_model(root / "sparse/0", files, views(COUNT)[:-1], binary=True)
    reading = read_folder(root, Problems())
    assert [path.name for path in unposed_images(reading.root, reading.files)] == ["view_03.jpg"]


def test_unique_names(tmp_path):
    paths = ["a/x.png", "b/X.png", "b/ü 1.png"]
    assert unique_names([tmp_path / p for p in paths], tmp_path) == ["a_x", "b_X", "b_ü_1"]
    clash = ["a b.png", "a_b.png", "...png.png"]
    assert unique_names([tmp_path / p for p in clash], tmp_path) == ["a_b", "a_b-2", "png"]


def test_long_names_are_cut_by_bytes():
    """Names of 119 characters may have 357 bytes; with the longest suffix they must fit into 255, or 143 of
    some.
    """
    root = Path("/scene")
    paths = [root / f"{'漢' * 119}{end}.png" for end in ("a", "b", "c")] + [
        root / f"x{'漢' * 119}{i}.png" for i in "ab"
    ]
    names = unique_names(paths, root)
    assert len({name.casefold() for name in names}) == len(paths)
    for name in names:
        assert len(f"{name}.confidence.exr".encode()) <= 143
        assert re.fullmatch(r"x?漢{36,40}(-\d)?", name)


@pytest.mark.long
def test_many_equal_names_take_no_longer_than_others():
    """Once the time grew with the square of the photos."""
    root = Path("/scene")
    long = "y" * 130
    start = time.process_time()
    names = unique_names([root / f"a b{'!' if i % 2 else '?'}.png" for i in range(200_000)], root)
    assert len(set(names)) == 200_000
    names = unique_names([root / f"{long}{i}.png" for i in range(100_000)], root)
    assert len(set(names)) == 100_000
    assert all(len(name) <= 120 for name in names)
    assert time.process_time() - start < 15  # it takes some seconds, and once took hours


def test_load_scene_reads_a_plain_string(tmp_path):
    root = write_nerd(tmp_path / "scene", views(COUNT))
    assert load_scene(str(root)).format == "nerd"


def test_photos_of_one_light_are_told_by_their_group(tmp_path):
    file = write_nerfstudio(tmp_path / "scene", views(COUNT)) / "transforms.json"
    data = json.loads(file.read_text())
    for frame, group in zip(data["frames"], (0, 0, "garden", None), strict=True):
        frame["light_group"] = group
    file.write_text(json.dumps(data))
    assert [photo.light_group for photo in photos(file.parent)] == ["0", "0", "garden", None]
    assert "lights   shared by 2 photos (light_group)" in inspect(file.parent).lines()
    data["frames"][1]["light_group"] = 1.5
    file.write_text(json.dumps(data))
    with pytest.raises(InputError, match=r"'light_group' must be a name or a whole number, not 1\.5"):
        photos(file.parent)
