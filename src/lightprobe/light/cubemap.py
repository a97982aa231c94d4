"""Cubemaps: texel directions, solid angles and seamless bilinear look-ups.

Notation: a cubemap is a tensor (6, R, R, C), faces in the order +X -X +Y -Y +Z -Z with OpenGL's texel
orientation; flat texel index = (face * R + row) * R + column. On a face, (a, b) in [-1, 1]^2 run along
columns and rows and the direction is major + a * along + b * down, not normalised. Directions point from the
object to the light.
"""

import functools
import itertools
import math

import torch
from torch import Tensor

# Per face: the direction at the face centre, and the change of direction along columns and rows.
_MAJOR = ((1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0), (0, 0, 1), (0, 0, -1))
_ALONG = ((0, 0, -1), (0, 0, 1), (1, 0, 0), (1, 0, 0), (1, 0, 0), (-1, 0, 0))  # along columns
_DOWN = ((0, -1, 0), (0, -1, 0), (0, 0, 1), (0, 0, -1), (0, -1, 0), (0, -1, 0))  # along rows


@functools.lru_cache(maxsize=16)
def frames(device: torch.device) -> tuple[Tensor, Tensor, Tensor]:
    """Return (major, along, down) of the faces, each (6, 3) float64."""
    major, along, down = torch.tensor((_MAJOR, _ALONG, _DOWN), dtype=torch.float64, device=device)
    return major, along, down


def face_points(face: Tensor, a: Tensor, b: Tensor) -> Tensor:
    """Return the unnormalised direction (..., 3) of face coordinates `a` (columns) and `b` (rows) on `face`."""
    major, along, down = (frame.to(a.dtype)[face] for frame in frames(a.device))
    return major + a[..., None] * along + b[..., None] * down


@functools.lru_cache(maxsize=16)
def _frame_parts(device: torch.device) -> tuple[Tensor, Tensor]:
    """Return the axes (6, 3) int64 that major, along and down of the faces run along, and their signs (6, 3)."""
    frame = torch.stack(frames(device), dim=1)
    return frame.abs().argmax(-1), frame.sum(-1)


def face_coordinates(direction: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """Return (face int64, a, b), each (...,), of directions (..., 3); a and b are differentiable."""
    x, y, z = direction.detach().unbind(-1)
    size_x, size_y, size_z = x.abs(), y.abs(), z.abs()
    face = torch.where(size_y >= size_z, 2 + (y < 0).long(), 4 + (z < 0).long())
    face = torch.where((size_x >= size_y) & (size_x >= size_z), (x < 0).long(), face)
    flat, shape = face.flatten(), (*face.shape, 3)
    axes, signs = (part.index_select(0, flat).reshape(shape) for part in _frame_parts(face.device))
    major, along, down = (direction.gather(-1, axes) * signs.to(direction.dtype)).unbind(-1)
    return face, along / major, down / major


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
    """Return `directions` (6, R, R, 3) in float64."""
    points = face_points(*texel_grid(resolution, device))
    return points / points.norm(dim=-1, keepdim=True)


def solid_angles(resolution: int, device: torch.device | str = "cpu") -> Tensor:
    """Return the solid angles (6, R, R) float32 of the texels in steradians; they sum to 4 pi."""
    return exact_solid_angles(resolution, device).float()


def sphere_mean(values: Tensor) -> Tensor:
    """Return the mean over the sphere () of a cubemap (6, R, R), or (C,) of one (6, R, R, C)."""
    angle = solid_angles(values.shape[1], values.device)
    weighted = values * (angle if values.ndim == 3 else angle[..., None])
    return weighted.sum((0, 1, 2)) / (4 * math.pi)


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
def cells(resolution: int, device: torch.device) -> Tensor:
    """Return the four texels around every point between texel centres: flat indices (6 (R + 1)^2, 4) int32.

    Faces have the border of `padding`. Where three faces meet there is no fourth texel: -1.
    """
    index = padding(resolution, torch.device("cpu")).to(torch.int32).reshape(6, resolution + 2, -1)
    for row in (0, -1):
        for column in (0, -1):
            index[:, row, column] = -1
    corners = (index[:, :-1, :-1], index[:, :-1, 1:], index[:, 1:, :-1], index[:, 1:, 1:])
    return torch.stack(corners, dim=-1).reshape(-1, 4).to(device)


@functools.lru_cache(maxsize=16)
def padding(resolution: int, device: torch.device) -> Tensor:
    """Return the texels of every face with a border of one neighbour: flat indices int64 (6 (R + 2)^2,).

    A border texel is found by stepping a little over the edge at the height of its row: the texel on the other
    side is the true neighbour, which continuing the face's plane by half a texel could miss. Beyond a corner
    there is no texel; one of the two next to it stands in.
    """
    step = 1e-3 / resolution
    centres = (torch.arange(-1, resolution + 1, dtype=torch.float64) + 0.5) * (2.0 / resolution) - 1.0
    centres[0], centres[-1] = -1.0 - step, 1.0 + step
    face, a, b = _grid(centres)
    return nearest_texel(face_points(face, a, b), resolution).reshape(-1).to(device)


def nearest_texel(direction: Tensor, resolution: int) -> Tensor:
    """Return the flat int64 index (...,) of the texel that contains each direction (..., 3)."""
    face, a, b = face_coordinates(direction)
    column = ((a + 1.0) * (0.5 * resolution)).long().clamp(0, resolution - 1)
    row = ((b + 1.0) * (0.5 * resolution)).long().clamp(0, resolution - 1)
    return (face * resolution + row) * resolution + column


@functools.lru_cache(maxsize=16)  # a prefilter asks for every power of two up to its own
def symmetries(resolution: int, device: torch.device) -> tuple[Tensor, Tensor]:
    """Return the cube's 24 rotations and 24 reflections as (index, handedness), without resampling.

    index: (48, 6 R^2) int64, `x[index[k]]` is a cubemap x (6 R^2, ...) turned or mirrored; handedness: (48,)
    float32, -1 for a reflection.
    """
    texels = exact_directions(resolution).reshape(-1, 3)
    eye = torch.eye(3, dtype=torch.float64)
    turns = itertools.product(itertools.permutations(range(3)), itertools.product((1.0, -1.0), repeat=3))
    matrices = torch.stack([torch.tensor(s).double()[:, None] * eye[list(order)] for order, s in turns])
    index = torch.stack([nearest_texel(texels @ matrix, resolution) for matrix in matrices])
    return index.to(device), torch.linalg.det(matrices).round().float().to(device)


def bilinear_taps(direction: Tensor, resolution: int) -> tuple[Tensor, Tensor]:
    """Return the four texels and weights of a bilinear look-up that is continuous over edges and corners.

    direction: (N, 3), any length but zero. Returns index (N, 4) int32 into the 6 R^2 texels and weight (N, 4)
    of direction's dtype. Weights are >= 0, sum to 1 and are differentiable in the direction; the index is
    not. Where three faces meet the fourth texel does not exist: the other three share its weight equally.
    """
    return cell_taps(face_coordinates(direction), resolution, 0, cells(resolution, direction.device))


def cell_taps(
    coordinates: tuple[Tensor, Tensor, Tensor],
    resolution: Tensor | int,
    start: Tensor | int,
    table: Tensor,
    scale: Tensor | float = 1.0,
) -> tuple[Tensor, Tensor]:
    """Return `bilinear_taps`, times `scale`, of `face_coordinates` in one cubemap for each row.

    resolution and start: one for all rows or int64 (N,); `table` int32 holds the `cells` of every cubemap that
    occurs; a row's cells begin at its `start`. scale: one or (N,), differentiable.
    """
    face, a, b = coordinates
    half = 0.5 * resolution
    x = (a + 1.0) * half - 0.5
    y = (b + 1.0) * half - 0.5
    x0, y0 = x.detach().floor(), y.detach().floor()
    column, row = ((low.long() + 1).clamp(min=0).clamp(max=resolution) for low in (x0, y0))
    index = table.index_select(0, start + (face * (resolution + 1) + row) * (resolution + 1) + column)
    fx, fy = x - x0, (y - y0) * scale
    gx, gy = 1.0 - fx, scale - fy
    weight = torch.stack([gx * gy, fx * gy, gx * fy, fx * fy], dim=-1)
    if not _on_cpu(index):  # to look for them would make a GPU wait
        return index.clamp(min=0), _three_texels(index, weight)
    at_edge = ((column == 0) | (column == resolution)) & ((row == 0) | (row == resolution))
    corner = at_edge.nonzero()[:, 0]  # few
    if len(corner):
        weight = weight.index_copy_(0, corner, _three_texels(index[corner], weight[corner]))
        index.clamp_(min=0)
    return index, weight


def _on_cpu(tensor: Tensor) -> bool:
    return tensor.device.type == "cpu"


def _three_texels(index: Tensor, weight: Tensor) -> Tensor:
    """Return the weights (N, 4) with a missing texel's shared equally among the other three."""
    missing = index < 0
    kept = weight.masked_fill(missing, 0.0)
    lost = (weight - kept).sum(-1, keepdim=True)
    return (kept + lost / 3.0).masked_fill(missing, 0.0)
