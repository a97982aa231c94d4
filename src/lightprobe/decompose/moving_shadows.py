"""Openness for a surface whose triangles change from step to step: looked up at the nearest point it was found for."""

from dataclasses import dataclass

import torch
from scipy.spatial import cKDTree
from torch import Tensor

from lightprobe.geometry.mesh import vertex_normals
from lightprobe.render.openness import Openness, blend, openness_table
from lightprobe.render.surface import Surface

_TURN = 0.1  # a turned normal is as far away as this share of the object's radius: thin parts keep their sides apart


@dataclass(frozen=True)
class MovingShadows:
    """The openness of a past state of the surface."""

    tree: cKDTree  # of points (V, 6): position and scaled normal
    table: Tensor  # (V, 384) uint8

    @staticmethod
    def of(vertices: Tensor, faces: Tensor) -> "MovingShadows":
        """Return the openness of the mesh (V, 3), (F, 3)."""
        return MovingShadows(cKDTree(_points(vertices, faces)), openness_table(vertices, faces))

    def at(self, vertices: Tensor, faces: Tensor, surface: Surface) -> Openness:
        """Return the openness at the visible points of the mesh as it is now."""
        near = blend(self.table, faces, surface.face, surface.barycentric)
        corners = near.index.long()
        seen = torch.zeros(len(vertices), dtype=torch.bool, device=vertices.device)
        seen[corners.reshape(-1)] = True
        points = _points(vertices, faces)[seen.cpu().numpy()]
        row = torch.empty(len(vertices), dtype=torch.long, device=vertices.device)
        found = self.tree.query(points, workers=torch.get_num_threads())[1]
        row[seen] = torch.from_numpy(found).to(vertices.device)
        return Openness(self.table, row[corners], near.weight)


@torch.no_grad()
def _points(vertices: Tensor, faces: Tensor):
    return torch.cat([vertices, _TURN * vertex_normals(vertices, faces)], 1).cpu().numpy()
