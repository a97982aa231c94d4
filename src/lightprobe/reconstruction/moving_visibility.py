"""Visibility on a surface whose triangles change from step to step: that of the nearest point it was found
for.
"""

from dataclasses import dataclass

import scipy
import torch
from torch import Tensor

from lightprobe.geometry.mesh import vertex_normals
from lightprobe.render.surface import Surface
from lightprobe.render.visibility import PointVisibility, VertexVisibility, vertex_visibility

_TURN = 0.1  # a turned normal is as far away as this share of the object's radius: thin parts keep their sides apart
_PAIRS = 1 << 25  # distances of a GPU's comparison that are held at a time


@dataclass(frozen=True)
class MovingVisibility:
    """What a past state of the surface saw of itself."""

    points: Tensor  # (V, 6): position and scaled normal
    tree: "scipy.spatial.cKDTree | None"  # of these points; None on a GPU, which compares with all of them
    vertices: VertexVisibility

    @staticmethod
    def of(vertices: Tensor, faces: Tensor, colors: Tensor, side: int) -> "MovingVisibility":
        """Return what the mesh (V, 3), (F, 3) with base colours (V, 3) sees; `side`: pixels of a depth map."""
        visible = vertex_visibility(vertices, faces, colors[faces.long()].mean(1), side)
        points = _points(vertices, faces)
        return MovingVisibility(
            points, scipy.spatial.cKDTree(points.numpy()) if _searches(points) else None, visible
        )

    def brightened(self, factor: float) -> "MovingVisibility":
        """Return them with base colours times `factor`."""
        return MovingVisibility(self.points, self.tree, self.vertices.brightened(factor))

    def at(self, vertices: Tensor, faces: Tensor, surface: Surface) -> PointVisibility:
        """Return the visibility at the visible points of the mesh as it is now, vertices (V, 3) and faces (F,
        3).
        """
        corners = faces[surface.face].long()
        seen = torch.zeros(len(vertices), dtype=torch.bool, device=vertices.device)
        seen[corners.reshape(-1)] = True
        row = torch.empty(len(vertices), dtype=torch.long, device=vertices.device)
        row[seen] = self._nearest(_points(vertices, faces)[seen])
        return PointVisibility(self.vertices, row[corners], surface.barycentric.detach())

    def _nearest(self, points: Tensor) -> Tensor:
        """Return the row (K,) int64 of the stored point that is nearest to each of the points (K, 6)."""
        if self.tree is None:
            return nearest_rows(points, self.points)
        return torch.from_numpy(self.tree.query(points.numpy(), workers=torch.get_num_threads())[1])


@torch.no_grad()
def nearest_rows(points: Tensor, stored: Tensor) -> Tensor:
    """Return the row (K,) int64 of `stored` (V, D) that is nearest to each of `points` (K, D), by all
    distances.

    Of points about as near as each other, within float32's rounding of a squared distance, it may be any.
    """
    square = stored.square().sum(1)
    some = max(1, _PAIRS // max(len(stored), 1))
    # |p - s|^2 less what is the same for every s
    nearest = [torch.addmm(square, part, stored.T, alpha=-2).argmin(1) for part in points.split(some)]
    return torch.cat(nearest)


def _searches(points: Tensor) -> bool:
    """Return whether a tree is quicker: on a CPU; a GPU would wait for the points, the tree and the rows it
    found.
    """
    return points.device.type == "cpu"


@torch.no_grad()
def _points(vertices: Tensor, faces: Tensor) -> Tensor:
    return torch.cat([vertices, _TURN * vertex_normals(vertices, faces)], 1)
