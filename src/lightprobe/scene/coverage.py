"""Do the photos of a scene show enough of the object? How many they are, and from where they look."""

from collections.abc import Sequence

import numpy as np

from lightprobe.scene.camera import Camera, up_of

FEWEST, ENOUGH = 8, 25  # photos: below, most of the object is guessed; below, parts stay unseen
_NEEDED = 3  # photos to train on: what two masks have in common says nothing about a shape
_ONE_SIDE = 180.0  # degrees around the object without a camera
_APART = (
    1e-3  # distance of cameras from each other, in theirs from the object, below which they are at one place
)
_CONE = 40.0  # degrees from the middle direction, within which all cameras look from one side


def too_few(total: int, count: int) -> tuple[str, bool]:
    """Return a sentence about `count` photos to train on, of `total`, and whether these are no use at all.

    The sentence is empty where they are enough.
    """
    if count >= FEWEST:
        return "", False
    held = f", {total - count} held out for testing" if total > count else ""
    photos = "1 photo is" if count == 1 else f"{count} photos are"
    advice = f"take about {ENOUGH}, all around the object"
    if count < _NEEDED:
        return f"Too few photos: {photos} left to train on of {total} with a camera{held}; {advice}.", True
    return (
        f"Few photos: {photos} left to train on of {total} with a camera{held}, so that most of the object's shape is "
        f"guessed; {advice}.",
        False,
    )


def at_one_place(cameras: Sequence[Camera], center: np.ndarray) -> str:
    """Return a sentence about cameras that all stand at one place away from `center` (3,), empty otherwise."""
    positions = np.stack([camera.position for camera in cameras])
    distance = float(np.linalg.norm(positions - center, axis=1).mean())
    if np.ptp(positions, axis=0).max() > _APART * distance:
        return ""
    return (
        f"All {len(cameras)} cameras of the photos to train on stand at one place, from which no shape can be told; take "
        "photos all around the object. If it was turned before a camera at rest, `lightprobe prepare` finds the cameras "
        "around it."
    )


def one_sided(cameras: Sequence[Camera], center: np.ndarray) -> str:
    """Return a sentence about cameras that all look at `center` (3,) from one side, empty otherwise."""
    outward = np.stack([camera.position - center for camera in cameras])
    outward = outward / np.maximum(np.linalg.norm(outward, axis=1, keepdims=True), 1e-12)
    gap = _widest_gap(outward, up_of(cameras))
    middle = outward.mean(axis=0)
    cosine = outward @ (middle / max(float(np.linalg.norm(middle)), 1e-12))
    if gap <= _ONE_SIDE and cosine.min() < np.cos(np.radians(_CONE)):
        return ""
    return (
        f"All {len(cameras)} photos to train on look at the object from one side: {gap:.0f} degrees around it have no "
        "camera, and what lies there is guessed; take photos all around it, every 15 degrees."
    )


def _widest_gap(outward: np.ndarray, up: np.ndarray) -> float:
    """Return the widest angle in degrees around the axis `up` (3,) that holds no direction of `outward` (N, 3)."""
    first = np.cross(up, np.eye(3)[np.argmin(np.abs(up))])
    second = np.cross(up, first)
    turns = np.sort(np.degrees(np.arctan2(outward @ second, outward @ first)))
    return float(np.diff(turns, append=turns[0] + 360).max())
