"""What a frame of a transforms file says against what its file says for all frames, and settings that are no cameras."""

import json
import warnings

import numpy as np
import pytest
from PIL import Image

from lightprobe.core.errors import InputError, LightprobeWarning
from lightprobe.scene import read_camera
from lightprobe.scene.frame import Problems
from lightprobe.scene.loading import read_folder

W, H = 64, 48
POSE = np.eye(4)
POSE[:3, 3] = (0.5, -1.5, 4.0)


def angle(focal, extent):
    return 2 * np.arctan(0.5 * extent / focal)


def write(root, common, frame, size=(W, H)):
    """Write three photos whose frames say `frame`, beside a fourth that says nothing of its own."""
    (root / "images").mkdir(parents=True)
    frames = []
    for name in "abcd":
        Image.new("RGBA", size, (9, 9, 9, 255)).save(root / "images" / f"{name}.png")
        own = frame if name != "d" else {}
        frames.append({"file_path": f"images/{name}.png", "transform_matrix": POSE.tolist(), **own})
    (root / "transforms.json").write_text(json.dumps({**common, "frames": frames}))
    return root


def cameras(root):
    """Return the cameras of the frame with settings of its own and of the one without."""
    photos = sorted(read_folder(root, Problems()).all_photos(), key=lambda photo: photo[1].name)
    return photos[0][1].camera, photos[3][1].camera


A50 = {"camera_angle_x": angle(50, W)}
CASES = {
    "angle over focal lengths": ({"fl_x": 80, "fl_y": 81}, A50, (50, 50)),
    "angle over one focal length": ({"fl_x": 80}, A50, (50, 50)),
    "focal length over angle": (A50, {"fl_x": 70}, (70, 70)),
    "focal length over angles": ({**A50, "camera_angle_y": angle(50, H)}, {"fl_x": 70}, (70, 70)),
    "focal length over both": (
        {"fl_x": 80, "fl_y": 81, "camera_angle_x": angle(80, W)},
        {"fl_x": 70},
        (70, 70),
    ),
    "two over two": ({"fl_x": 80, "fl_y": 81}, {"fl_x": 70, "fl_y": 72}, (70, 72)),
    "two angles over two": (
        {"fl_x": 80, "fl_y": 81},
        {**A50, "camera_angle_y": angle(52, H)},
        (50, 52),
    ),
    "down alone": ({"fl_x": 80, "fl_y": 81}, {"fl_y": 82}, (80, 82)),
    "angle down alone": ({"fl_x": 80, "fl_y": 81}, {"camera_angle_y": angle(82, H)}, (80, 82)),
    "across in the frame, down in the file": ({"fl_y": 81, "camera_angle_x": None}, {"fl_x": 80}, (80, 81)),
    "degrees of instant-ngp": ({"fl_x": 80}, {"x_fov": np.degrees(angle(50, W))}, (50, 50)),
    "null says nothing": ({"fl_x": 80}, {"fl_x": None, "camera_angle_x": None}, (80, 80)),
    "both in the frame": ({}, {"fl_x": 70, "fl_y": 71, **A50}, (70, 71)),
}


@pytest.mark.parametrize("kind", CASES)
def test_the_frame_s_focal_length_goes_first(tmp_path, kind):
    common, frame, expected = CASES[kind]
    complete = {"fl_x": 33, **common} if kind in ("both in the frame",) else common
    write(tmp_path / "scene", complete, frame)
    if kind.startswith("across in"):  # the fourth photo has none across
        data = json.loads((tmp_path / "scene/transforms.json").read_text())
        data["frames"].pop()
        (tmp_path / "scene/transforms.json").write_text(json.dumps(data))
        photos = read_folder(tmp_path / "scene", Problems()).all_photos()
        found = photos[0][1].camera
    else:
        found, other = cameras(tmp_path / "scene")
        default = complete.get("fl_x") or 50
        assert other.fx == pytest.approx(default)
    assert (found.fx, found.fy) == pytest.approx(expected)
    named = read_camera(tmp_path / "scene/transforms.json", tmp_path / "scene/images/a.png", (W, H))
    assert (named.fx, named.fy) == pytest.approx(expected)


@pytest.mark.parametrize(("key", "common", "own"), [("cx", 30.0, 33.5), ("cy", 20.0, 25.5)])
def test_the_frame_s_principal_point_goes_first(tmp_path, key, common, own):
    found, other = cameras(write(tmp_path / "scene", {"fl_x": 80, key: common}, {key: own}))
    assert (getattr(found, key), getattr(other, key)) == (own, common)


def test_the_frame_s_size_goes_first(tmp_path):
    """The camera is scaled to the photo from the size that it was estimated for."""
    common, frame = {"fl_x": 80, "w": 10 * W, "h": 10 * H}, {"w": 2 * W, "h": 2 * H}
    found, other = cameras(write(tmp_path / "scene", common, frame))
    assert (found.fx, other.fx) == pytest.approx((40, 8))


def test_the_frame_s_lens_goes_first(tmp_path):
    common = {"fl_x": 60, "k1": 0.3, "p1": 0.01, "camera_model": "OPENCV"}
    found, other = cameras(write(tmp_path / "a", common, {"k1": -0.1, "p1": 0.0}))
    assert (found.lens.radial[0], found.lens.tangential) == (-0.1, (0, 0))
    assert (other.lens.radial[0], other.lens.tangential) == (0.3, (0.01, 0))
    found, other = cameras(write(tmp_path / "b", common, {"camera_model": "opencv_fisheye"}))
    assert (found.lens.fisheye, other.lens.fisheye) == (True, False)


def test_what_other_programs_need_moves_no_camera(tmp_path):
    """The poses of nerfstudio have its `applied_transform` in them; `scale` and `offset` are instant-ngp's box."""
    extra = {
        "applied_transform": [[1, 0, 0, 3], [0, 0, 1, 4], [0, -1, 0, 5]],
        "applied_scale": 0.1,
        "aabb_scale": 16,
        "scale": 0.33,
        "offset": [0.5, 0.5, 0.5],
        "ply_file_path": "sparse_pc.ply",
        "orientation_override": "none",
        "frames_are_sorted": True,
        "sharpness": 3,
    }
    frame = {"colmap_im_id": 3, "sharpness": 20.1, "depth_file_path": "depths/a.png"}
    found, _ = cameras(write(tmp_path / "scene", {"fl_x": 60, **extra}, frame))
    np.testing.assert_array_equal(found.camera_to_world, POSE)


@pytest.mark.parametrize(
    ("common", "frame", "said"),
    [
        (
            {},
            {"camera_angle_x": 39.6},
            "'camera_angle_x' must be in radians, not 39.6; 39.6 degrees are 0.69115.",
        ),
        ({}, {"camera_angle_x": 0.7, "camera_angle_y": 40}, "'camera_angle_y' must be in radians, not 40"),
        (
            {"fl_x": 60},
            {"transform_matrix": POSE.T.tolist()},
            "the last row of 'transform_matrix' must be 0, 0, 0, 1",
        ),
        ({"fl_x": 60}, {"transform_matrix": POSE.ravel().tolist()}, "must be a 4x4 matrix of numbers"),
        ({"fl_x": 60, "latlong": True}, {}, "has the camera model LATLONG, which is not read"),
        ({"fl_x": 60}, {"ftheta_p0": 0.0}, "has the camera model FTHETA_P0, which is not read"),
        ({"fl_x": 60}, {"camera_model": "FISHEYE624"}, "has the camera model FISHEYE624, which is not read"),
        (
            {"w": 6000, "h": 4500, "fl_x": 35},
            {},
            "no lens has a focal length of 35 pixels for 6000 x 4500; give it in",
        ),
        ({"fl_x": 1.1, "cx": 0.5, "cy": 0.5}, {}, "no lens has a focal length of 1.1 pixels for 64 x 48"),
        ({"fl_x": "60"}, {}, "'fl_x' must be a finite number, not '60'"),
        ({"fl_x": "60,5"}, {}, "'fl_x' must be a finite number, not '60,5'"),
    ],
)
def test_settings_that_are_no_camera(tmp_path, common, frame, said):
    with pytest.raises(InputError) as caught:
        cameras(write(tmp_path / "scene", common, frame))
    assert said in str(caught.value)


def test_a_field_of_view_and_a_focal_length_of_two_cameras(tmp_path):
    """As of photos that were made smaller, without `w`."""
    common = {"fl_x": 640.0, "camera_angle_x": angle(80, W)}
    root = write(tmp_path / "scene", common, {})
    said = r"'fl_x' is 640 pixels, but 'camera_angle_x' means 80 of a width of 64; 'fl_x' is taken"
    with pytest.warns(LightprobeWarning, match=said):
        assert cameras(root)[0].fx == 640
    write(tmp_path / "sound", {**common, "w": 8 * W, "h": 8 * H}, {})
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert cameras(tmp_path / "sound")[0].fx == 80
