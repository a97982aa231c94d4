"""Visibility on a surface whose triangles change at each step: that of a past state's nearest point."""

from dataclasses import dataclass

import scipy
import torch
from torch import Tensor

from lightprobe.geometry.mesh import vertex_normals
from lightprobe.render.surface import Surface
from lightprobe.render.visibility import PointVisibility, VertexVisibility, vertex_visibility

_TURN = 0.1  # object radii that a turned normal is away: thin parts keep their sides apart
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
        # A GPU would wait for the points, the tree and the rows it found.
        tree = scipy.spatial.cKDTree(points.numpy()) if points.device.type == "cpu" else None
        return MovingVisibility(points, tree, visible)

    def brightened(self, factor: float) -> "MovingVisibility":
        """Return the visibility of the same surface with base colours times `factor`."""
        return MovingVisibility(self.points, self.tree, self.vertices.brightened(factor))

    def at(self, vertices: Tensor, faces: Tensor, surface: Surface) -> PointVisibility:
        """Return the visibility at the visible points of the present mesh, vertices (V, 3) and faces (F, 3)."""
        corners = faces[surface.face].long()
        seen = torch.zeros(len(vertices), dtype=torch.bool, device=vertices.device)
        seen[corners.reshape(-1)] = True
        row = torch.empty(len(vertices), dtype=torch.long, device=vertices.device)
        points = _points(vertices, faces)[seen]
        if self.tree is None:
            row[seen] = nearest_rows(points, self.points)
        else:
            found = self.tree.query(points.numpy(), workers=torch.get_num_threads())[1]
            row[seen] = torch.from_numpy(found)
        return PointVisibility(self.vertices, row[corners], surface.barycentric.detach())


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


@torch.no_grad()
def _points(vertices: Tensor, faces: Tensor) -> Tensor:
    return torch.cat([vertices, _TURN * vertex_normals(vertices, faces)], 1)
