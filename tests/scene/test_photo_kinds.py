"""A scene whose photos are files of every kind: the same object in all, with the masks beside them."""

import numpy as np
import pillow_heif
import pytest
import tifffile
from PIL import Image

from lightprobe.imaging import srgb_decode, write_exr
from lightprobe.scene import load_pixels, load_scene
from lightprobe.scene.inspect import inspect
from tests.imaging.gain_files import iso_metadata, write_gain_jpeg
from tests.imaging.icc_profiles import P3_PRIMARIES, icc
from tests.scene.worlds import edit_json, names, picture, views, write_nerfstudio

COUNT = 18
KINDS = ("png", "heic", "tif", "deep.tif", "avif", "exr")


def rewrite(path, kind):
    """Replace a photo by one of another kind; return its name."""
    color = np.asarray(Image.open(path).convert("RGB"))
    path.unlink()
    path = path.with_suffix(f".{kind.rpartition('.')[2]}")
    if kind == "heic":
        pillow_heif.from_pillow(Image.fromarray(color)).save(path, quality=100, chroma=444)
    elif kind == "deep.tif":
        tifffile.imwrite(path, color.astype(np.uint16) * 257, photometric="rgb")
    elif kind == "exr":
        write_exr(path, srgb_decode(color / 255))
    else:
        Image.fromarray(color).save(path, quality=100)
    return path.name


@pytest.fixture
def mixed(tmp_path):
    root = write_nerfstudio(tmp_path / "scene", views(COUNT))
    files = {}
    for index, name in enumerate(names(COUNT)):
        old = next((root / "images").glob(f"{name}.*"))
        files[name] = rewrite(old, KINDS[index % len(KINDS)])

    def rename(data):
        for frame in data["frames"]:
            stem = frame["file_path"].rpartition("/")[2].partition(".")[0]
            frame["file_path"] = f"images/{files[stem]}"

    edit_json(root / "transforms.json", rename)
    return root


@pytest.mark.slow
def test_a_scene_of_mixed_files(mixed):
    found = inspect(mixed)
    assert found.problems == ()
    assert found.mean_iou > 0.9
    shots = dict(zip(names(COUNT), views(COUNT), strict=True))
    for photo in load_scene(mixed).train:
        pixels, _ = load_pixels(photo)
        color, mask = picture(shots[photo.name])
        inside = mask == 255
        expected = srgb_decode(color[inside] / 255)
        assert np.median(np.abs(pixels.color[inside] - expected)) < 0.02, photo.image_path
        if photo.image_path.suffix == ".exr":  # pure colours at 1.0, which is no white to clip at
            assert not pixels.clipped.any()


@pytest.mark.slow
def test_names_without_an_ending_find_every_kind(mixed):
    def strip(data):
        for frame in data["frames"]:
            frame["file_path"] = frame["file_path"].rpartition(".")[0]

    edit_json(mixed / "transforms.json", strip)
    assert len(load_scene(mixed).train) == COUNT - 2


def test_reduced_pixels_of_a_wide_profile_keep_the_files_own_clipping(tmp_path):
    """Display P3's red of .9 is 1.1 in sRGB: bright, but not at the file's white."""
    root = write_nerfstudio(tmp_path / "scene", views(4))
    photo = load_scene(root).train[0]
    samples = np.zeros((60, 72, 3), np.uint8)
    samples[...] = (248, 60, 60)
    samples[:30] = (255, 60, 60)
    Image.fromarray(samples).save(
        photo.image_path, quality=100, subsampling=0, icc_profile=icc("Wide Thing", P3_PRIMARIES, 2.2)
    )
    for side in (None, 36):
        pixels, _ = load_pixels(photo, side)
        seen = pixels.alpha > 0.9
        middle = seen.shape[0] // 2
        assert pixels.color[seen][:, 0].min() > 1.05
        assert pixels.clipped[: middle - 2][seen[: middle - 2]][:, 0].all()
        assert not pixels.clipped[middle + 2 :].any()
        assert not pixels.clipped[..., 1:].any()


@pytest.mark.parametrize("side", [None, 36])
def test_a_gain_map_says_how_bright_the_objects_white_was(tmp_path, side):
    root = write_nerfstudio(tmp_path / "scene", views(4))
    photo = load_scene(root).train[0]
    white, half = np.full((60, 72, 3), 255, np.uint8), np.full((30, 36), 128, np.uint8)
    write_gain_jpeg(photo.image_path, white, half, iso=iso_metadata([(0, 4, 1, 0, 0)]))
    pixels, _ = load_pixels(photo, side)
    seen = pixels.alpha > 0.99
    np.testing.assert_allclose(pixels.color[seen], 2 ** (4 * 128 / 255), rtol=0.01)
    assert not pixels.clipped.any()


def stored(samples, orientation):
    """Upright samples (H, W, ...) as a file of that EXIF orientation stores them."""
    return {1: samples, 3: samples[::-1, ::-1], 6: np.rot90(samples, 1), 8: np.rot90(samples, -1)}[
        orientation
    ]


def test_portrait_and_landscape_in_one_scene(tmp_path):
    """Of other sizes and focal lengths, stored lying, upright or on the head, with masks of three programs."""
    shots = views(COUNT, varied=True)
    root = write_nerfstudio(tmp_path / "scene", shots)
    for index, (name, view) in enumerate(zip(names(COUNT), shots, strict=True)):
        color, mask = picture(view)
        orientation, program = (1, 6, 3, 8)[index % 4], (index // 4) % 3
        exif, own = Image.Exif(), Image.Exif()
        exif[0x0112] = orientation
        options = {"exif": exif, "quality": 100, "subsampling": 0}
        Image.fromarray(stored(color, orientation)).save(root / "images" / f"{name}.jpg", **options)
        if program == 0:  # drawn on stored pixels, without a tag
            Image.fromarray(stored(mask, orientation)).save(root / "masks" / f"{name}.png")
        elif program == 1:  # drawn on the photo as shown, saying so
            own[0x0112] = 1
            Image.fromarray(mask).save(root / "masks" / f"{name}.png", exif=own)
        else:  # with the photo's tag kept
            Image.fromarray(stored(mask, orientation)).save(root / "masks" / f"{name}.png", exif=exif)
    scene = load_scene(root)
    photos = {photo.name: photo for photo in (*scene.train, *scene.test)}
    assert {(photo.camera.width, photo.camera.height) for photo in photos.values()} == {
        (72, 60),
        (60, 72),
        (64, 64),
    }
    for name, view in zip(names(COUNT), shots, strict=True):
        pixels, camera = load_pixels(photos[name])
        color, mask = picture(view)
        np.testing.assert_array_equal(pixels.alpha, mask / 255)
        assert (camera.fx, camera.fy) == view.focal
        expected = srgb_decode(color[mask > 0] / 255)
        assert np.median(np.abs(pixels.color[mask > 0] - expected)) < 0.01, name
