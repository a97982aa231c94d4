"""Painted parts, and the textured mesh of many of them, whose atlas is evaluated at the points of the surface."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from scipy.ndimage import map_coordinates

from demo_scene.textures import Material, Model

from .shapes import Shape, grid_coordinates, group_mesh

Painter = Callable[
    [np.ndarray], Material
]  # points (..., 3) of a part, before it is placed, to material (...)
_MARGIN = 2  # texels around each tile that carry its pattern on, for the bilinear look-up at seams


@dataclass(frozen=True)
class Part:
    """A shape of one material, placed by a similarity (4, 4)."""

    shape: Shape
    paint: Painter
    pose: np.ndarray

    def moved(self, pose: np.ndarray) -> "Part":
        """Return the part where `pose` (4, 4) takes it."""
        return replace(self, pose=pose @ self.pose)


def pose_of(
    at: tuple[float, ...] = (0, 0, 0),
    turn: float = 0.0,
    axis: tuple[float, ...] = (0, 0, 1),
    scale: float = 1.0,
) -> np.ndarray:
    """Return the similarity (4, 4) that scales, turns by an angle in radians about an axis, and moves."""
    x, y, z = np.array(axis, float) / np.linalg.norm(axis)
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    pose = np.eye(4)
    pose[:3, :3] = scale * (np.eye(3) + np.sin(turn) * cross + (1 - np.cos(turn)) * cross @ cross)
    pose[:3, 3] = at
    return pose


def corners(parts: list[Part]) -> np.ndarray:
    """Return all points (N, 3) of the parts' grids where they are placed."""
    return np.concatenate(
        [
            g.reshape(-1, 3) @ p.pose[:3, :3].T + p.pose[:3, 3]
            for p in parts
            for group in p.shape
            for g in group
        ]
    )


def normalised(parts: list[Part]) -> list[Part]:
    """Move and scale all parts together: the bounding box's centre to the origin, the farthest point to radius 1."""
    points = corners(parts)
    center = (points.min(axis=0) + points.max(axis=0)) / 2
    scale = 1 / np.linalg.norm(points - center, axis=1).max()
    return [part.moved(pose_of(tuple(-scale * center), scale=scale)) for part in parts]


def textured(parts: list[Part], side: int) -> Model:
    """Return the parts as one mesh with an atlas of equal tiles, one for each grid."""
    grids = sum(len(group) for part in parts for group in part.shape)
    across = int(np.ceil(np.sqrt(grids)))
    tile = side // across
    base, roughness, metallic = np.zeros((side, side, 3)), np.ones((side, side)), np.zeros((side, side))
    vertices, normals, uvs, faces, offset, slot = [], [], [], [], 0, 0
    for part in parts:
        linear = part.pose[:3, :3] / np.cbrt(np.linalg.det(part.pose[:3, :3]))
        for group in part.shape:
            points, normal, triangles = group_mesh(group)
            vertices.append(points @ part.pose[:3, :3].T + part.pose[:3, 3])
            normals.append(normal @ linear.T)
            faces.append(triangles + offset)
            offset += len(points)
            for grid in group:
                row, column = divmod(slot, across)
                place = np.s_[row * tile : (row + 1) * tile, column * tile : (column + 1) * tile]
                painted = part.paint(_texel_points(grid, tile))
                base[place], roughness[place], metallic[place] = (
                    painted.base,
                    painted.roughness,
                    painted.metallic,
                )
                u, v = (_MARGIN + x * (tile - 2 * _MARGIN) for x in grid_coordinates(grid))
                corner = np.stack(np.broadcast_arrays(u + column * tile, v[:, None] + row * tile), axis=-1)
                uvs.append(corner.reshape(-1, 2) / side)
                slot += 1
    material = Material(np.clip(base, 0, 1), np.clip(roughness, 0.05, 1), np.clip(metallic, 0, 1))
    v, n, uv, f = (np.concatenate(arrays) for arrays in (vertices, normals, uvs, faces))
    return Model(v, n, uv, f, material)


def _texel_points(grid: np.ndarray, tile: int) -> np.ndarray:
    """Return the points (tile, tile, 3) of a grid at the texels of its tile."""
    t = np.clip((np.arange(tile) + 0.5 - _MARGIN) / (tile - 2 * _MARGIN), 0, 1)
    column, row = (np.interp(t, x, np.arange(len(x))) for x in grid_coordinates(grid))
    at = np.broadcast_arrays(row[:, None], column[None])
    return np.stack([map_coordinates(grid[..., k], at, order=1) for k in range(3)], axis=-1)
