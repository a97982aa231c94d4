"""Single photos, few photos and sound scenes: what is said of them, and what a training makes of it."""

import re
from dataclasses import replace

import numpy as np
import pytest
from PIL import ImageDraw

from lightprobe.core.errors import InputError, LightprobeWarning
from lightprobe.scene import load_scene
from lightprobe.scene.inspect import inspect
from lightprobe.scene.loading import load_checked_scene
from tests.scene.demo_shots import (
    SIDE,
    demo_shots,
    inverted,
    posed,
    some,
    turned,
    turned_mask,
    write_shots,
)
from tests.scene.mistakes import (
    IOU,
    OPENCV,
    Turn,
    as_stored,
    cropped,
    found,
    half_turned_photo,
    moved,
    squeezed,
    swapped,
    told,
)
from tests.scene.worlds import views, write_nerfstudio
from tests.toy_scene import write_toy_scene

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
        load_checked_scene(root)


@pytest.mark.slow
def test_a_doubtful_scene_is_loaded_with_a_warning(tmp_path):
    shots, common = demo_shots()
    shots[5] = inverted(shots[5])
    root = write_shots(tmp_path / "scene", shots, common)
    with pytest.warns(LightprobeWarning) as caught:
        load_checked_scene(root)
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
