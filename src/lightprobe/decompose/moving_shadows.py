"""Openness for a surface whose triangles change from step to step: looked up at the nearest point it was found for."""

from dataclasses import dataclass

import scipy
import torch
from torch import Tensor

from lightprobe.geometry.mesh import vertex_normals
from lightprobe.render.openness import Openness, Surroundings
from lightprobe.render.surface import Surface
from lightprobe.render.surroundings import surroundings

_SIDE = 256  # pixels of a depth map: the surface will have moved on by the next step
_TURN = 0.1  # a turned normal is as far away as this share of the object's radius: thin parts keep their sides apart


@dataclass(frozen=True)
class MovingShadows:
    """What a past state of the surface saw around it."""

    tree: "scipy.spatial.cKDTree"  # of points (V, 6): position and scaled normal
    around: Surroundings

    @staticmethod
    def of(vertices: Tensor, faces: Tensor, colors: Tensor) -> "MovingShadows":
        """Return what the mesh (V, 3), (F, 3) with base colours (V, 3) sees."""
        around = surroundings(vertices, faces, colors[faces.long()].mean(1), _SIDE)
        return MovingShadows(scipy.spatial.cKDTree(_points(vertices, faces)), around)

    def brightened(self, factor: float) -> "MovingShadows":
        """Return them with base colours times `factor`."""
        return MovingShadows(self.tree, self.around.brightened(factor))

    def at(self, vertices: Tensor, faces: Tensor, surface: Surface) -> Openness:
        """Return the openness at the visible points of the mesh as it is now."""
        corners = faces[surface.face].long()
        seen = torch.zeros(len(vertices), dtype=torch.bool, device=vertices.device)
        seen[corners.reshape(-1)] = True
        points = _points(vertices, faces)[seen.cpu().numpy()]
        row = torch.empty(len(vertices), dtype=torch.long, device=vertices.device)
        found = self.tree.query(points, workers=torch.get_num_threads())[1]
        row[seen] = torch.from_numpy(found).to(vertices.device)
        return Openness(self.around, row[corners], surface.barycentric.detach())


@torch.no_grad()
def _points(vertices: Tensor, faces: Tensor):
    return torch.cat([vertices, _TURN * vertex_normals(vertices, faces)], 1).cpu().numpy()
