"""Equirectangular maps in z-up form, as files have them, and their conversion to and from cubemaps.

A map has H rows and 2H columns; row 0 is the top. With u and v in [0, 1] from the left and the top, direction
d lies at

    u = 0.5 - atan2(d_y, d_x) / 2 pi,   v = acos(d_z) / pi

so the centre column looks along +x, the left quarter along +y, the top row along +z. Between texel centres a
map is bilinear; columns wrap, and the row beyond a pole is the row on this side, half a turn away.
"""

import math

import torch
from torch import Tensor

from lightprobe.core.errors import InputError
from lightprobe.kernels import weighted_gather
from lightprobe.light import cubemap

_PER_TEXEL = 4  # samples along a texel edge of the map
_AT_ONCE = 2**20  # samples; each takes some 400 bytes on the way


def directions(height: int, device: torch.device | str = "cpu") -> Tensor:
    """Return the unit directions (H, 2H, 3) float32 of the texel centres."""
    return _directions(height, 1, device).float()


def solid_angles(height: int, device: torch.device | str = "cpu") -> Tensor:
    """Return the exact solid angles (H, 2H) float32 in steradians; they sum to 4 pi."""
    edges = torch.cos(torch.linspace(0.0, math.pi, height + 1, dtype=torch.float64, device=device))
    band = (edges[:-1] - edges[1:]) * (math.pi / height)
    return band[:, None].expand(height, 2 * height).float().contiguous()


def from_cubemap(cube: Tensor, height: int) -> Tensor:
    """Return the map (H, 2H, C) of a cubemap (6, R, R, C), differentiable in the cubemap.

    Bilinear; where the map is coarser than the cubemap, a texel is the mean of several look-ups by solid
    angle.
    """
    resolution = cube.shape[1]
    split = max(1, math.ceil(4 * resolution / height))
    values = cube.reshape(-1, cube.shape[-1])
    sample = _directions(height, split, cube.device).to(cube.dtype).reshape(-1, 3)
    looked_up = weighted_gather(values, *cubemap.bilinear_taps(sample, resolution))
    rows = solid_angles(height * split, cube.device)[:, 0].to(cube.dtype).reshape(height, split)
    share = rows / rows.sum(1, keepdim=True)  # of a texel's rows: at a pole they differ
    looked_up = looked_up.reshape(height, split, 2 * height, split, -1).mean(3)
    return (looked_up * share[:, :, None, None]).sum(1)


def to_cubemap(map: Tensor, resolution: int) -> Tensor:
    """Return the cubemap (6, R, R, C) of a map (H, 2H, C): the mean of the map over each texel's solid angle.

    Samples are dense enough for both maps, so a sun of one texel keeps its energy. Raises `InputError` unless
    W = 2H.
    """
    height, width = map.shape[:2]
    if width != 2 * height:
        size = f"{width} x {height}"
        raise InputError(f"An environment map must be twice as wide as high, not {size}: crop or resize it.")
    split = max(2, math.ceil(_PER_TEXEL * height / (2 * resolution)))
    values = map.reshape(-1, map.shape[-1])
    faces, rows = [], resolution * split
    for face in range(6):
        total, share = (map.new_zeros(resolution, resolution, size) for size in (map.shape[-1], 1))
        for some in torch.arange(rows, device=map.device).split(max(1, _AT_ONCE // rows)):
            point, solid_angle = _face_samples(face, rows, some)
            weight = solid_angle[:, None].to(map.dtype)
            looked_up = weighted_gather(values, *_bilinear_taps(point, height, map.dtype))
            for sums, each in ((total, looked_up * weight), (share, weight)):
                across = each.reshape(len(some), resolution, split, -1).sum(2)
                sums.index_add_(0, some.div(split, rounding_mode="floor"), across)
        faces.append(total / share)
    return torch.stack(faces)


def sample(map: Tensor, directions: Tensor) -> Tensor:
    """Return the values (N, C) of a map (H, 2H, C) in unit directions (N, 3), bilinear."""
    index, weight = _bilinear_taps(directions.double(), map.shape[0], map.dtype)
    return weighted_gather(map.reshape(-1, map.shape[-1]), index, weight)


def _directions(height: int, split: int, device: torch.device | str) -> Tensor:
    """Return the directions of a grid `split` times as fine as the map, (H split, 2H split, 3) float64."""
    rows = height * split
    step = math.pi / rows
    theta = (torch.arange(rows, dtype=torch.float64, device=device)[:, None] + 0.5) * step
    phi = math.pi - (torch.arange(2 * rows, dtype=torch.float64, device=device) + 0.5) * step
    x, y = theta.sin() * phi.cos(), theta.sin() * phi.sin()
    return torch.stack([x, y, theta.cos().expand_as(x)], dim=-1)


def _bilinear_taps(direction: Tensor, height: int, dtype: torch.dtype) -> tuple[Tensor, Tensor]:
    """Return index (N, 4) into the flattened map and weight (N, 4) of directions (N, 3) float64."""
    unit_z = direction[:, 2] / direction.norm(dim=-1)
    x = (0.5 - torch.atan2(direction[:, 1], direction[:, 0]) / (2.0 * math.pi)) * (2 * height) - 0.5
    y = torch.acos(unit_z.clamp(-1.0, 1.0)) / math.pi * height - 0.5
    x0, y0 = x.floor(), y.floor()
    fx, fy = x - x0, y - y0
    rows = []
    for row in (y0.long(), y0.long() + 1):
        turn = torch.where((row < 0) | (row >= height), height, 0)  # half of a row: beyond a pole
        left, right = (x0.long() + turn) % (2 * height), (x0.long() + 1 + turn) % (2 * height)
        rows += [row.clamp(0, height - 1) * (2 * height) + column for column in (left, right)]
    index = torch.stack(rows, dim=-1)
    weight = torch.stack([(1 - fx) * (1 - fy), fx * (1 - fy), (1 - fx) * fy, fx * fy], dim=-1)
    return index, weight.to(dtype)


def _face_samples(face: int, side: int, rows: Tensor) -> tuple[Tensor, Tensor]:
    """Return points (K side, 3) float64 and solid angles (K side,) of `rows` (K,) of a face's square grid."""
    centres = (torch.arange(side, dtype=torch.float64, device=rows.device) + 0.5) * (2.0 / side) - 1.0
    b, a = (grid.flatten() for grid in torch.meshgrid(centres[rows], centres, indexing="ij"))
    point = cubemap.face_points(torch.full_like(a, face, dtype=torch.long), a, b)
    return point, (2.0 / side) ** 2 / point.norm(dim=-1) ** 3
