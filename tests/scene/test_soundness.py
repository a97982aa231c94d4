"""One mistake in a sound scene is named with the photos that have it and the remedy, and nothing else is."""

import re
from dataclasses import replace

import numpy as np
import pytest
from PIL import Image, ImageDraw

from lightprobe.core.errors import InputError, LightprobeWarning
from lightprobe.scene import load_scene
from lightprobe.scene.inspect import inspect
from lightprobe.scene.loading import check_scene
from tests.scene.demo_shots import (
    SIDE,
    demo_shots,
    every,
    inverted,
    posed,
    some,
    turned,
    turned_mask,
    write_shots,
)
from tests.scene.worlds import views, write_nerfstudio
from tests.toy_scene import write_toy_scene

Turn = Image.Transpose
IOU = r"\(hull IoU 0\.\d\d as they are, 0\.\d\d without that\)"
EITHER = (
    r"\(hull IoU 0\.\d\d as they are, 0\.\d\d without that; .*p\d\d may have it, too, and fit either way\)"
)
OPENCV, PYTORCH3D = np.diag([1.0, -1, -1, 1]), np.diag([-1.0, 1, -1, 1])
Y_UP = np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])


def third(index):
    return index % 3 == 0


THIRD = r"7 of 20 photos \(p00, p03, p06, p09, p12, p15, p18\)"
ALL = "all 20 photos"


def found(root, change=lambda shots: shots, **intrinsics):
    """Return the problems and hints about the demo's scene after a change of its shots or intrinsics."""
    shots, common = demo_shots()
    given = {key: value for key, value in {**common, **intrinsics}.items() if value is not None}
    scene = inspect(write_shots(root / "scene", change(shots), given))
    return scene.problems, scene.hints


def told(problems, pattern):
    """Assert that one sentence matches the whole pattern and nothing else is said."""
    (sentence,) = problems
    assert re.fullmatch(pattern, sentence), sentence


def moved(m, position):
    m[:3, 3] = position
    return m


def transposed(m):
    m[:3, :3] = m[:3, :3].T
    return m


def half_turned_photo(shot, orientation=3):
    """Stored upside down with a tag that says so: what is shown stays."""
    return replace(shot, photo=shot.photo.transpose(Turn.ROTATE_180), orientation=orientation)


def as_stored(shot):
    """A program that ignores EXIF: mask and camera are for the stored pixels of a tagged photo."""
    stored = half_turned_photo(replace(shot, mask=shot.mask.transpose(Turn.ROTATE_180)))
    return replace(stored, pose=stored.pose @ np.diag([-1.0, -1, 1, 1]))


def stored_on_its_side(shot):
    """A photo held upright and stored lying; the mask is upright, without a tag."""
    return replace(shot, photo=shot.photo.transpose(Turn.ROTATE_90), orientation=6)


def reordered(order):
    """Give photo i the pose of photo order(i, count)."""
    return lambda shots: [
        replace(shot, pose=shots[order(i, len(shots))].pose) for i, shot in enumerate(shots)
    ]


def one_left_out(shots):
    """A pose is missing from the list: from there on each photo has the next one's."""
    return [
        replace(shot, pose=shots[min(i + (i >= 12), len(shots) - 1)].pose) for i, shot in enumerate(shots)
    ]


def numbered(shots, *, as_text):
    """Photos named 1 to 20 without zeros, whose poses were listed as text or as numbers while photos were not."""
    names = [str(i + 1) for i in range(len(shots))]
    by_text, by_number = sorted(names), names
    right, listed = dict(zip(names, shots, strict=True)), []
    source, target = (by_number, by_text) if as_text else (by_text, by_number)
    for mine, others in zip(target, source, strict=True):
        listed.append(replace(right[mine], name=mine, pose=right[others].pose))
    return listed


def swapped(shots):
    poses = [shot.pose for shot in shots]
    poses[4], poses[11] = poses[11], poses[4]
    return [replace(shot, pose=pose) for shot, pose in zip(shots, poses, strict=True)]


def cropped(shots):
    """The left quarter was cut off and the rest is not told of."""
    shape = (SIDE // 5, 0, SIDE + SIDE // 5, SIDE)
    return [
        replace(shot, photo=shot.photo.crop(shape), mask=shot.mask.crop(shape), extra={}) for shot in shots
    ]


def squeezed(shots):
    size = (SIDE, SIDE * 3 // 4)
    return [replace(shot, photo=shot.photo.resize(size), mask=shot.mask.resize(size)) for shot in shots]


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
        r"All 20 photos look mirrored left to right against the cameras, and turned by 90 degrees .*",
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


# Masks of a sound scene that a program has cut or scaled with its photos, without telling the cameras.


@pytest.mark.slow
def test_cropped_photos_are_told_by_their_principal_points(tmp_path):
    problems, hints = found(tmp_path, cropped, w=None, h=None, cx=None, cy=None)
    told(
        problems,
        rf"The principal points of the cameras of all 20 photos look off by 2\d % of the width and [0-3] % of the height, "
        rf"as if the photos were cropped {IOU}: add -2\d % of the width to cx and -?[0-3] % of the height to cy, or use "
        r"the uncropped photos\.",
    )
    assert hints == ()


@pytest.mark.slow
def test_squeezed_photos_are_told_by_their_focal_lengths(tmp_path):
    shots, common = demo_shots()
    root = write_shots(tmp_path / "scene", squeezed(shots), {"fl_x": common["fl_x"]})
    told(
        inspect(root).problems,
        rf"All 20 photos look flattened by a factor of 1\.3 {IOU}: give the cameras a focal length of its own for rows, 0\.75 times "
        r"that for columns \(fl_y\)\.",
    )


# Single photos are hints: the hull bears with a few.


@pytest.mark.slow
def test_two_exchanged_cameras_are_named(tmp_path):
    problems, hints = found(tmp_path, swapped)
    assert problems == ()
    assert sorted(hint[:44] for hint in hints) == [
        "The cameras of 1 of 20 photos (p04) look exc",
        "The cameras of 1 of 20 photos (p11) look exc",
    ]
    assert "exchanged for that of p11" in min(hints)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("change", "words"),
    [
        (inverted, "The masks of 1 of 20 photos (p05) look inverted"),
        (
            turned_mask(Turn.ROTATE_180),
            "The masks of 1 of 20 photos (p05) are turned by 180 degrees against photos",
        ),
        (posed(lambda m: m @ OPENCV), "The cameras of 1 of 20 photos (p05) look like OpenCV's"),
        (
            posed(np.linalg.inv),
            "The matrices of the cameras of 1 of 20 photos (p05) look like world-to-camera",
        ),
        (
            posed(lambda m: moved(m, 100 * m[:3, 3])),
            "The positions of the cameras of 1 of 20 photos (p05) look given",
        ),
    ],
)
def test_one_photo_with_a_mistake_is_a_hint(tmp_path, change, words):
    problems, hints = found(tmp_path, some(change, lambda index: index == 5))
    assert problems == ()
    (hint,) = hints
    assert hint.startswith(words)


@pytest.mark.slow
def test_a_wrong_mask_without_a_usual_cause_is_a_hint(tmp_path):
    def spoil(shot):
        mask = shot.mask.copy()
        ImageDraw.Draw(mask).rectangle((0, 0, SIDE // 2, SIDE), fill=0)
        return replace(shot, mask=mask)

    problems, hints = found(tmp_path, some(spoil, lambda index: index == 5))
    assert problems == ()
    (hint,) = hints
    assert re.fullmatch(
        r"Mask or camera of 1 of 20 photos \(p05: IoU 0\.\d\d\) disagrees with the other photos \(median 0\.9\d\): .*",
        hint,
    )


# What is sound, and what shows too little.


@pytest.mark.slow
@pytest.mark.parametrize("size", [(SIDE, SIDE), (SIDE + 40, SIDE), (SIDE, SIDE + 40)])
def test_nothing_is_said_of_a_sound_scene(tmp_path, size):
    shots, common = demo_shots(size=size)
    scene = inspect(write_shots(tmp_path / "scene", shots, common))
    assert scene.problems == scene.hints == ()


@pytest.mark.slow
def test_nothing_is_said_of_close_ups(tmp_path):
    """The object reaches the photo's border and is cut by it."""

    def near(shot):
        shape = (12, 12, SIDE - 12, SIDE - 12)
        return replace(shot, photo=shot.photo.crop(shape), mask=shot.mask.crop(shape))

    shots, common = demo_shots(24)
    root = write_shots(tmp_path / "scene", [near(shot) for shot in shots], {"fl_x": common["fl_x"]})
    scene = inspect(root)
    assert scene.problems == scene.hints == ()


@pytest.mark.slow
def test_nothing_is_said_of_a_held_out_photo_that_few_others_explain(tmp_path):
    """The hull of eight photos is larger than the object where no photo looks, which is no photo's fault."""
    scene = inspect(write_toy_scene(tmp_path / "scene", train=8, test=1))
    assert min(photo.iou for photo in scene.photos) < 0.7
    assert scene.problems == scene.hints == ()


@pytest.mark.slow
@pytest.mark.parametrize("count", [10, 14])
def test_nothing_is_said_of_a_hull_that_few_photos_leave_too_large(tmp_path, count):
    """Masks that it covers agree with the cameras; no mistake is guessed from a hull that is merely loose."""
    scene = inspect(write_nerfstudio(tmp_path / "scene", views(count, zoom=1.5)))
    assert scene.mean_iou < 0.7
    assert scene.problems == scene.hints == ()


def on_one_side(shots):
    return [shot for shot in shots if shot.pose[0, 3] > 1]


@pytest.mark.slow
def test_photos_from_one_side_are_told_as_such(tmp_path):
    problems, hints = found(tmp_path, on_one_side)
    told(
        [sentence for sentence in (*problems, *hints) if not sentence.startswith("Few photos")],
        r"All \d photos to train on look at the object from one side: 2\d\d degrees around it have no camera, and what "
        r"lies there is guessed; take photos all around it, every 15 degrees\.",
    )


@pytest.mark.slow
def test_many_photos_from_one_side_are_told_as_such(tmp_path):
    shots, common = demo_shots(56)
    scene = inspect(write_shots(tmp_path / "scene", on_one_side(shots), common))
    told((*scene.problems, *scene.hints), r"All 1\d photos to train on look at the object from one side: .*")


@pytest.mark.slow
def test_a_camera_at_rest_is_told_as_such(tmp_path):
    """The object was turned on a table, and the cameras are those of the background."""
    problems, _ = found(tmp_path, lambda shots: [replace(shot, pose=shots[0].pose) for shot in shots])
    told(
        problems,
        r"All 18 cameras of the photos to train on stand at one place, .*`lightprobe prepare` finds .*",
    )


@pytest.mark.slow
def test_a_mistake_of_photos_from_one_side_is_still_named(tmp_path):
    shots, common = demo_shots(56)
    scene = inspect(write_shots(tmp_path / "scene", [inverted(shot) for shot in on_one_side(shots)], common))
    assert scene.problems[0].startswith("The masks of all")
    assert "look inverted" in scene.problems[0]


@pytest.mark.parametrize(("count", "left"), [(2, 1), (3, 2)])
def test_two_photos_are_too_few(tmp_path, count, left):
    problems, hints = found(tmp_path, lambda shots: shots[:: 20 // count][:count])
    assert hints == ()
    if left < 2:
        assert "two or more are needed" in problems[0]
    else:
        told(
            problems,
            r"Too few photos: 2 photos are left to train on of 3 with a camera, 1 held out for testing; take about 25, all "
            r"around the object\.",
        )


@pytest.mark.slow
@pytest.mark.parametrize("step", [5, 4, 3])
def test_few_photos_are_told_as_such(tmp_path, step):
    """Four to seven photos fit a hull of many kinds, or none that ends: no mistake is guessed."""
    said = [sentence for sentences in found(tmp_path, lambda shots: shots[::step]) for sentence in sentences]
    few = [sentence for sentence in said if "look at the object from one side" not in sentence]
    told(
        few,
        r"Few photos: [3-6] photos are left to train on of [4-7] with a camera, 1 held out .*; take about 25, .*",
    )


# Loading for a training


@pytest.mark.slow
def test_a_scene_that_cannot_be_right_is_not_loaded_for_a_training(tmp_path):
    shots, common = demo_shots()
    root = write_shots(tmp_path / "scene", [inverted(shot) for shot in shots], common)
    assert len(load_scene(root).train) == 18
    with pytest.raises(InputError, match=r"cannot be trained on\. The masks of all 20 photos look inverted"):
        check_scene(load_scene(root))


@pytest.mark.slow
def test_a_doubtful_scene_is_loaded_with_a_warning(tmp_path):
    shots, common = demo_shots()
    shots[5] = inverted(shots[5])
    root = write_shots(tmp_path / "scene", shots, common)
    with pytest.warns(LightprobeWarning) as caught:
        check_scene(load_scene(root))
    assert [str(one.message) for one in caught] == list(inspect(root).hints)
    assert "1 of 20 photos (p05) look inverted" in str(caught[0].message)


# Remedies, followed


def lined(m):
    m[:3, :2] = np.stack([-m[:3, 1], m[:3, 0]], 1)
    return m


@pytest.mark.slow
@pytest.mark.parametrize(
    ("mistake", "remedy"),
    [
        (turned_mask(Turn.ROTATE_90), turned_mask(Turn.ROTATE_270)),  # mogrify -rotate 90 turns clockwise
        (turned(Turn.ROTATE_90), posed(lined)),
        (
            half_turned_photo,
            lambda shot: replace(half_turned_photo(shot), orientation=1),
        ),  # mogrify -auto-orient
        (as_stored, lambda shot: replace(shot, orientation=1)),  # exiftool -Orientation=1
    ],
)
def test_a_remedy_mends_what_it_is_told_for(tmp_path, mistake, remedy):
    assert found(tmp_path, lambda shots: [remedy(mistake(shot)) for shot in shots]) == ((), ())
