"""Surfaces by formula, z up: solids of revolution and tubes swept along curves; and the coffee pot of these.

Notation: u in [0, 1] runs around (periodic, with a doubled seam), v in [0, 1] along the profile or path by
arc length. Lengths are in the modeller's units (the pot is about 2.1 tall) until `normalise`.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.interpolate import CubicSpline


@dataclass(frozen=True)
class Part:
    """One named piece of the surface with smooth normals and its own texture square."""

    name: str
    vertices: np.ndarray  # (V, 3) float64
    normals: np.ndarray  # (V, 3) float64, unit
    uv: np.ndarray  # (V, 2) float64 in [0, 1]
    faces: np.ndarray  # (F, 3) int64
    path: np.ndarray  # (R, 2) float64: v and place along the part's axis, not normalised; for the painters


def smooth(points: Sequence[tuple[float, ...]], count: int) -> np.ndarray:
    """Sample a cubic spline through `points` at `count` places evenly spaced by chord length."""
    array = np.asarray(points, float)
    knots = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(array, axis=0), axis=1))])
    return CubicSpline(knots, array)(np.linspace(0.0, knots[-1], count))


def arc_length(points: np.ndarray) -> np.ndarray:
    """Return how far along the polyline (n, D) every point lies, as a share of its length, (n,)."""
    length = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
    return length / length[-1]


def grid_faces(rows: int, columns: int) -> np.ndarray:
    """Triangles of a grid of rows x (columns + 1) vertices, outwards when u x v points outwards."""
    i, j = np.meshgrid(np.arange(rows - 1), np.arange(columns), indexing="ij")
    a = (i * (columns + 1) + j).ravel()
    b, c, d = a + 1, a + columns + 2, a + columns + 1
    return np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)])


def face_normals(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Return the normals (F, 3) of triangles, as long as twice their areas."""
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    return np.cross(b - a, c - a)


def _grid_normals(grid: np.ndarray) -> np.ndarray:
    """Area-weighted vertex normals of a grid (rows, columns + 1, 3) whose last column repeats the first."""
    rows, columns = grid.shape[0], grid.shape[1] - 1
    faces = grid_faces(rows, columns)
    area = face_normals(grid.reshape(-1, 3), faces)
    total = np.zeros((rows * (columns + 1), 3))
    for corner in range(3):
        np.add.at(total, faces[:, corner], area)
    total = total.reshape(grid.shape)
    total[:, 0] += total[:, -1]
    total[:, -1] = total[:, 0]
    pole = np.linalg.norm(grid[:, :-1] - grid[:, :1], axis=2).max(axis=1) < 1e-9
    total[pole] = total[pole, :-1].sum(axis=1, keepdims=True)
    return total / np.linalg.norm(total, axis=2, keepdims=True)


def grid_part(name: str, runs: list[np.ndarray], values: list[np.ndarray], path: np.ndarray) -> Part:
    """Join smooth grids (rows, columns + 1, 3) into one part; between two of them stays a crease."""
    vertices, normals, uvs, faces, offset = [], [], [], [], 0
    for grid, v in zip(runs, values, strict=True):
        rows, width = grid.shape[:2]
        u = np.linspace(0.0, 1.0, width)
        vertices.append(grid.reshape(-1, 3))
        normals.append(_grid_normals(grid).reshape(-1, 3))
        uvs.append(np.stack(np.broadcast_arrays(u[None], v[:, None]), axis=-1).reshape(-1, 2))
        faces.append(grid_faces(rows, width - 1) + offset)
        offset += rows * width
    joined = np.concatenate(vertices), np.concatenate(faces)
    kept = joined[1][np.linalg.norm(face_normals(*joined), axis=1) > 1e-9]  # at a pole every second is a line
    return Part(name, joined[0], np.concatenate(normals), np.concatenate(uvs), kept, path)


def revolve(name: str, runs: list[np.ndarray], segments: int) -> Part:
    """Turn profile runs, each (n, 2) of (radius, height), around the z axis; upwards is outside."""
    profile = np.concatenate(runs)
    v = arc_length(profile)
    angle = np.linspace(0.0, 2 * np.pi, segments + 1)
    around = np.stack([np.cos(angle), np.sin(angle)], 1)
    around[-1] = around[0]
    grids = [
        np.concatenate(
            [run[:, None, :1] * around[None], np.broadcast_to(run[:, None, 1:], (len(run), len(angle), 1))], 2
        )
        for run in runs
    ]
    ends = np.cumsum([len(run) for run in runs])[:-1]
    return grid_part(name, grids, np.split(v, ends), np.column_stack([v, profile[:, 1]]))


def sweep(
    name: str, path: np.ndarray, radii: np.ndarray, segments: int, tangent: np.ndarray | None = None
) -> Part:
    """Move an ellipse along `path` (n, 3) in the x-z plane; `radii` (n, 2) are its half axes in the plane and
    along y.

    `tangent` (n, 3) orients the ellipse where the path's own direction must not: a tube that turns back into
    itself.
    """
    tangent = np.gradient(path, axis=0) if tangent is None else tangent
    tangent = tangent / np.linalg.norm(tangent, axis=1, keepdims=True)
    side = np.array([0.0, 1.0, 0.0])
    normal = np.cross(side, tangent)
    angle = np.linspace(0.0, 2 * np.pi, segments + 1)
    in_plane = radii[:, None, :1] * np.cos(angle)[None, :, None] * normal[:, None]
    grid = path[:, None] + in_plane + radii[:, None, 1:] * np.sin(angle)[None, :, None] * side
    grid[:, -1] = grid[:, 0]
    v = arc_length(np.column_stack([path, radii]))
    return grid_part(name, [grid], [v], np.column_stack([v, path[:, 2]]))


def _body() -> Part:
    foot = [np.array([[0.0, 0.055], [0.18, 0.055], [0.345, 0.05]]), np.array([[0.345, 0.05], [0.365, 0.0]])]
    ring = smooth([(0.365, 0.0), (0.40, -0.006), (0.445, 0.0), (0.468, 0.03)], 5)
    low = [(0.462, 0.035), (0.53, 0.13), (0.625, 0.32), (0.68, 0.58), (0.655, 0.86)]
    wall = smooth([*low, (0.56, 1.12), (0.43, 1.34), (0.365, 1.50), (0.36, 1.60), (0.392, 1.665)], 25)
    lip = smooth([(0.392, 1.665), (0.388, 1.684), (0.368, 1.684), (0.356, 1.655)], 5)
    return revolve("body", [*foot, ring, wall, lip], 52)


def _lid() -> Part:
    edge = smooth([(0.356, 1.655), (0.352, 1.69), (0.338, 1.712)], 3)
    dome = smooth([(0.338, 1.712), (0.29, 1.738), (0.20, 1.79), (0.115, 1.836), (0.06, 1.86)], 9)
    return revolve("lid", [edge, dome], 44)


def _neck_band() -> Part:
    profile = [(0.372, 1.425), (0.408, 1.437), (0.416, 1.475), (0.408, 1.513), (0.36, 1.525)]
    return revolve("band", [smooth(profile, 8)], 52)


def _knob() -> Part:
    low = [(0.085, 1.845), (0.07, 1.872), (0.048, 1.90), (0.052, 1.93), (0.085, 1.962)]
    profile = smooth([*low, (0.103, 2.005), (0.092, 2.052), (0.052, 2.086), (0.0, 2.097)], 15)
    return revolve("knob", [profile], 20)


def _handle() -> Part:
    high = [(-0.33, 0, 1.475), (-0.52, 0, 1.53), (-0.80, 0, 1.545), (-1.03, 0, 1.40), (-1.09, 0, 1.14)]
    knots = [*high, (-1.00, 0, 0.86), (-0.82, 0, 0.66), (-0.62, 0, 0.545)]
    path = smooth(knots, 37)
    v = arc_length(path)
    swell = 0.058 + 0.014 * np.sin(np.pi * v) ** 2
    ferrule = 0.016 * ((v < 0.16) | (v > 0.88))
    bead = 0.010 * (np.exp(-(((v - 0.165) / 0.014) ** 2)) + np.exp(-(((v - 0.875) / 0.014) ** 2)))
    radius = swell * 0.86 + ferrule + bead
    return sweep("handle", path, np.column_stack([radius, radius * 1.18]), 14)


def _spout() -> Part:
    """The tube turns over its lip and runs back down to a closed end, so the mouth is a real, dark hollow."""
    knots = [(0.50, 0, 0.42), (0.72, 0, 0.60), (0.87, 0, 0.90), (0.98, 0, 1.22), (1.17, 0, 1.455)]
    outside = smooth(knots, 25)
    t = arc_length(outside)
    radius = 0.068 + 0.135 * (1 - t) ** 1.4 + 0.016 * np.exp(-(((t - 0.97) / 0.04) ** 2))
    tangent = np.gradient(outside, axis=0)
    back = slice(None, 13, -1)
    inner = np.maximum(radius[back] - 0.022, 0.03)
    inner[-1] = 1e-4
    tip = outside[-1] + 0.012 * tangent[-1] / np.linalg.norm(tangent[-1])
    path = np.concatenate([outside, tip[None], outside[back]])
    both = np.concatenate([radius, [radius[-1] - 0.011], inner])
    return sweep(
        "spout", path, np.stack([both, both], 1), 16, np.concatenate([tangent, tangent[-1:], tangent[back]])
    )


def coffee_pot() -> list[Part]:
    """Return the parts of the pot: bounding-box centre at the origin, farthest vertex at 1."""
    return normalise([_body(), _lid(), _neck_band(), _knob(), _handle(), _spout()])


def normalise(parts: list[Part]) -> list[Part]:
    """Move and scale all parts together."""
    points = np.concatenate([part.vertices for part in parts])
    center = (points.min(axis=0) + points.max(axis=0)) / 2
    scale = np.linalg.norm(points - center, axis=1).max()
    return [replace(part, vertices=(part.vertices - center) / scale) for part in parts]


def weld(vertices: np.ndarray, faces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Merge vertices that round to the same 1e-4, drop unused ones and faces that vanish; return both."""
    used, faces = np.unique(faces, return_inverse=True)
    rounded, index = np.unique(np.round(vertices[used], 4) + 0.0, axis=0, return_inverse=True)
    faces = index.reshape(-1)[faces.reshape(-1, 3)]
    a, b, c = faces.T
    return rounded, faces[(a != b) & (b != c) & (c != a)]


def visible_faces(
    vertices: np.ndarray,
    faces: np.ndarray,
    sees_sky: Callable[[np.ndarray, np.ndarray], np.ndarray],
    rng: np.random.Generator,
    rays: int = 96,
) -> np.ndarray:
    """Return which faces (F,) some ray leaves to the outside; sees_sky: of origins and directions (F, 3) each."""
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    normal = np.cross(b - a, c - a)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    seen = np.zeros(len(faces), bool)
    for _ in range(rays):
        s, t = np.sqrt(rng.random((len(faces), 1))), rng.random((len(faces), 1))
        direction = rng.normal(size=(len(faces), 3))
        direction = normal + direction / np.linalg.norm(direction, axis=1, keepdims=True)
        seen |= sees_sky((1 - s) * a + s * (1 - t) * b + s * t * c + 2e-4 * normal, direction)
    return seen
