"""Depth maps of a mesh from directions all around, and which points they show to be blocked.

A point that lies behind the surface in a direction's depth map is blocked there, by the face in front of it.
"""

from dataclasses import dataclass

import torch
from torch import Tensor

from lightprobe.geometry.mesh import face_normals, is_closed
from lightprobe.kernels import rasterize

_BIAS = 1.5  # pixels a point is lifted from its surface: less, and faces shadow themselves
_FAR = 50.0  # radii; perspective-correct depth is as good as linear from here


@dataclass(frozen=True)
class DepthMaps:
    """Parallel views of a mesh from far away, and the points that ask them what they see."""

    faces: Tensor  # (F, 3) integer
    outward: Tensor | None  # (F, 3) outward normals of a closed mesh
    corners: Tensor  # (V + P, 3): the mesh's vertices, then the lifted points that ask
    vertices: int  # V
    scale: Tensor  # (3,) pixels per unit across and down, and the sign of depth
    middle: Tensor  # (3,) where the origin is
    pixel: float
    side: int

    @staticmethod
    def of(vertices: Tensor, faces: Tensor, points: Tensor, normals: Tensor, side: int) -> "DepthMaps":
        """Return `side` x `side` maps of a mesh (V, 3), (F, 3) for surface points and normals (P, 3)."""
        extent = 1.02 * float(vertices.norm(dim=1).max())
        pixel = 2 * extent / side
        corners = torch.cat([vertices, points + _BIAS * pixel * normals])
        scale = corners.new_tensor([1 / pixel, 1 / pixel, -1.0])
        middle = corners.new_tensor([extent / pixel, extent / pixel, _FAR])
        outward = face_normals(vertices, faces) if is_closed(vertices, faces) else None
        return DepthMaps(faces, outward, corners, len(vertices), scale, middle, pixel, side)

    def visibility(self, axes: Tensor) -> tuple[Tensor, Tensor]:
        """Return how open (P,) direction axes[2] is at each point, and the face before it (P,), -1 if none.

        Openness is bilinear over the four pixels around the point; the face is the nearest pixel's. axes: (3, 3)
        orthonormal rows.
        """
        corners = torch.addmm(self.middle, self.corners, (self.scale[:, None] * axes).T)
        # Of a closed surface, what is nearest to a sun is a face that looks at it.
        drawn = None if self.outward is None else (self.outward @ axes[2] > 0).nonzero()[:, 0]
        faces = self.faces if drawn is None else self.faces.index_select(0, drawn)
        visibility = rasterize(corners[: self.vertices], faces, self.side, self.side)
        point = corners[self.vertices :]
        inverse = visibility.inverse_depth.reshape(-1)
        place = (point[:, :2] - 0.5).clamp(0, self.side - 1.001)
        low = place.floor()
        (fx, fy), first = (place - low).unbind(1), (low[:, 1] * self.side + low[:, 0]).long()
        # What is nearer has more inverse depth, and the background has none.
        limit = 1 / (point[:, 2] - _BIAS * self.pixel)
        sides = ((0, 1 - fy, 1 - fx), (1, 1 - fy, fx), (self.side, fy, 1 - fx), (self.side + 1, fy, fx))
        lit = torch.zeros_like(fx)
        for step, down, across in sides:
            lit += down * across * (inverse.index_select(0, first + step) < limit)
        nearest = first + (fx > 0.5).long() + self.side * (fy > 0.5).long()
        face = visibility.face.reshape(-1).index_select(0, nearest).long()
        if drawn is not None and len(drawn) > 0:
            face = torch.where(face >= 0, drawn.index_select(0, face.clamp(min=0)), face)
        return lit, face


def frames(directions: Tensor) -> Tensor:
    """Return orthonormal axes (K, 3, 3) whose third row is the unit direction (K, 3)."""
    x, y = directions.new_tensor([[1.0, 0, 0], [0.0, 1, 0]])
    across = torch.where(directions[:, :1].abs() < 0.6, x, y)
    first = torch.nn.functional.normalize(torch.linalg.cross(directions, across), dim=1)
    return torch.stack([first, torch.linalg.cross(directions, first), directions], 1)
