"""Mistakes of masks and cameras, made in the bundled demo's scene."""

import re
from dataclasses import replace

import numpy as np
from PIL import Image

from lightprobe.scene.inspect import inspect
from tests.scene.demo_shots import (
    SIDE,
    demo_shots,
    write_shots,
)

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
