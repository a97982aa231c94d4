"""Lenses against OpenCV and COLMAP, and back."""

import cv2
import numpy as np
import pycolmap
import pytest

from lightprobe.core.errors import InputError
from lightprobe.scene import colmap
from lightprobe.scene.lens import Lens

RNG = np.random.default_rng(6)
POINTS = RNG.uniform(-0.6, 0.6, (200, 2))
# COLMAP's model and parameters behind focal lengths and principal point, the same lens
COLMAP = [
    ("SIMPLE_RADIAL", (-0.12,), Lens((-0.12,))),
    ("RADIAL", (-0.2, 0.05), Lens((-0.2, 0.05))),
    ("OPENCV", (-0.2, 0.05, 0.003, -0.002), Lens((-0.2, 0.05), (0.003, -0.002))),
    (
        "FULL_OPENCV",
        (0.3, -0.1, 0.003, -0.002, 0.02, 0.4, 0.01, 0.02),
        Lens((0.3, -0.1, 0.02), (0.003, -0.002), (0.4, 0.01, 0.02)),
    ),
    ("SIMPLE_RADIAL_FISHEYE", (-0.05,), Lens((-0.05,), fisheye=True)),
    ("RADIAL_FISHEYE", (-0.05, 0.01), Lens((-0.05, 0.01), fisheye=True)),
    ("OPENCV_FISHEYE", (-0.05, 0.01, 0.002, -0.001), Lens((-0.05, 0.01, 0.002, -0.001), fisheye=True)),
    (
        "THIN_PRISM_FISHEYE",
        (-0.05, 0.01, 0.002, -0.001, 0.003, 0.001, 0.004, -0.003),
        Lens((-0.05, 0.01, 0.003, 0.001), (0.002, -0.001), prism=(0.004, -0.003), fisheye=True),
    ),
    ("FOV", (0.9,), Lens(fov=0.9)),
    ("SIMPLE_FISHEYE", (), Lens(fisheye=True)),
    ("FISHEYE", (), Lens(fisheye=True)),
    (
        "RAD_TAN_THIN_PRISM_FISHEYE",
        (-0.05, 0.01, 0.003, 0.001, -0.002, 0.0005, 0.002, -0.001, 0.004, -0.001, -0.003, 0.0015),
        Lens(
            (-0.05, 0.01, 0.003, 0.001, -0.002, 0.0005),
            (-0.001, 0.002),
            prism=(0.004, -0.003),
            prism_fourth=(-0.001, 0.0015),
            fisheye=True,
            radial_first=True,
        ),
    ),
]
PRISM = Lens((0.3, -0.1, 0.02), (0.003, -0.002), (0.4, 0.01, 0.02), (0.01, -0.006), (0.004, 0.008))
LENSES = [*(lens for _, _, lens in COLMAP), PRISM]


@pytest.mark.parametrize(("model", "parameters", "lens"), COLMAP)
def test_points_fall_where_colmap_puts_them(model, parameters, lens):
    focal = (500.0,) if model.startswith(("SIMPLE", "RADIAL")) else (500.0, 500.0)
    camera = pycolmap.Camera(model=model, width=800, height=600, params=[*focal, 400.0, 300.0, *parameters])
    expected = np.asarray(camera.img_from_cam(np.column_stack([POINTS, np.ones(len(POINTS))])))
    np.testing.assert_allclose(lens.distort(POINTS) * 500 + (400, 300), expected, atol=1e-6)
    assert colmap._LENSES[model](*parameters) == lens
    assert colmap._NAMES[int(camera.model)] == model
    assert colmap._COUNTS[model] == len(camera.params)


def test_points_fall_where_opencv_puts_them():
    world = np.column_stack([POINTS, np.ones(len(POINTS))])
    k1, k2, p1, p2, k3, k4, k5, k6 = 0.3, -0.1, 0.003, -0.002, 0.02, 0.4, 0.01, 0.02
    expected = cv2.projectPoints(
        world, np.zeros(3), np.zeros(3), np.eye(3), np.array([k1, k2, p1, p2, k3, k4, k5, k6])
    )
    lens = Lens((k1, k2, k3), (p1, p2), (k4, k5, k6))
    np.testing.assert_allclose(lens.distort(POINTS), expected[0][:, 0], atol=1e-12)
    prisms = np.array([k1, k2, p1, p2, k3, k4, k5, k6, 0.01, 0.004, -0.006, 0.008])  # x's two, then y's
    expected = cv2.projectPoints(world, np.zeros(3), np.zeros(3), np.eye(3), prisms)
    np.testing.assert_allclose(PRISM.distort(POINTS), expected[0][:, 0], atol=1e-12)
    fisheye = np.array([-0.05, 0.01, 0.002, -0.001])
    expected = cv2.fisheye.distortPoints(POINTS[:, None], np.eye(3), fisheye)
    np.testing.assert_allclose(Lens(tuple(fisheye), fisheye=True).distort(POINTS), expected[:, 0], atol=1e-9)


@pytest.mark.parametrize("lens", LENSES)
def test_there_and_back(lens):
    np.testing.assert_allclose(lens.undistort(lens.distort(POINTS)), POINTS, atol=1e-9)


def test_what_no_point_is_moved_to_has_no_origin():
    """x - .3 x^3 never exceeds .70, at x = 1.054, where the lens folds."""
    lens = Lens((-0.3,))
    assert np.isnan(lens.undistort(np.array([[0.8, 0.0]]))).all()
    assert lens.fold_radius() == pytest.approx(np.sqrt(1 / 0.9), abs=0.02)
    assert Lens((0.1,)).fold_radius() == np.inf
    assert Lens((-0.05,), fisheye=True).fold_radius() == np.inf


@pytest.mark.parametrize("lens", LENSES)
def test_as_json(lens):
    assert Lens.from_json(lens.to_json(), source="a.json") == lens


@pytest.mark.parametrize(
    "change",
    [
        {"radial": [1] * 7},
        {"radial": "x"},
        {"tangential": [0]},
        {"zoom": 0},
        {"prism": [float("nan"), 0]},
        {"rational": None},
        {"prism_fourth": [1]},
        {"fov": float("inf")},
        {"radial_first": "no"},
    ],
)
def test_odd_json(change):
    with pytest.raises(InputError, match=r"a\.json: the lens .*\.$"):
        Lens.from_json(Lens().to_json() | change, source="a.json")
