"""Visibility: which face each pixel centre sees, and how far away it is.

Screen points are (x in pixels, y in pixels, depth); pixel (i, j) samples at (j + 0.5, i + 0.5), row 0 on top.
Depth is the distance along the viewing axis, so 1/depth is linear over the screen and interpolation is
perspective-correct.

Edges are closed: a centre exactly on an edge belongs to both faces, and the rule of the nearest decides. Each
edge function is evaluated from the same end point for both faces that share it, so rounding leaves no crack
between them.
"""

from dataclasses import dataclass

import torch
from torch import Tensor

from lightprobe.kernels import dispatch


@dataclass(frozen=True)
class Visibility:
    """What each pixel sees: `face` (H, W) int32, -1 for none; `inverse_depth` (H, W) float32, 0 for none."""

    face: Tensor
    inverse_depth: Tensor


def rasterize(screen: Tensor, faces: Tensor, height: int, width: int) -> Visibility:
    """Return the nearest face at each pixel centre; ties go to the lower face index; not differentiable.

    screen (V, 3) float32: x px, y px, depth; faces (F, 3) int32 or int64. Both windings are drawn. Faces with
    a depth <= 0 (there is no near clipping), a non-finite corner or no area are skipped. The result does not
    depend on the order of drawing or the number of threads. To differentiate through positions, interpolate
    again from `face`. Raises ValueError on wrong shapes or dtypes and IndexError on a face naming a missing
    vertex.
    """
    dispatch.require_shape("screen", screen, None, 3)
    dispatch.require_shape("faces", faces, None, 3)
    dispatch.require_index("faces", faces, screen.shape[0])
    if height < 1 or width < 1:
        raise ValueError(f"The image must have at least one pixel, not {height} x {width}.")
    backend = dispatch.choose("rasterize", screen, faces)
    with torch.no_grad():
        return Visibility(*backend.rasterize(screen, faces, height, width))
