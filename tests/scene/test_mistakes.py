"""One mistake in a sound scene is named with the photos that have it and the remedy, and nothing else is."""

import numpy as np
import pytest

from tests.scene.demo_shots import demo_shots, every, inverted, posed, some, turned, turned_mask
from tests.scene.mistakes import (
    EITHER,
    IOU,
    OPENCV,
    PYTORCH3D,
    THIRD,
    Y_UP,
    Turn,
    as_stored,
    found,
    half_turned_photo,
    moved,
    numbered,
    one_left_out,
    reordered,
    stored_on_its_side,
    third,
    told,
    transposed,
)

SUFFIX = r" for each camera-to-world matrix m\)\."
AXES = r"negate the {} and third column of each camera-to-world matrix m \({}\)\."
WORLD = r"The matrices of the cameras of all 20 photos look like world-to-camera"
ROTATIONS = r"The rotations of the cameras of all 20 photos look like world-to-camera"
POSITIONS = r"The positions of the cameras of "
TRANSPOSE = r"transpose the rotation of each matrix m \(m\[:3, :3\] = m\[:3, :3\]\.T"

CASES = {
    "masks inverted": (
        every(inverted),
        rf"The masks of all 20 photos look inverted {IOU}: the object must be white \(or opaque\) and all else black "
        r"\(or transparent\); `mogrify -negate masks/\*\.png` inverts them\.",
    ),
    "some masks inverted": (
        some(inverted, third),
        rf"The masks of {THIRD} look inverted {IOU}: .*`mogrify -negate masks/p00\.png .* masks/p18\.png` .*",
    ),
    "most masks inverted": (
        some(inverted, lambda index: not third(index)),
        rf"The masks of 13 of 20 photos \(p01, p02, .* and 1 more\) look inverted {IOU}: .*",
    ),
    "upright masks of tagged photos": (
        every(half_turned_photo),
        rf"The masks of all 20 photos are upright and the photos are not, whose EXIF orientation 3 turns both {IOU}: "
        r"turn the photos themselves, `mogrify -auto-orient images/\*\.jpg`\.",
    ),
    "some upright masks of tagged photos": (
        some(half_turned_photo, third),
        rf"The masks of {THIRD} are upright and the photos are not, whose EXIF orientation 3 turns both .*images/p18\.jpg`\.",
    ),
    "upright masks of photos on their side": (
        every(stored_on_its_side),
        rf"The masks of all 20 photos are upright and the photos are not, whose EXIF orientation 6 turns both {IOU}: .*",
    ),
    "cameras for stored pixels": (
        every(as_stored),
        rf"The cameras of all 20 photos are for the photos as stored, which their EXIF orientation 3 turns {IOU}: take "
        r"it out, `exiftool -n -Orientation=1 images/\*\.jpg`, or estimate the cameras from the photos turned upright\.",
    ),
    "some cameras for stored pixels": (
        some(as_stored, third),
        rf"The cameras of {THIRD} are for the photos as stored, which their EXIF orientation 3 turns {IOU}: .*",
    ),
    "half of the cameras for stored pixels": (
        some(as_stored, lambda index: index < 10),
        r"The cameras of 10 of 20 photos \(p00, .*, p09\) are for the photos as stored, .*",
    ),
    "masks upside down": (
        every(turned_mask(Turn.ROTATE_180)),
        rf"The masks of all 20 photos are turned by 180 degrees against photos and cameras {IOU}: `mogrify -rotate 180 "
        r"masks/\*\.png` turns them\.",
    ),
    "masks turned left": (
        every(turned_mask(Turn.ROTATE_90)),
        r"The masks of all 20 photos are turned by 90 degrees .*`mogrify -rotate 90 masks/\*\.png` turns them\.",
    ),
    "some masks turned right": (
        some(turned_mask(Turn.ROTATE_270), third),
        rf"The masks of {THIRD} are turned by 270 degrees .*`mogrify -rotate 270 masks/p00\.png .*",
    ),
    "photos turned without their cameras": (
        every(turned(Turn.ROTATE_90)),
        rf"The cameras of all 20 photos are turned by 90 degrees against photos and masks {IOU}: turn the cameras about "
        rf"their view axes \(m\[:3, :2\] = np\.stack\(\[-m\[:3, 1\], m\[:3, 0\]\], 1\){SUFFIX}",
    ),
    "cameras upside down": (
        every(posed(lambda m: m @ np.diag([-1.0, -1, 1, 1]))),
        rf"The cameras of all 20 photos are turned by 180 degrees .*\(m\[:3, :2\] \*= -1{SUFFIX}",
    ),
    "photos mirrored": (
        every(turned(Turn.FLIP_LEFT_RIGHT)),
        rf"All 20 photos look mirrored left to right against the cameras {IOU}: mirror the photos and their masks .*",
    ),
    "some photos mirrored": (
        some(turned(Turn.FLIP_LEFT_RIGHT), third),
        # the object is symmetrical: where its plane faces the camera nothing tells
        rf"4 of 20 photos \(p00, p03, p06, p15\) look mirrored left to right against the cameras {EITHER}: .*",
    ),
    "world mirrored": (
        every(posed(lambda m: np.diag([1.0, 1, -1, 1]) @ m @ np.diag([-1.0, 1, 1, 1]))),
        rf"All 20 photos look mirrored left to right against the cameras {IOU}: .* or mirror the cameras' world "
        r"\(m\[0\] \*= -1, then m\[:3, 0\] \*= -1\)\.",
    ),
    "masks transposed": (
        every(turned(Turn.TRANSPOSE)),
        r"All 20 photos look mirrored left to right, and turned by 90 degrees (anti)?clockwise against the cameras .*",
    ),
    "OpenCV axes": (
        every(posed(lambda m: m @ OPENCV)),
        r"The cameras of all 20 photos look like OpenCV's \(y down, looking along \+z\) "
        + IOU
        + ": "
        + AXES.format("second", r"m\[:3, 1:3\] \*= -1"),
    ),
    "some with OpenCV axes": (
        some(posed(lambda m: m @ OPENCV), third),
        rf"The cameras of {THIRD} look like OpenCV's .*",
    ),
    "PyTorch3D axes": (
        every(posed(lambda m: m @ PYTORCH3D)),
        r"The cameras of all 20 photos look like PyTorch3D's .*"
        + AXES.format("first", r"m\[:3, \[0, 2\]\] \*= -1"),
    ),
    "world-to-camera": (
        every(posed(np.linalg.inv)),
        rf"{WORLD} {IOU}: store their inverses \(m = np\.linalg\.inv\(m\)\)\.",
    ),
    "world-to-camera, OpenCV": (
        every(posed(lambda m: np.linalg.inv(m @ OPENCV))),
        rf"{WORLD} with OpenCV axes {IOU}: store their inverses with other axes \(m = np\.linalg\.inv\(m\), then "
        r"m\[:3, 1:3\] \*= -1\)\.",
    ),
    "world-to-camera, PyTorch3D": (
        every(posed(lambda m: np.linalg.inv(m @ PYTORCH3D))),
        rf"{WORLD} with PyTorch3D axes .*",
    ),
    "rotations inverted": (
        every(posed(transposed)),
        rf"{ROTATIONS}, beside positions in the world {IOU}: {TRANSPOSE}\)\.",
    ),
    "rotations of OpenCV inverted": (
        every(posed(lambda m: transposed(m @ OPENCV))),
        rf"{ROTATIONS}, with OpenCV axes, beside positions in the world .*",
    ),
    "translations for positions": (
        every(posed(lambda m: moved(m, np.linalg.inv(m)[:3, 3]))),
        rf"{POSITIONS}all 20 photos look like translations of world-to-camera matrices {IOU}: store the cameras' "
        r"centres \(m\[:3, 3\] = -m\[:3, :3\] @ m\[:3, 3\]\)\.",
    ),
    "OpenCV's translations for positions": (
        every(posed(lambda m: moved(m, np.linalg.inv(m @ OPENCV)[:3, 3]))),
        rf"{POSITIONS}all 20 photos look like translations .*\[1, -1, -1\].*",
    ),
    "positions with y up": (
        every(posed(lambda m: moved(m, Y_UP @ m[:3, 3]))),
        rf"{POSITIONS}all 20 photos look given in other axes than their rotations {IOU}: write each position "
        r"\(x, y, z\) as \(x, -z, y\)\.",
    ),
    "some positions in millimetres": (
        some(posed(lambda m: moved(m, 1000 * m[:3, 3])), lambda index: index < 6),
        rf"{POSITIONS}6 of 20 photos \(p00, .*, p05\) look given in another unit than the others {IOU}: multiply "
        r"their positions by 0\.001\.",
    ),
    "some positions in feet": (
        some(posed(lambda m: moved(m, 3.281 * m[:3, 3])), third),
        rf"{POSITIONS}{THIRD} look given in another unit .*multiply their positions by 0\.3048\.",
    ),
    "next photo's cameras": (
        reordered(lambda i, count: (i + 1) % count),
        rf"The cameras of all 20 photos look like those of the next photo {IOU}: give each of these photos the "
        r"camera that the previous one has in the order of names .*",
    ),
    "a camera missing from the list": (
        one_left_out,
        r"The cameras of \d of 20 photos \(p1.*\) look like those of the next photo .*",
    ),
    "cameras in reverse": (
        reordered(lambda i, count: count - 1 - i),
        r"The cameras of all 20 photos look listed in the reverse order of the photos .*: reverse the list of cameras\.",
    ),
    "cameras as text, photos as numbers": (
        lambda shots: numbered(shots, as_text=False),
        r"The cameras of all 20 photos look listed in another order of names \(1, 10, 2\) than the photos \(1, 2, 10\) .*",
    ),
    "cameras as numbers, photos as text": (
        lambda shots: numbered(shots, as_text=True),
        r"The cameras of all 20 photos look listed in another order of names \(1, 2, 10\) than the photos \(1, 10, 2\) .*",
    ),
}

INTRINSICS = {
    "focal length of a larger photo": (
        {"fl_x": 3, "fl_y": 3},
        rf"The focal lengths of the cameras of all 20 photos look about (2\.9|4|2) times too long {IOU}: give them in "
        r"pixels of these photos, about \d\.\d times the width \(camera_angle_x 0\.\d+\)\.",
    ),
    "focal length of a smaller photo": (
        {"fl_x": 0.4, "fl_y": 0.4},
        rf"The focal lengths of the cameras of all 20 photos look about \d(\.\d)? times too short {IOU}: .*",
    ),
    "all of a larger photo": (
        {"fl_x": 4, "fl_y": 4, "cx": 4, "cy": 4, "w": None, "h": None},
        rf"The focal lengths and principal points of the cameras of all 20 photos look given in pixels of photos 4 "
        rf"times as large {IOU}: give w and h of the photos that the cameras were estimated from, beside .*",
    ),
    "all of a smaller photo": (
        {"fl_x": 0.5, "fl_y": 0.5, "cx": 0.5, "cy": 0.5, "w": None, "h": None},
        r"The focal lengths and principal points .* look given in pixels of photos 0\.5 times as large .*",
    ),
    "principal point of a larger photo": (
        {"cx": 2, "cy": 2},
        rf"The principal points of the cameras of all 20 photos look far from the middles of the photos {IOU}: leave "
        r"out cx and cy, or give them in pixels of these photos, near half of width and height\.",
    ),
    "principal point at the corner": (
        {"cx": 0.01, "cy": 0.01},
        r"The principal points of .* far from the middles of the photos .*",
    ),
}


@pytest.mark.slow
@pytest.mark.parametrize(("change", "pattern"), CASES.values(), ids=CASES.keys())
def test_a_mistake_is_named_with_its_remedy(tmp_path, change, pattern):
    problems, hints = found(tmp_path, change)
    told(problems, pattern)
    assert hints == ()


@pytest.mark.slow
@pytest.mark.parametrize(("factors", "pattern"), INTRINSICS.values(), ids=INTRINSICS.keys())
def test_wrong_intrinsics_are_named(tmp_path, factors, pattern):
    _, common = demo_shots(2)
    changed = {key: factor and factor * common[key] for key, factor in factors.items()}
    problems, hints = found(tmp_path, **changed)
    told(problems, pattern)
    assert hints == ()
