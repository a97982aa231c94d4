"""Closed surfaces by formula: rounded boxes, superquadrics, solids of revolution, tubes, wheels, single sheets.

Notation: a grid (rows, columns, 3) holds points of a smooth sheet; its u grows along the columns, its v along the
rows, and u x v points outwards. A shape is a list of smooth groups, each a list of grids that share their normals
where they touch; between two groups is a crease. z is up; lengths are any unit.
"""

from itertools import pairwise

import numpy as np

from demo_scene.geometry import face_normals, grid_faces

Group = list[np.ndarray]
Shape = list[Group]


def _cube(lines: list[np.ndarray], reshape) -> Group:
    """Return the faces of a box with grid lines at `lines` of each axis, moved by `reshape`: (..., 3) to (..., 3)."""
    group = []
    for axis in range(3):
        across, along = (axis + 1) % 3, (axis + 2) % 3
        for end in (-1, 0):
            grid = np.empty((len(lines[along]), len(lines[across]), 3))
            grid[..., across], grid[..., along] = lines[across][None], lines[along][:, None]
            grid[..., axis] = lines[axis][end]
            grid = grid[:, ::-1] if end == 0 else grid
            group.append(reshape(grid))
    return group


def rounded_box(half: tuple[float, float, float], radius: float) -> Shape:
    """A box of half edges `half` about the origin whose edges are rounded by `radius`."""
    lines = []
    for h in half:
        edge = np.linspace(0.0, radius, 4)[:-1]
        lines.append(np.concatenate([edge - h, np.linspace(radius - h, h - radius, 5), (h - edge)[::-1]]))
    core = np.array(half) - radius

    def rounded(points: np.ndarray) -> np.ndarray:
        inner = np.clip(points, -core, core)
        away = points - inner
        return inner + radius * away / np.linalg.norm(away, axis=-1, keepdims=True)

    return [_cube(lines, rounded)]


def superquadric(half: tuple[float, float, float], exponent: float) -> Shape:
    """Sum of |x / half|^(2 / exponent) = 1: a box for a small exponent, an ellipsoid for 1."""
    line = np.tan(np.linspace(-np.pi / 4, np.pi / 4, 15))

    def scaled(points: np.ndarray) -> np.ndarray:
        norm = (np.abs(points) ** (2 / exponent)).sum(axis=-1, keepdims=True) ** (exponent / 2)
        return points / norm * np.array(half)

    return [_cube([line] * 3, scaled)]


def revolved(runs: list[np.ndarray], segments: int = 48) -> Shape:
    """Turn smooth profile runs, each (n, 2) of (radius, height), around the z axis; going upwards is outside."""
    angle = np.linspace(0.0, 2 * np.pi, segments + 1)
    around = np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    return [[run[:, None, :1] * around + run[:, None, 1:] * np.array([0.0, 0.0, 1.0])] for run in runs]


def turned(*corners: tuple[float, float], segments: int = 48) -> Shape:
    """Turn a polygon of (radius, height) around the z axis, with a crease at every corner."""
    return revolved([np.linspace(a, b, 4) for a, b in pairwise(corners)], segments)


def tube(path: np.ndarray, radius: float, segments: int = 10) -> Shape:
    """A round bar along a path (n, 3), with flat ends."""
    tangent = np.gradient(path, axis=0)
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
    normal = np.empty_like(path)
    normal[0] = np.cross(tangent[0], np.eye(3)[np.abs(tangent[0]).argmin()])
    for k in range(1, len(path)):  # transported along the path, so that the tube does not twist
        normal[k] = normal[k - 1] - tangent[k] * (normal[k - 1] @ tangent[k])
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    angle = np.linspace(0.0, 2 * np.pi, segments + 1)[None, :, None]
    ring = np.cos(angle) * normal[:, None] + np.sin(angle) * np.cross(tangent, normal)[:, None]
    side = path[:, None] + radius * ring
    first, last = (np.stack([path[k] + 0 * side[k], side[k]]) for k in (0, -1))
    return [[first], [side], [last[::-1]]]


def bar(start: tuple[float, float, float], end: tuple[float, float, float], radius: float) -> Shape:
    """A thin straight bar."""
    return tube(np.linspace(start, end, 3), radius)


def wheel(radius: float, width: float, spokes: int, tyre: float) -> tuple[Shape, Shape]:
    """A wheel about the z axis: its tyre, a ring of thickness `tyre`, and its hub with spokes."""
    angle = np.linspace(0, 2 * np.pi, 17)
    ring = np.stack([radius - tyre / 2 + tyre / 2 * np.cos(angle), width / 2 * np.sin(angle)], axis=1)
    hub = turned((0, -0.6 * width), (2.5 * tyre, -0.6 * width), (2.5 * tyre, 0.6 * width), (0, 0.6 * width))
    for a in 2 * np.pi * np.arange(spokes) / spokes:
        hub = hub + bar((0, 0, 0), ((radius - tyre) * np.cos(a), (radius - tyre) * np.sin(a), 0), 0.4 * tyre)
    return revolved([ring]), hub


def sheet(u: tuple[float, float, float], v: tuple[float, float, float], pieces: int = 1) -> Shape:
    """A flat rectangle about the origin that spans -u to u and -v to v, in pieces x pieces grids; u x v is its front."""
    edges = np.linspace(-1, 1, pieces + 1)
    spans = list(pairwise(edges))
    return [
        [
            np.array(s)[None, :, None] * np.array(u) + np.array(t)[:, None, None] * np.array(v)
            for s in spans
            for t in spans
        ]
    ]


def disc(radius: float) -> Shape:
    """A flat disc about the origin that faces up: a square of texels mapped concentrically (Shirley and Chiu 1997)."""
    x, y = np.meshgrid(*[np.linspace(-1, 1, 33)] * 2)
    reach = np.maximum(np.abs(x), np.abs(y))
    wide = np.abs(x) >= np.abs(y)
    share = np.where(wide, y, x) / np.where(wide, x + (reach == 0), y)
    angle = np.where(wide, np.pi / 4 * share, np.pi / 2 - np.pi / 4 * share)
    sign = np.where(np.where(wide, x, y) < 0, -1.0, 1.0)
    return [[radius * np.stack([sign * reach * np.cos(angle), sign * reach * np.sin(angle), 0 * x], axis=-1)]]


def grid_coordinates(grid: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return u (columns,) and v (rows,) of a grid in [0, 1], by mean arc length, so that textures stretch little."""

    def along(axis: int) -> np.ndarray:
        step = np.linalg.norm(np.diff(grid, axis=axis), axis=-1).mean(axis=1 - axis)
        length = np.concatenate([[0.0], np.cumsum(step)])
        return length / length[-1]

    return along(1), along(0)


def group_mesh(group: Group) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return vertices (V, 3), unit normals (V, 3) and faces (F, 3) of a smooth group, grid after grid."""
    vertices = np.concatenate([grid.reshape(-1, 3) for grid in group])
    starts = np.cumsum([0] + [grid.shape[0] * grid.shape[1] for grid in group])
    faces = np.concatenate(
        [grid_faces(g.shape[0], g.shape[1] - 1) + s for g, s in zip(group, starts[:-1], strict=True)]
    )
    area = face_normals(vertices, faces)
    kept = np.linalg.norm(area, axis=1) > 1e-12  # at a pole every second triangle is a line
    size = np.ptp(vertices, axis=0).max()
    shared = np.unique(np.round(vertices / size, 6), axis=0, return_inverse=True)[1].reshape(-1)
    total = np.zeros((shared.max() + 1, 3))
    for corner in range(3):
        np.add.at(total, shared[faces[:, corner]], area)
    normals = total[shared]
    return vertices, normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12), faces[kept]
