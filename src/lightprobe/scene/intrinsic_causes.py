"""What focal lengths and principal points are usually wrong by: those of another photo than these."""

from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np

from lightprobe.core.errors import InputError
from lightprobe.scene.camera import Camera
from lightprobe.scene.causes import Cause, Change, Kind, Scope, Views
from lightprobe.scene.consistency import View
from lightprobe.scene.normalise import first_guess

_FACTORS = (0.25, 0.35, 0.5, 0.6, 0.7, 0.8, 1.25, 1.4, 1.6, 2.0, 2.8, 4.0)  # of focal lengths
_ASPECTS = (9 / 16, 2 / 3, 3 / 4, 4 / 3, 3 / 2, 16 / 9)
_OFF = 0.02  # of a photo's side, by which a principal point is away from the middle
_ALIKE = 0.1  # relative difference of two ratios that have one reason
_STEPS = 5  # of the search for a principal point


def _lensed(change: Callable[[Camera], Camera]) -> Change:
    return lambda views: [replace(view, camera=change(view.camera)) for view in views]


def _scaled(x: float, y: float) -> Callable[[Camera], Camera]:
    return lambda camera: replace(camera, fx=camera.fx * x, fy=camera.fy * y)


def _centred(camera: Camera) -> Camera:
    return replace(camera, cx=camera.width / 2, cy=camera.height / 2)


def intrinsic_causes(views: Views) -> Iterator[Cause]:
    """Yield focal lengths and principal points of other photos than these, of all photos alike."""
    cameras = [view.camera for view in views]
    focal = float(np.median([camera.fx / camera.width for camera in cameras]))
    across = float(np.median([camera.cx / camera.width for camera in cameras]))
    down = float(np.median([camera.cy / camera.height for camera in cameras]))

    def cause(subject: str, state: str, remedy: str, change: Change) -> Cause:
        return Cause(Kind.INTRINSICS, subject, state, remedy, change, scope=Scope.ALL)

    for factor in _FACTORS:
        angle = 2 * np.arctan(0.5 / (focal * factor))
        length = "short" if factor > 1 else "long"
        yield cause(
            "focal lengths of the cameras",
            f"about {max(factor, 1 / factor):.2g} times too {length}",
            f"give them in pixels of these photos, about {focal * factor:.2g} times the width (camera_angle_x "
            f"{angle:.2g})",
            _lensed(_scaled(factor, factor)),
        )
    for factor in _ASPECTS:
        yield cause(
            "photos",
            f"{'flattened' if factor < 1 else 'narrowed'} by a factor of {max(factor, 1 / factor):.2g}",
            f"give the cameras a focal length of its own for rows, {factor:.2g} times that for columns (fl_y)",
            _lensed(_scaled(1, factor)),
        )
    if max(abs(across - 0.5), abs(down - 0.5)) > _OFF:
        centre = "leave out cx and cy, or give them in pixels of these photos, near half of width and height"
        state = "far from the middles of the photos"
        yield cause("principal points of the cameras", state, centre, _lensed(_centred))
        if min(across, down) > 0 and abs(across / down - 1) < _ALIKE:
            yield cause(
                "focal lengths and principal points of the cameras",
                f"given in pixels of photos {across / 0.5:.2g} times as large",
                "give w and h of the photos that the cameras were estimated from, beside fl_x, fl_y, cx and cy",
                _lensed(lambda camera: _centred(_scaled(0.5 / across, 0.5 / down)(camera))),
            )
    yield from _off_centre(views, cause)


def _off_centre(views: Views, cause: Callable[[str, str, str, Change], Cause]) -> Iterator[Cause]:
    """Yield the principal point by which the middles of the masks point to one place, if there is one."""
    offset, moved = np.zeros(2), list(views)
    for _ in range(_STEPS):
        try:
            center, _ = first_guess([view.camera for view in moved], [view.mask for view in moved])
        except InputError:
            return
        offset = offset + np.median([_beside(view, center) for view in moved], axis=0)
        moved = _offset(views, offset)
    if np.abs(offset).max() <= _OFF:
        return
    x, y = 100 * offset
    yield cause(
        "principal points of the cameras",
        f"off by {abs(x):.0f} % of the width and {abs(y):.0f} % of the height, as if the photos were cropped",
        f"add {x:.0f} % of the width to cx and {y:.0f} % of the height to cy, or use the uncropped photos",
        lambda views: _offset(views, offset),
    )


def _beside(view: View, center: np.ndarray) -> np.ndarray:
    """Return how far the mask's middle lies beside the point `center` (3,), (2,) in shares of width and height."""
    rows, columns = np.nonzero(view.mask >= 0.5)
    x, y, _ = view.camera.project(center[None])[0]
    height, width = view.mask.shape
    return (
        np.array([(columns.mean() + 0.5 - x) / width, (rows.mean() + 0.5 - y) / height])
        if len(rows)
        else np.zeros(2)
    )


def _offset(views: Views, offset: np.ndarray) -> list[View]:
    """Return the views with principal points moved by `offset` (2,), in shares of width and height."""
    x, y = offset
    change = _lensed(lambda c: replace(c, cx=c.cx + x * c.width, cy=c.cy + y * c.height))
    return change(views)
