"""Triton backend of the rasteriser: faces compete for pixels by a 64-bit atomic minimum of a packed depth | id.

The key of a face at a pixel is the complement of the bits of its float32 inverse depth above its index: the
bits of positive floats order like the floats, so the smallest key is the nearest, lowest-numbered face, in
whatever order the faces come. The arithmetic is float64 and, without fused operations, the reference's to the
bit.

Small faces are drawn side by side, one lane per (face, pixel of its box). A face with a large box would hold
up its neighbours: its number goes into a list, and a second launch deals the boxes on the list out to many
lanes each.
"""

import torch
import triton
import triton.language as tl
from torch import Tensor

FACES = 32  # of one program
STRIP = 4  # pixels of each that it draws at once
LARGE = 256  # pixels of the largest box drawn side by side
LISTS, PARTS = 64, 8  # second launch: programs along the list, and in a box
SPAN = 1024  # pixels that one of these programs draws at once
EMPTY = (1 << 63) - 1  # key of a pixel without a face: further than any
LOW = (1 << 32) - 1  # bits of a key that hold the face
ALL_BITS = (1 << 31) - 1  # of a positive float's pattern, from which depth is taken


def rasterize(screen: Tensor, faces: Tensor, height: int, width: int) -> tuple[Tensor, Tensor]:
    """Return face (H, W) int32 and inverse depth (H, W) float32."""
    key = torch.full((height, width), EMPTY, dtype=torch.int64, device=screen.device)
    count = faces.shape[0]
    if count:
        points, corners = screen.contiguous(), faces.contiguous()
        large = torch.empty(count, dtype=torch.int32, device=screen.device)
        length = torch.zeros(1, dtype=torch.int32, device=screen.device)
        with torch.cuda.device_of(screen):
            case = points, corners, key, large, length
            sizes = count, height, width, FACES, STRIP, LARGE
            _draw_small[(triton.cdiv(count, FACES),)](*case, *sizes, enable_fp_fusion=False)
            _draw_large[(LISTS, PARTS)](*case, height, width, SPAN, enable_fp_fusion=False)
    face = torch.where(key == EMPTY, -1, key & LOW).to(torch.int32)
    bits = torch.where(key == EMPTY, 0, ALL_BITS - (key >> 32)).to(torch.int32)
    return face, bits.view(torch.float32)


@triton.jit
def _corner(points, faces, f, live, NUMBER: tl.constexpr):
    """Return x, y and depth of one corner, float64; beyond the last face all 0, which is not drawn."""
    at = points + 3 * tl.load(faces + 3 * f + NUMBER, mask=live, other=0).to(tl.int64)
    x = tl.load(at, mask=live, other=0.0).to(tl.float64)
    y = tl.load(at + 1, mask=live, other=0.0).to(tl.float64)
    z = tl.load(at + 2, mask=live, other=0.0).to(tl.float64)
    return x, y, z


@triton.jit
def _pixels(low, high, size):
    """Return the first of the pixels whose centres lie in [low, high], and how many there are."""
    limit = size.to(tl.float64)
    first = tl.minimum(tl.maximum(tl.ceil(low - 0.5), 0.0), limit).to(tl.int32)
    last = tl.maximum(tl.minimum(tl.floor(high - 0.5), limit - 1.0), -1.0).to(tl.int32)
    return first, tl.maximum(last - first + 1, 0)


@triton.jit
def _box(ax, ay, az, bx, by, bz, cx, cy, cz, height, width):
    """Return left, columns, top and rows of the boxes; no columns where the face is not drawn."""
    size = tl.abs(ax) + tl.abs(ay) + tl.abs(az) + tl.abs(bx) + tl.abs(by) + tl.abs(bz)
    finite = size + tl.abs(cx) + tl.abs(cy) + tl.abs(cz) < float("inf")  # so written that NaN fails
    drawn = finite & (az > 0) & (bz > 0) & (cz > 0)
    low_x, high_x = tl.minimum(tl.minimum(ax, bx), cx), tl.maximum(tl.maximum(ax, bx), cx)
    low_y, high_y = tl.minimum(tl.minimum(ay, by), cy), tl.maximum(tl.maximum(ay, by), cy)
    left, columns = _pixels(tl.where(drawn, low_x, 1.0), tl.where(drawn, high_x, 0.0), width)
    top, rows = _pixels(tl.where(drawn, low_y, 1.0), tl.where(drawn, high_y, 0.0), height)
    return left, tl.where(drawn, columns, 0), top, rows


@triton.jit
def _edge(px, py, qx, qy, x, y):
    """Return twice the signed area of (p, q, point), evaluated from the lexicographically smaller end."""
    swap = (qx < px) | ((qx == px) & (qy < py))
    sx, sy = tl.where(swap, qx, px), tl.where(swap, qy, py)
    run, rise = tl.where(swap, px, qx) - sx, tl.where(swap, py, qy) - sy
    value = run * (y - sy) - rise * (x - sx)
    return tl.where(swap, -value, value)


@triton.jit
def _compete(ax, ay, az, bx, by, bz, cx, cy, cz, f, column, row, live, key, width):
    """Let the faces f compete for the pixels (row, column)."""
    x, y = column.to(tl.float64) + 0.5, row.to(tl.float64) + 0.5
    area = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)
    sign = tl.where(area > 0, 1.0, tl.where(area < 0, -1.0, 0.0)).to(tl.float64)
    e0 = sign * _edge(bx, by, cx, cy, x, y)
    e1 = sign * _edge(cx, cy, ax, ay, x, y)
    e2 = sign * _edge(ax, ay, bx, by, x, y)
    total = e0 + e1 + e2
    inside = live & (e0 >= 0) & (e1 >= 0) & (e2 >= 0) & (total > 0)
    value = (e0 * (1.0 / az) + e1 * (1.0 / bz) + e2 * (1.0 / cz)) / tl.where(inside, total, 1.0)
    bits = value.to(tl.float32).to(tl.int32, bitcast=True).to(tl.int64)
    mine = ((0x7FFFFFFF - bits) << 32) | f.to(tl.int64)
    tl.atomic_min(key + row * width + column, mine, mask=inside, sem="relaxed")


@triton.jit(do_not_specialize=["height", "width"])
def _draw_small(
    points,
    faces,
    key,
    large,
    length,
    count,
    height,
    width,
    FACES: tl.constexpr,
    STRIP: tl.constexpr,
    LARGE: tl.constexpr,
):
    f = tl.program_id(0).to(tl.int64) * FACES + tl.arange(0, FACES)
    exists = f < count
    ax, ay, az = _corner(points, faces, f, exists, 0)
    bx, by, bz = _corner(points, faces, f, exists, 1)
    cx, cy, cz = _corner(points, faces, f, exists, 2)
    left, columns, top, rows = _box(ax, ay, az, bx, by, bz, cx, cy, cz, height, width)
    pixels = columns * rows
    big = pixels > LARGE
    place = tl.cumsum(big.to(tl.int32), axis=0) - 1
    start = tl.atomic_add(length, tl.sum(big.to(tl.int32), axis=0), sem="relaxed")
    tl.store(large + start + place, f.to(tl.int32), mask=big)
    pixels = tl.where(big, 0, pixels)
    wide = tl.maximum(columns, 1)
    ax, ay, az = ax[:, None], ay[:, None], az[:, None]
    bx, by, bz = bx[:, None], by[:, None], bz[:, None]
    cx, cy, cz, f = cx[:, None], cy[:, None], cz[:, None], f[:, None]
    for first in range(0, tl.max(pixels, axis=0), STRIP):
        offset = first + tl.arange(0, STRIP)[None, :]
        live = offset < pixels[:, None]
        column = left[:, None] + offset % wide[:, None]
        row = top[:, None] + offset // wide[:, None]
        _compete(ax, ay, az, bx, by, bz, cx, cy, cz, f, column, row, live, key, width)


@triton.jit(do_not_specialize=["height", "width"])
def _draw_large(points, faces, key, large, length, height, width, SPAN: tl.constexpr):
    lane = tl.arange(0, SPAN)
    step = tl.num_programs(1) * SPAN
    for place in range(tl.program_id(0), tl.load(length), tl.num_programs(0)):
        f = tl.load(large + place)
        ax, ay, az = _corner(points, faces, f, True, 0)
        bx, by, bz = _corner(points, faces, f, True, 1)
        cx, cy, cz = _corner(points, faces, f, True, 2)
        left, columns, top, rows = _box(ax, ay, az, bx, by, bz, cx, cy, cz, height, width)
        pixels = columns * rows
        for first in range(tl.program_id(1) * SPAN, pixels, step):
            offset = first + lane
            column, row, live = left + offset % columns, top + offset // columns, offset < pixels
            faces_of_lanes = f + tl.zeros([SPAN], dtype=tl.int32)
            _compete(ax, ay, az, bx, by, bz, cx, cy, cz, faces_of_lanes, column, row, live, key, width)
