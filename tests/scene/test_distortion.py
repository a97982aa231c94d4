"""Photos taken through lenses that bend: what is loaded is the picture of the pinhole camera that comes with
it.
"""

import json
from dataclasses import replace

import cv2
import numpy as np
import pytest
from PIL import Image

from lightprobe.core.errors import InputError
from lightprobe.imaging import srgb_decode, write_exr
from lightprobe.scene import Camera, load_alpha, load_photo, load_pixels, load_scene
from lightprobe.scene.distortion import Resampling, bilinear, with_lens
from lightprobe.scene.lens import Lens
from lightprobe.scene.photo import Photo
from lightprobe.scene.pixels import load_thumbnail
from lightprobe.scene.record import scene_record
from tests.scene.worlds import edit_json, names, picture, views, write_nerfstudio

BARREL = Lens((-0.25, 0.06))
LENSES = [BARREL, Lens((0.2, 0.0), (0.01, -0.01)), Lens((-0.03, 0.01), fisheye=True)]
SIZE = (288, 240)


def bent_scene(root, lens, count, size=SIZE, **settings):
    """A scene in nerfstudio's layout whose photos and masks were taken through a lens."""
    shots = views(count, zoom=1.2, size=size)
    write_nerfstudio(root, shots)
    straightened = {}  # all cameras have the same intrinsics, and so the same points

    def straighten(points):
        if not straightened:
            straightened["points"] = lens.undistort(points)
        return straightened["points"]

    for name, view in zip(names(count), shots, strict=True):
        color, mask = picture(view, straighten)
        Image.fromarray(color).save(root / "images" / f"{name}.jpg", quality=95, subsampling=0)
        Image.fromarray(mask).save(root / "masks" / f"{name}.png")
    edit_json(root / "transforms.json", lambda data: data.update(settings))
    return root


def bent_photo(path, lens, view):
    """An RGBA photo through a lens, with the camera that `with_lens` gives it."""
    color, mask = picture(view, lens.undistort)
    Image.fromarray(np.dstack([color, mask])).save(path)
    return Photo("a", with_lens(camera_of(view), lens, source="test"), path)


def camera_of(view):
    return Camera(view.opengl, *view.focal, *view.center, view.width, view.height)


def straight(camera, view):
    """The same world by the pinhole camera itself: colour and mask."""
    return picture(replace(view, focal=(camera.fx, camera.fy)))


def same_outline(alpha, mask):
    """Assert that coverage (h, w) and an 8-bit mask agree but for the pixels' size: in area, place, and all
    over.
    """
    mask = mask / 255
    v, u = np.mgrid[: mask.shape[0], : mask.shape[1]]
    assert alpha.sum() == pytest.approx(mask.sum(), rel=0.01)
    for axis in (u, v):
        assert (axis * alpha).sum() / alpha.sum() == pytest.approx((axis * mask).sum() / mask.sum(), abs=0.15)
    rim = np.abs(np.diff(mask, axis=0)).sum() + np.abs(np.diff(mask, axis=1)).sum()
    assert np.abs(alpha - mask).sum() < 0.5 * rim


@pytest.mark.parametrize("lens", LENSES)
def test_the_picture_is_the_pinholes(tmp_path, lens):
    view = views(3, zoom=1.6, size=SIZE)[1]
    photo = bent_photo(tmp_path / "a.png", lens, view)
    pixels, camera = load_pixels(photo)
    assert camera.lens is None
    assert photo.camera.lens.zoom == pytest.approx(camera.fx / view.focal[0])
    color, mask = straight(camera, view)
    same_outline(pixels.alpha, mask)
    inside = (pixels.alpha > 0.999) & (mask == 255)
    assert inside.sum() > 1000
    error = np.abs(pixels.color - srgb_decode(color / 255))[inside].max(axis=-1)
    assert np.mean(error > 0.01) < 0.02  # only where two balls meet
    with pytest.raises(AssertionError):  # without the lens it is seen to be missing
        same_outline(picture(view, lens.undistort)[1] / 255, picture(view)[1])


@pytest.mark.parametrize("lens", LENSES)
def test_smaller_pictures_are_those_of_the_whole(tmp_path, lens):
    photo = bent_photo(tmp_path / "a.png", lens, views(3, zoom=1.6, size=SIZE)[1])
    whole, _ = load_pixels(photo)
    small, camera = load_pixels(photo, 96)
    expected = whole.resized(80, 96)
    assert (camera.width, camera.height) == (96, 80)
    np.testing.assert_allclose(small.alpha, expected.alpha, atol=1e-5)
    np.testing.assert_allclose(
        small.color * small.alpha[..., None], expected.color * expected.alpha[..., None], atol=1e-4
    )
    np.testing.assert_array_equal(small.clipped, expected.clipped)
    np.testing.assert_allclose(load_alpha(photo, 96), small.alpha, atol=1e-6)
    np.testing.assert_allclose(load_thumbnail(photo, 96)[1], small.alpha, atol=1e-6)


def test_what_the_photo_does_not_show_is_not_covered(tmp_path):
    """Pincushion: the pinhole's picture reaches beyond the photo, whose object goes up to its borders."""
    view = views(3, zoom=1.6, size=SIZE)[1]
    photo = bent_photo(tmp_path / "a.png", Lens((0.4,)), view)
    opaque = np.full((*SIZE[::-1], 4), 255, np.uint8)
    Image.fromarray(opaque).save(photo.image_path)
    pixels, _ = load_pixels(photo)
    assert pixels.alpha[0, 0] == pixels.alpha[-1, -1] == 0
    assert pixels.alpha[120, 144] == 1
    assert (pixels.color[pixels.alpha == 0] == 0).all()
    assert pixels.clipped[120, 144].all()
    assert not pixels.clipped[0, 0].any()


def test_no_background_bleeds_into_the_object(tmp_path):
    """A grey object on green: wherever it covers a pixel in part, the colour is its own."""
    view = views(3, zoom=1.6, size=SIZE)[1]
    photo = bent_photo(tmp_path / "a.png", BARREL, view)
    mask = np.asarray(Image.open(photo.image_path))[..., 3]
    color = np.where(mask[..., None] > 0, (120, 120, 120), (0, 255, 0)).astype(np.uint8)
    Image.fromarray(np.dstack([color, mask])).save(photo.image_path)
    pixels, _ = load_pixels(photo)
    part = (pixels.alpha > 0.05) & (pixels.alpha < 0.95)
    assert part.sum() > 200
    np.testing.assert_allclose(pixels.color[part], srgb_decode(120 / 255), rtol=1e-3)
    assert not pixels.clipped.any()


def test_the_middles_of_the_edges_stay_in_the_picture():
    """What lies at the middle of a photo's edge: at or within the edges of the picture, at one of them
    exactly.
    """
    camera = camera_of(views(3, zoom=1.6, size=SIZE)[1])
    for lens in (BARREL, LENSES[2]):
        bent = with_lens(camera, lens, source="test")
        edges = np.array([[0, 120], [288, 120], [144, 0], [144, 240]])
        plane = lens.undistort((edges - (camera.cx, camera.cy)) / (camera.fx, camera.fy))
        found = plane * (bent.fx, bent.fy) + (bent.cx, bent.cy)
        beyond = np.maximum(np.maximum(-found, found - SIZE).max(axis=1), -20)
        assert beyond.max() == pytest.approx(0, abs=1e-3)


def test_a_wide_fisheye_keeps_half_of_its_focal_length():
    camera = replace(camera_of(views(3, size=SIZE)[1]), fx=100.0, fy=100.0)
    bent = with_lens(camera, Lens(fisheye=True), source="test")
    assert bent.fx == 50
    _, shown = Resampling(bent).places(0, 240)
    assert shown[120].all()


def test_a_picture_of_rows_is_the_same(tmp_path):
    camera = with_lens(camera_of(views(3, size=SIZE)[1]), BARREL, source="test")
    resampling = Resampling(camera)
    whole, shown = resampling.places(0, 240)
    part, some = resampling.places(100, 130)
    np.testing.assert_array_equal(whole[100:130], part)
    np.testing.assert_array_equal(shown[100:130], some)


@pytest.mark.parametrize("lens", LENSES)
@pytest.mark.parametrize("width", [72, 1200])
def test_places_between_knots_are_those_of_the_lens(lens, width):
    view = views(3, size=(width, round(width * 5 / 6)))[1]
    camera = with_lens(camera_of(view), lens, source="test")
    places, shown = Resampling(camera).places(0, camera.height)
    v, u = np.mgrid[: camera.height, :width] + 0.5
    points = np.stack([(u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy], -1)
    exact = lens.distort(points) * np.array(view.focal) + view.center
    size = np.array([width, camera.height])
    np.testing.assert_allclose(places[shown], np.clip(exact, 0.5, size - 0.5)[shown], atol=0.03)
    inside = ((exact > 0.1) & (exact < size - 0.1)).all(-1)
    assert shown[inside].all()
    assert not shown[((exact < -0.1) | (exact > size + 0.1)).any(-1)].any()


def test_of_a_wide_lens_that_folds_beyond_the_pinholes_edges_the_picture_ends_before_the_fold():
    """A fisheye lens of 94 degrees down to the edges, as x (1 + k r^2): its photo reaches beyond the fold."""
    camera = replace(camera_of(views(3, size=SIZE)[1]), fx=150.0, fy=150.0)
    lens = Lens((-0.35,))
    fold = lens.fold_radius()
    assert (
        lens.distort(np.array([fold, 0.0]))[0] < 144 / 150 < fold
    )  # in the photo; beyond the edge of a pinhole
    bent = with_lens(camera, lens, source="test")
    assert bent.fx == pytest.approx(150 * 144 / 150 / fold)
    places, shown = Resampling(bent).places(0, 240)
    assert shown[120].mean() > 0.98
    assert (np.diff(places[120, :, 0][shown[120]]) > 0).all()
    with pytest.raises(InputError, match="folds the picture over"):
        with_lens(camera, Lens((-0.4,)), source="test")


def test_bilinear_is_exact_on_a_plane():
    v, u = np.mgrid[:30, :40] + 0.5
    planes = np.stack([3 * u - 2 * v, np.ones_like(u)], axis=-1).astype(np.float32)
    places = np.random.default_rng(1).uniform((0.5, 10.5), (39.5, 29.5), (50, 2))
    found = bilinear(planes[10:], 10, places)
    np.testing.assert_allclose(found[:, 0], 3 * places[:, 0] - 2 * places[:, 1], atol=1e-4)
    np.testing.assert_allclose(found[:, 1], 1, atol=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("lens", "settings"),
    [
        (BARREL, {"k1": -0.25, "k2": 0.06}),
        (LENSES[2], {"camera_model": "OPENCV_FISHEYE", "k1": -0.03, "k2": 0.01}),
    ],
)
def test_a_scene_of_bent_photos(tmp_path, lens, settings):
    """Every mask is the one that the pinhole camera of its photo sees."""
    root = bent_scene(tmp_path / "scene", lens, 4, **settings)
    shots = dict(zip(names(4), views(4, zoom=1.2, size=SIZE), strict=True))
    for photo in load_scene(root).train:
        same_outline(load_alpha(photo), straight(photo.camera, shots[photo.name])[1])


@pytest.mark.slow
def test_a_run_remembers_the_lens(tmp_path):
    """What scene.json says of a photo of the scene is enough to read it again."""
    scene = load_scene(bent_scene(tmp_path / "scene", BARREL, 4, k1=-0.25, k2=0.06))
    photo = scene.train[0]
    (tmp_path / "scene.json").write_text(json.dumps(scene_record(scene)))
    pixels, camera = load_photo(photo.image_path, tmp_path / "scene.json", photo.mask_path)
    expected, own = load_pixels(photo)
    np.testing.assert_array_equal(pixels.color, expected.color)
    assert camera.to_json() == own.to_json()


@pytest.mark.parametrize("degrees", [(0, 0), (25, 0), (0, -20), (-30, 18)])
def test_a_known_ray_of_a_fisheye_lens(tmp_path, degrees):
    """A spot where OpenCV's fisheye model puts a ray is where the pinhole camera of the photo puts it."""
    size, focal, coefficients = (160, 120), 70.0, (0.05, -0.01, 0.004, -0.001)
    ray = np.tan(np.radians(np.array(degrees, float)))
    bent = cv2.fisheye.distortPoints(ray[None, None], np.eye(3), np.array(coefficients))[0, 0]
    spot = bent * focal + (size[0] / 2, size[1] / 2)
    v, u = np.mgrid[: size[1], : size[0]] + 0.5
    light = np.exp(-((u - spot[0]) ** 2 + (v - spot[1]) ** 2) / 18).astype(np.float32)
    write_exr(tmp_path / "a.exr", np.dstack([light, light, light, np.ones_like(light)]))
    frame = {"file_path": "a.exr", "transform_matrix": views(1)[0].opengl.tolist()}
    told = dict(zip(("k1", "k2", "k3", "k4"), coefficients, strict=True))
    told |= {"camera_model": "OPENCV_FISHEYE", "fl_x": focal, "fl_y": focal, "w": size[0], "h": size[1]}
    told |= {"cx": size[0] / 2, "cy": size[1] / 2, "frames": [frame]}
    (tmp_path / "transforms.json").write_text(json.dumps(told))
    pixels, camera = load_photo(tmp_path / "a.exr", tmp_path / "transforms.json")
    seen = pixels.color[..., 0] * (pixels.color[..., 0] > 0.3)
    found = np.array([(u * seen).sum(), (v * seen).sum()]) / seen.sum()
    expected = ray * (camera.fx, camera.fy) + (camera.cx, camera.cy)
    assert camera.fx < focal
    np.testing.assert_allclose(found, expected, atol=0.35)
    assert np.linalg.norm(expected - spot) > 4 or degrees == (0, 0)
