"""Cubemaps: texel directions, solid angles and seamless bilinear look-ups.

Notation: a cubemap is a tensor (6, R, R, C), faces in the order +X -X +Y -Y +Z -Z with OpenGL's texel orientation;
flat texel index = (face * R + row) * R + column. On a face, (a, b) in [-1, 1]^2 run along columns and rows and the
direction is major + a * along + b * down, not normalised. Directions point from the object to the light.
"""

import functools

import torch
from torch import Tensor

# Per face: the direction at the face centre, and the change of direction along columns and rows.
_MAJOR = ((1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0), (0, 0, 1), (0, 0, -1))
_ALONG = ((0, 0, -1), (0, 0, 1), (1, 0, 0), (1, 0, 0), (1, 0, 0), (-1, 0, 0))
_DOWN = ((0, -1, 0), (0, -1, 0), (0, 0, 1), (0, 0, -1), (0, -1, 0), (0, -1, 0))


@functools.lru_cache(maxsize=16)
def frames(device: torch.device) -> tuple[Tensor, Tensor, Tensor]:
    """Return (major, along, down) of the faces, each (6, 3) float64."""
    return (
        torch.tensor(_MAJOR, dtype=torch.float64, device=device),
        torch.tensor(_ALONG, dtype=torch.float64, device=device),
        torch.tensor(_DOWN, dtype=torch.float64, device=device),
    )


def face_points(face: Tensor, a: Tensor, b: Tensor) -> Tensor:
    """Return the unnormalised direction (..., 3) of face coordinates `a` (columns) and `b` (rows) on `face`."""
    major, along, down = (frame.to(a.dtype)[face] for frame in frames(a.device))
    return major + a[..., None] * along + b[..., None] * down


def face_coordinates(direction: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """Return (face int64, a, b), each (...,), of directions (..., 3) of any length; a and b are differentiable."""
    axis = direction.detach().abs().argmax(-1)
    major, along, down = (frame.to(direction.dtype) for frame in frames(direction.device))
    negative = direction.detach().gather(-1, axis[..., None])[..., 0] < 0
    face = 2 * axis + negative
    scale = (direction * major[face]).sum(-1)
    return face, (direction * along[face]).sum(-1) / scale, (direction * down[face]).sum(-1) / scale


def texel_grid(resolution: int, device: torch.device | str = "cpu") -> tuple[Tensor, Tensor, Tensor]:
    """Return (face int64, a, b float64), each (6, R, R), of the texel centres."""
    centres = (torch.arange(resolution, dtype=torch.float64, device=device) + 0.5) * (2.0 / resolution) - 1.0
    return _grid(centres)


def _grid(centres: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """Return (face, a, b), each (6, n, n), of the product grid of n face coordinates."""
    n = len(centres)
    face = torch.arange(6, device=centres.device)[:, None, None].expand(6, n, n)
    return face, centres.expand(6, n, n), centres[:, None].expand(6, n, n)


def directions(resolution: int, device: torch.device | str = "cpu") -> Tensor:
    """Return the unit directions (6, R, R, 3) float32 of the texel centres."""
    return exact_directions(resolution, device).float()


def exact_directions(resolution: int, device: torch.device | str = "cpu") -> Tensor:
    """Return `directions` in float64."""
    points = face_points(*texel_grid(resolution, device))
    return points / points.norm(dim=-1, keepdim=True)


def solid_angles(resolution: int, device: torch.device | str = "cpu") -> Tensor:
    """Return the exact solid angles (6, R, R) float32 of the texels in steradians; they sum to 4 pi."""
    return exact_solid_angles(resolution, device).float()


def exact_solid_angles(resolution: int, device: torch.device | str = "cpu") -> Tensor:
    """Return `solid_angles` in float64.

    The part of the face between its centre and (a, b) subtends atan2(a b, sqrt(a^2 + b^2 + 1)).
    """
    edges = torch.linspace(-1.0, 1.0, resolution + 1, dtype=torch.float64, device=device)
    a, b = edges[None, :], edges[:, None]
    corner = torch.atan2(a * b, torch.sqrt(a * a + b * b + 1.0))
    area = corner[1:, 1:] - corner[1:, :-1] - corner[:-1, 1:] + corner[:-1, :-1]
    return area.expand(6, resolution, resolution).contiguous()


@functools.lru_cache(maxsize=64)
def bordered_index(resolution: int, device: torch.device) -> Tensor:
    """Return flat texel indices, 6 (R + 2)^2 int32: each face with a border of its neighbours, corners -1.

    A border texel is found by stepping a little over the edge at the height of its row: the texel on the other side
    of the edge is the true neighbour, which continuing the face's plane by half a texel could miss.
    """
    step = 1e-3 / resolution
    centres = (torch.arange(-1, resolution + 1, dtype=torch.float64) + 0.5) * (2.0 / resolution) - 1.0
    centres[0], centres[-1] = -1.0 - step, 1.0 + step
    face, a, b = _grid(centres)
    index = nearest_texel(face_points(face, a, b), resolution).to(torch.int32)
    for row in (0, -1):
        for column in (0, -1):
            index[:, row, column] = -1
    return index.flatten().to(device)


def nearest_texel(direction: Tensor, resolution: int) -> Tensor:
    """Return the flat int64 index (...,) of the texel that contains each direction (..., 3)."""
    face, a, b = face_coordinates(direction)
    column = ((a + 1.0) * (0.5 * resolution)).long().clamp(0, resolution - 1)
    row = ((b + 1.0) * (0.5 * resolution)).long().clamp(0, resolution - 1)
    return (face * resolution + row) * resolution + column


def bilinear_taps(direction: Tensor, resolution: int) -> tuple[Tensor, Tensor]:
    """Return the four texels and weights of a bilinear look-up that is continuous over edges and corners.

    direction: (N, 3), any length but zero. Returns index (N, 4) int32 into the 6 R^2 texels and weight (N, 4) of
    direction's dtype. Weights are >= 0, sum to 1 and are differentiable in the direction; the index is not.
    Where three faces meet the fourth texel does not exist: the other three share its weight equally.
    """
    return bordered_taps(face_coordinates(direction), resolution, 0, bordered_index(resolution, direction.device))


def bordered_taps(
    coordinates: tuple[Tensor, Tensor, Tensor], resolution: Tensor | int, start: Tensor | int, table: Tensor
) -> tuple[Tensor, Tensor]:
    """Return `bilinear_taps` of `face_coordinates` in cubemaps that may differ from row to row.

    resolution and start: one for all rows or int64 (N,); `table` int32 holds the `bordered_index` of every cubemap
    that occurs, that of a row beginning at its `start`.
    """
    face, a, b = coordinates
    half = 0.5 * resolution
    x = (a + 1.0) * half - 0.5
    y = (b + 1.0) * half - 0.5
    x0, y0 = x.detach().floor(), y.detach().floor()
    fx, fy = x - x0, y - y0
    side = resolution + 2
    column = (x0.long() + 1).clamp(min=0).minimum(torch.as_tensor(resolution, device=face.device))
    row = (y0.long() + 1).clamp(min=0).minimum(torch.as_tensor(resolution, device=face.device))
    first = start + (face * side + row) * side + column
    index = table[torch.stack([first, first + 1, first + side, first + side + 1], dim=-1)]
    gx, gy = 1.0 - fx, 1.0 - fy
    weight = torch.stack([gx * gy, fx * gy, gx * fy, fx * fy], dim=-1)
    missing = index < 0
    if bool(missing.any()):
        kept = weight.masked_fill(missing, 0.0)
        lost = (weight - kept).sum(-1, keepdim=True)
        weight = (kept + lost / 3.0).masked_fill(missing, 0.0)
        index = index.clamp(min=0)
    return index, weight
