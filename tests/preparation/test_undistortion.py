"""Photos stay as their lenses took them, masks are of the same pixels, and a reader gets what it got of straightened ones."""

import itertools
from dataclasses import replace

import numpy as np
import pytest
from PIL import Image

from lightprobe.core.errors import InputError
from lightprobe.core.files import checksum
from lightprobe.imaging import read_mask, srgb_decode
from lightprobe.preparation.mapping import bent
from lightprobe.preparation.photos import SourcePhoto
from lightprobe.preparation.undistortion import (
    photo_mask,
    pinhole_camera,
    pinhole_place,
    small_mask,
    through_lens,
    undistorted,
)
from lightprobe.preparation.writing import copy_photos, write_masks, write_transforms
from lightprobe.scene import load_pixels, load_scene
from lightprobe.scene.camera import Camera
from lightprobe.scene.consistency import overlap
from lightprobe.scene.inspect import inspect
from lightprobe.scene.lens import Lens
from tests.preparation.ring import SIZE, ring_cameras
from tests.scene.worlds import names, picture, views

cv2 = pytest.importorskip("cv2")
K = -0.2
WIDTH, HEIGHT, COUNT = 288, 240, 8
SHOTS = views(COUNT, zoom=1.2, size=(WIDTH, HEIGHT))


def camera_of(view) -> Camera:
    return Camera(view.opengl, *view.focal, *view.center, view.width, view.height)


def shown_by(camera, view):
    """Return what a pinhole camera at a view's place shows: colour and mask."""
    return picture(replace(view, focal=(camera.fx, camera.fy)))


@pytest.fixture(scope="module")
def photos():
    """Colours (H, W, 3) uint8 of each view through the lens."""
    plane = {}  # all cameras have the same intrinsics, and so the same points

    def straighten(points):
        if not plane:
            plane["points"] = Lens((K,)).undistort(points)
        return plane["points"]

    return [picture(view, straighten)[0] for view in SHOTS]


def kept_scene(root, photos, turn=1):
    """A scene as prepare writes it, of photos stored turned by EXIF orientation 1 or 6, masks found at half the size."""
    (root / "photos").mkdir(parents=True)
    sources, cameras, masks = {}, {}, {}
    for name, color, view in zip(names(COUNT), photos, SHOTS, strict=True):
        path, exif = root / "photos" / f"{name}.png", Image.Exif()
        exif[0x0112] = turn
        Image.fromarray(np.rot90(color) if turn == 6 else color).save(path, exif=exif)
        sources[name] = SourcePhoto(name, path, WIDTH, HEIGHT, checksum(path), None, None, False)
        cameras[name] = through_lens(camera_of(view), K)
        small = pinhole_camera(camera_of(view), K, name).resized(WIDTH // 2, HEIGHT // 2)
        found = shown_by(
            small, replace(view, width=small.width, height=small.height, center=(small.cx, small.cy))
        )
        masks[name] = photo_mask(found[1] > 0, small, HEIGHT, WIDTH)
    files = copy_photos(sources, root / "images")
    write_masks(masks, masks.__getitem__, {}, root / "masks")
    write_transforms(root / "transforms.json", cameras, files, {}, {})
    return root


def straightened_scene(root, photos):
    """The same photos resampled to pinholes of their own focal length and written anew, with masks of these."""
    (root / "images").mkdir(parents=True)
    cameras, masks = {name: camera_of(view) for name, view in zip(names(COUNT), SHOTS, strict=True)}, {}
    rows, columns = np.mgrid[:HEIGHT, :WIDTH] + 0.5
    for (name, camera), color, view in zip(cameras.items(), photos, SHOTS, strict=True):
        at = bent(np.stack([columns.ravel(), rows.ravel()], 1), camera, K).reshape(HEIGHT, WIDTH, 2) - 0.5
        straight = cv2.remap(color, at.astype(np.float32), None, cv2.INTER_CUBIC)
        Image.fromarray(straight).save(root / "images" / f"{name}.png")
        small = camera.resized(WIDTH // 2, HEIGHT // 2)
        found = shown_by(
            small, replace(view, width=small.width, height=small.height, center=(small.cx, small.cy))
        )
        masks[name] = photo_mask(found[1] > 0, small, HEIGHT, WIDTH)
    write_masks(masks, masks.__getitem__, {}, root / "masks")
    write_transforms(root / "transforms.json", cameras, {name: f"{name}.png" for name in cameras}, {}, {})
    return root


def loaded(root):
    scene = load_scene(root)
    return {photo.name: load_pixels(photo) for photo in (*scene.train, *scene.test)}


def differences(root):
    """Return the mean error of colour on the object, and the IoU of masks with the truth, of all photos of a scene."""
    colors, overlaps = [], []
    for view, (pixels, camera) in zip(SHOTS, (loaded(root)[name] for name in names(COUNT)), strict=True):
        color, mask = shown_by(camera, view)
        both = (mask > 0) & (pixels.alpha > 0.99)
        assert both.sum() > 500
        colors.append(np.abs(pixels.color - srgb_decode(color / 255))[both].mean())
        overlaps.append(overlap(pixels.alpha >= 0.5, mask > 0))
    return np.array(colors), np.array(overlaps)


def test_photos_as_they_are_load_as_straightened_ones_do(tmp_path, photos):
    """Colour, masks, and how masks agree with their hull; without the lens all of it is worse."""
    kept = kept_scene(tmp_path / "kept", photos)
    straight = straightened_scene(tmp_path / "straight", photos)
    (colors, overlaps), (before, overlaps_before) = differences(kept), differences(straight)
    assert colors.mean() < before.mean() + 0.002
    assert overlaps.mean() > overlaps_before.mean() - 0.005
    assert overlaps.min() > 0.97
    agreement, agreement_before = inspect(kept).mean_iou, inspect(straight).mean_iou
    assert agreement > agreement_before - 0.005
    text = (kept / "transforms.json").read_text()
    (kept / "transforms.json").write_text(text.replace(f'"k1": {K}', '"k1": 0.0'))
    assert differences(kept)[1].mean() < overlaps.mean() - 0.01


def test_a_photo_that_is_stored_turned_stays_so_and_loads_alike(tmp_path, photos):
    plain, turned = kept_scene(tmp_path / "plain", photos), kept_scene(tmp_path / "turned", photos, turn=6)
    name = names(COUNT)[0]
    assert Image.open(turned / "images" / f"{name}.png").size == (HEIGHT, WIDTH)
    assert read_mask(turned / "masks" / f"{name}.png").shape == (HEIGHT, WIDTH)
    for (one, camera), (other, same) in zip(loaded(plain).values(), loaded(turned).values(), strict=True):
        np.testing.assert_array_equal(one.color, other.color)
        np.testing.assert_array_equal(one.alpha, other.alpha)
        assert camera.to_json() == same.to_json()


@pytest.mark.parametrize("k", [-0.2, -0.05, 0.0, 0.2])
@pytest.mark.parametrize("scale", [1, 4])
def test_a_mask_comes_back_from_its_photo_as_it_was_found(k, scale):
    camera = pinhole_camera(replace(ring_cameras(1)[0], fx=150.0, fy=150.0), k, "a")  # a wide lens
    rows, columns = np.mgrid[:SIZE, :SIZE]
    mask = (np.abs(rows - 45) < 25) & (np.abs(columns - 155) < 25)  # away from the middle
    written = photo_mask(mask, camera, scale * SIZE, scale * SIZE)
    assert written.shape == (scale * SIZE, scale * SIZE)
    returned = overlap(small_mask(written, camera), mask)
    assert returned > 0.97
    plain = overlap(photo_mask(mask, replace(camera, lens=None), SIZE, SIZE) >= 0.5, mask)
    assert plain == 1
    if abs(k) == 0.2:
        assert overlap(photo_mask(mask, camera, SIZE, SIZE) >= 0.5, mask) < returned - 0.02


def test_a_mask_that_reaches_the_borders_of_the_picture_reaches_those_of_the_photo():
    camera = pinhole_camera(ring_cameras(1)[0], -0.2, "a")
    assert photo_mask(np.ones((SIZE, SIZE), bool), camera, 2 * SIZE, 2 * SIZE).min() == 1


def test_a_small_mask_grows_in_place():
    mask = np.zeros((40, 40), bool)
    mask[10:30, 5:20] = True
    large = photo_mask(mask, ring_cameras(1)[0].resized(40, 40), 160, 160)
    assert ((large >= 0.5) != np.kron(mask, np.ones((4, 4), bool))).mean() < 0.003
    assert large.max() == 1


def test_a_pinholes_picture_shows_what_its_lens_showed_elsewhere():
    own = ring_cameras(1)[0]
    rows, columns = np.mgrid[:SIZE, :SIZE] + 0.5
    for k in (-0.2, 0.15):
        camera = pinhole_camera(own, k, "a")
        found = [undistorted(each.astype(np.float32), camera)[90, 60] for each in (columns, rows)]
        x, y = (60.5 - own.cx) / camera.fx * own.fx + own.cx, (90.5 - own.cy) / camera.fy * own.fy + own.cy
        assert found == pytest.approx(bent(np.array([[x, y]]), own, k)[0], abs=0.03)
    color = np.dstack([columns, rows, rows]).astype(np.uint8)
    assert undistorted(color, camera).shape == color.shape
    assert (undistorted(color, camera)[0, 0] == 0).all()  # pincushion: beyond the photo
    assert undistorted(color, own) is color


@pytest.mark.parametrize("k", [-0.2, 0.0, 0.15])
def test_a_place_in_a_photo_is_found_in_its_pinholes_picture(k):
    camera = pinhole_camera(ring_cameras(1)[0], k, "a")
    for across, down in itertools.product((0.2, 0.5, 0.7), repeat=2):
        mask = np.zeros((SIZE, SIZE), bool)
        x, y = pinhole_place((across, down), camera)
        mask[int(y * SIZE) - 2 : int(y * SIZE) + 3, int(x * SIZE) - 2 : int(x * SIZE) + 3] = True
        rows, columns = np.nonzero(photo_mask(mask, camera, SIZE, SIZE) >= 0.5)
        assert (columns.mean() + 0.5) / SIZE == pytest.approx(across, abs=0.006)
        assert (rows.mean() + 0.5) / SIZE == pytest.approx(down, abs=0.006)


def test_a_lens_that_folds_the_picture_over_is_one_sentence():
    with pytest.raises(
        InputError, match=r"found for the photo IMG_1 folds its picture over, as no lens does;"
    ):
        pinhole_camera(ring_cameras(1)[0], -5.0, "IMG_1")
