"""Random closed surfaces: a few primitives, joined, cut out of each other and dented.

Signed distances are negative inside; they are exact or too small, which moves no surface. Points p are (N,
3).
"""

import itertools
import math

import numpy as np
import torch
from torch import Tensor

from lightprobe.distillation.draw import Draw, upright
from lightprobe.geometry.marching_tetrahedra import Crossing, marching_tetrahedra
from lightprobe.geometry.mesh import clean, decimate
from lightprobe.geometry.tet_lattice import build_lattice

CELLS = 40  # of the lattice, per edge
REACH = 1.3  # half edge of the lattice
FACES = 7000
_FEWEST_FACES = 200


def random_solid(draw: Draw) -> tuple[Tensor, Tensor]:
    """Return vertices (V, 3) float32, centred and of radius 1, and faces (F, 3) int32 of a new solid."""
    while True:
        vertices, faces = _surface(draw)
        if len(faces) >= _FEWEST_FACES:
            return vertices, faces


def _surface(draw: Draw) -> tuple[Tensor, Tensor]:
    axis = torch.linspace(-REACH, REACH, CELLS + 1)
    points = torch.stack(torch.meshgrid(axis, axis, axis, indexing="ij"), -1).reshape(-1, 3)
    grid = _distance(points, draw).reshape(CELLS + 1, CELLS + 1, CELLS + 1)
    inside = (grid < 0).numpy()
    places = itertools.product(range(2), repeat=3)
    corners = [inside[i : CELLS + i, j : CELLS + j, k : CELLS + k] for i, j, k in places]
    lattice = build_lattice(np.any(corners, 0) & ~np.all(corners, 0), np.full(3, -REACH), 2 * REACH / CELLS)
    place = ((lattice.vertices + REACH) * CELLS / (2 * REACH)).round().long()
    distance = grid[place[:, 0], place[:, 1], place[:, 2]]
    vertices, faces = marching_tetrahedra(lattice, Crossing.of(lattice, distance), lattice.vertices, distance)
    v, f = clean(vertices.numpy(), faces.numpy())
    v, f = clean(*decimate(v, f, FACES))
    if len(f) == 0:
        return torch.zeros(0, 3), torch.zeros(0, 3, dtype=torch.int32)
    v = v - (v.min(0) + v.max(0)) / 2
    return torch.from_numpy((v / np.linalg.norm(v, axis=1).max()).astype(np.float32)), torch.from_numpy(f)


def _distance(p: Tensor, draw: Draw) -> Tensor:
    distance, softness = _primitive(p, draw), draw.scale(0.01, 0.15)
    for _ in range(draw.count(0, 6)):
        other = _primitive(p, draw)
        if draw.uniform(0, 1) < 0.2:
            distance = torch.maximum(distance, -other)
        else:
            blend = (0.5 + 0.5 * (other - distance) / softness).clamp(0, 1)
            distance = torch.lerp(other, distance, blend) - softness * blend * (1 - blend)
    dents = draw.uniform(0, 0.06) * draw.noise(p, draw.scale(2, 9))
    return torch.maximum(distance + dents, p.abs().amax(1) - 1.2)


def _primitive(p: Tensor, draw: Draw) -> Tensor:
    """Return the distances (N,) to an ellipsoid, box, cylinder, ring or stick near the middle."""
    turn = upright(draw.direction(), draw.uniform(0, 2 * math.pi))
    q = (p - 0.55 * draw.uniform(0, 1) * draw.direction()) @ turn.T
    across = q[:, :2].norm(dim=1)
    kind = draw.count(0, 4)
    if kind == 0:
        half = torch.tensor([draw.scale(0.2, 0.6) for _ in range(3)])
        return ((q / half).norm(dim=1) - 1) * float(half.min())
    if kind == 1:
        return _rounded(q.abs() - torch.tensor([draw.scale(0.1, 0.55) for _ in range(3)]), 0.05)
    if kind == 2:
        return _rounded(
            torch.stack([across - draw.scale(0.1, 0.45), q[:, 2].abs() - draw.scale(0.15, 0.8)], 1), 0.03
        )
    if kind == 3:
        return torch.stack([across - draw.uniform(0.3, 0.65), q[:, 2]], 1).norm(dim=1) - draw.scale(0.07, 0.2)
    reach, radius = draw.scale(0.2, 0.7), draw.scale(0.08, 0.3)
    return torch.stack([across, q[:, 2] - q[:, 2].clamp(-reach, reach)], 1).norm(dim=1) - radius


def _rounded(beyond: Tensor, radius: float) -> Tensor:
    """Return the distance (N,) to a product of intervals, `beyond` (N, K) their ends, with edges of a radius."""
    beyond = beyond + radius
    return beyond.clamp(min=0).norm(dim=1) + beyond.amax(1).clamp(max=0) - radius
