"""Lens distortion is not modelled: it is measured in pixels, and refused where it would be seen.

Model (Brown; OpenCV, COLMAP, nerfstudio): x' = x (1 + k1 r^2 + k2 r^4 + ...) + 2 p1 x y + p2 (r^2 + 2 x^2), and so y'.
"""

from collections.abc import Sequence

import numpy as np

from lightprobe.core.errors import InputError
from lightprobe.scene.camera import Camera

_TOLERANCE = 1e-3  # of the longer image side: below the error of the poses themselves
ADVICE = "undistort the photos first (for instance with `colmap image_undistorter`) and use the result"


def refuse_distortion(
    camera: Camera, radial: Sequence[float], tangential: Sequence[float] = (0.0, 0.0), *, source: str
) -> None:
    """Raise `InputError` naming `source` when the lens bends some pixel by more than a thousandth of the image size.

    `radial` is (k1, k2, ...) of r^2, r^4, ...; `tangential` is (p1, p2).
    """
    if not any(radial) and not any(tangential):
        return
    with np.errstate(over="ignore", invalid="ignore"):  # what overflows is too much
        shift = _largest_shift(camera, radial, tangential)
    if not shift <= _TOLERANCE * max(camera.width, camera.height):
        size = f"{shift:.1f}" if shift < 1e6 else "countless"
        raise InputError(f"{source} has lens distortion of up to {size} pixels, which is not modelled; {ADVICE}.")


def _largest_shift(camera: Camera, radial: Sequence[float], tangential: Sequence[float]) -> float:
    """Return by how many pixels the lens bends some pixel of the image; NaN or infinity where it overflows."""
    u, v = np.meshgrid(np.linspace(0, camera.width, 9), np.linspace(0, camera.height, 9))
    x, y = (u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy
    r2 = x * x + y * y
    stretch = sum(k * r2 ** (power + 1) for power, k in enumerate(radial))
    p1, p2 = tangential
    dx = x * stretch + 2 * p1 * x * y + p2 * (r2 + 2 * x * x)
    dy = y * stretch + 2 * p2 * x * y + p1 * (r2 + 2 * y * y)
    return float(np.hypot(dx * camera.fx, dy * camera.fy).max())
