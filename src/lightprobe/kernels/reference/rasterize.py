"""Reference of the rasteriser: every pixel of every face's bounding box, then the best of each pixel.

A pair of (pixel, face) competes by one 64-bit key, the bits of its float32 inverse depth above the complement
of its face index: the bits of positive floats order like the floats, so the largest key is the nearest,
lowest-numbered face.
"""

import torch
from torch import Tensor

PAIRS_AT_ONCE = 1 << 22  # triangles times pixels, for memory
FACE_MASK = (1 << 31) - 1  # low bits of a key: the face; above them its depth


def rasterize(screen: Tensor, faces: Tensor, height: int, width: int) -> tuple[Tensor, Tensor]:
    """Return face (H, W) int32 and inverse depth (H, W) float32."""
    best = torch.full((height * width,), -1, dtype=torch.int64, device=screen.device)
    corners = screen.double()[faces.long()]
    drawn, left, top, columns, rows = _boxes(corners, height, width)
    pairs = columns * rows
    batch = pairs.cumsum(0).div(PAIRS_AT_ONCE, rounding_mode="floor")
    for number in range(int(batch[-1]) + 1 if len(batch) else 0):
        chosen = batch == number
        box = torch.repeat_interleave(chosen.nonzero()[:, 0], pairs[chosen])
        first = torch.repeat_interleave(pairs[chosen].cumsum(0) - pairs[chosen], pairs[chosen])
        offset = torch.arange(len(box), device=screen.device) - first
        x = left[box] + offset % columns[box]
        y = top[box] + offset.div(columns[box], rounding_mode="floor")
        inverse_depth = _inverse_depth(corners[drawn[box]], x + 0.5, y + 0.5)
        bits = inverse_depth.to(torch.float32).view(torch.int32).long()
        key = torch.where(inverse_depth > 0, (bits << 31) | (FACE_MASK - drawn[box]), -1)
        best.scatter_reduce_(0, y * width + x, key, "amax")
    face = torch.where(best < 0, -1, FACE_MASK - (best & FACE_MASK)).to(torch.int32)
    depth = torch.where(best < 0, 0, best >> 31).to(torch.int32).view(torch.float32)
    return face.reshape(height, width), depth.reshape(height, width)


def _boxes(corners: Tensor, height: int, width: int) -> tuple[Tensor, ...]:
    """Return the faces to draw, and left, top, columns and rows of the pixels with centres in their boxes."""
    visible = corners.isfinite().all(dim=2).all(dim=1) & (corners[..., 2] > 0).all(dim=1)
    drawn = visible.nonzero()[:, 0]
    low, high = corners[drawn, :, :2].amin(dim=1), corners[drawn, :, :2].amax(dim=1)
    size = torch.tensor([width, height], device=corners.device)
    first = torch.minimum(torch.ceil(low - 0.5).clamp(min=0), size).long()
    last = torch.minimum(torch.floor(high - 0.5).clamp(min=-1), size - 1).long()
    extent = (last - first + 1).clamp(min=0)
    keep = extent.prod(dim=1) > 0
    return drawn[keep], *first[keep].unbind(1), *extent[keep].unbind(1)


def _inverse_depth(corners: Tensor, x: Tensor, y: Tensor) -> Tensor:
    """Return 1/depth (B,) at the points (x, y) of the faces `corners` (B, 3, 3); 0 outside the face."""
    a, b, c = corners.unbind(1)
    area = (b[:, 0] - a[:, 0]) * (c[:, 1] - a[:, 1]) - (b[:, 1] - a[:, 1]) * (c[:, 0] - a[:, 0])
    e0, e1, e2 = (area.sign() * _edge(*ends, x, y) for ends in ((b, c), (c, a), (a, b)))
    total = e0 + e1 + e2
    inside = (e0 >= 0) & (e1 >= 0) & (e2 >= 0) & (total > 0)
    value = (e0 * (1 / a[:, 2]) + e1 * (1 / b[:, 2]) + e2 * (1 / c[:, 2])) / total
    return torch.where(inside, value, 0)


def _edge(p: Tensor, q: Tensor, x: Tensor, y: Tensor) -> Tensor:
    """Return twice the signed area of (p, q, point), evaluated from the lexicographically smaller end."""
    swap = (q[:, 0] < p[:, 0]) | ((q[:, 0] == p[:, 0]) & (q[:, 1] < p[:, 1]))
    start, end = torch.where(swap[:, None], q, p), torch.where(swap[:, None], p, q)
    rise, run = end[:, 1] - start[:, 1], end[:, 0] - start[:, 0]
    value = run * (y - start[:, 1]) - rise * (x - start[:, 0])
    return torch.where(swap, -value, value)
