"""What the vertices of a mesh see of the mesh: one depth map per direction, as for a sun standing there.

A vertex that lies behind the surface in a direction's depth map is blocked there, by the face in front of it.
"""

from dataclasses import dataclass

import torch
from torch import Tensor

from lightprobe.geometry.mesh import face_normals, is_closed, vertex_normals
from lightprobe.kernels import rasterize
from lightprobe.light import cubemap
from lightprobe.light.prefilter import BLOCKS
from lightprobe.render.openness import Surroundings

SIDE = 512  # pixels of a depth map
_BIAS = 1.5  # pixels a vertex is lifted from its surface: less, and faces shadow themselves
_FAR = 50.0  # radii; perspective-correct depth is as good as linear from here
_HORIZON = -0.2  # directions further below a vertex's horizon are blocked, whatever the depth map says


@torch.no_grad()
def surroundings(vertices: Tensor, faces: Tensor, colors: Tensor, side: int = SIDE) -> Surroundings:
    """Return what the vertices (V, 3) of a mesh (F, 3) with base colours (F, 3) see; `side`: pixels of a depth map.

    What nothing blocks gets the mean colour as that of its blockers, which matters to no one.
    """
    normals = vertex_normals(vertices, faces)
    maps = _DepthMaps.around(vertices, normals, side)
    # Of a closed surface, what is nearest to a sun is a face that looks at it.
    outward = face_normals(vertices, faces) if is_closed(vertices, faces) else None
    cosine = cubemap.directions(BLOCKS, vertices.device).reshape(-1, 3) @ normals.T
    weight = cosine.clamp(min=0) * cubemap.solid_angles(BLOCKS, vertices.device).reshape(-1, 1)
    table = torch.zeros(cosine.shape, dtype=torch.uint8, device=vertices.device)
    # A trace of the mean colour stands for blockers that are not there.
    total, reflected = torch.full_like(vertices[:, :1], 1e-6), 1e-6 * colors.mean(0).expand_as(vertices)
    for k, axes in enumerate(_frames(vertices.device)):
        drawn = None if outward is None else (outward @ axes[2] > 0).nonzero()[:, 0]
        lit, blocker = maps.look(faces, axes, drawn)
        lit = torch.where(cosine[k] > _HORIZON, lit, 0.0)
        table[k] = (255 * lit).round().to(torch.uint8)
        blocked = (weight[k] * (1 - lit) * (blocker >= 0))[:, None]
        total += blocked
        reflected = torch.addcmul(reflected, blocked, colors.index_select(0, blocker.clamp(min=0)))
    return Surroundings(table.T.contiguous(), reflected / total)


@dataclass(frozen=True)
class _DepthMaps:
    """Parallel views of an object from far away, and the points that ask them what they see."""

    points: Tensor  # (2 V, 3): the object's vertices, then the points that ask, which are these lifted
    scale: Tensor  # (3,) pixels per unit across and down, and the sign of depth
    middle: Tensor  # (3,) where the origin is
    pixel: float
    side: int

    @staticmethod
    def around(vertices: Tensor, normals: Tensor, side: int) -> "_DepthMaps":
        extent = 1.02 * float(vertices.norm(dim=1).max())
        pixel = 2 * extent / side
        points = torch.cat([vertices, vertices + _BIAS * pixel * normals])
        scale = points.new_tensor([1 / pixel, 1 / pixel, -1.0])
        middle = points.new_tensor([extent / pixel, extent / pixel, _FAR])
        return _DepthMaps(points, scale, middle, pixel, side)

    def look(self, faces: Tensor, axes: Tensor, drawn: Tensor | None = None) -> tuple[Tensor, Tensor]:
        """Return how much (V,) of the direction axes[2] each point has open, and the face before it (V,), -1 if none.

        Four pixels around the point are asked for the one, the nearest for the other. drawn (K,): the faces that can
        stand in the way, if not all.
        """
        screen, point = self._screen(axes).chunk(2)
        shown = faces if drawn is None else faces.index_select(0, drawn)
        visibility = rasterize(screen, shown, self.side, self.side)
        inverse = visibility.inverse_depth.reshape(-1)
        place = (point[:, :2] - 0.5).clamp(0, self.side - 1.001)
        low = place.floor()
        (fx, fy), first = (place - low).unbind(1), (low[:, 1] * self.side + low[:, 0]).long()
        limit = 1 / (point[:, 2] - _BIAS * self.pixel)  # what is nearer has more inverse depth, and nothing has none
        sides = ((0, 1 - fy, 1 - fx), (1, 1 - fy, fx), (self.side, fy, 1 - fx), (self.side + 1, fy, fx))
        lit = torch.zeros_like(fx)
        for step, down, across in sides:
            lit += down * across * (inverse.index_select(0, first + step) < limit)
        nearest = first + (fx > 0.5).long() + self.side * (fy > 0.5).long()
        face = visibility.face.reshape(-1).index_select(0, nearest).long()
        if drawn is not None and len(drawn) > 0:
            face = torch.where(face >= 0, drawn.index_select(0, face.clamp(min=0)), face)
        return lit, face

    def _screen(self, axes: Tensor) -> Tensor:
        """Return all points as the rasteriser takes them, seen in parallel from far along the third of `axes`."""
        return torch.addmm(self.middle, self.points, (self.scale[:, None] * axes).T)


def _frames(device: torch.device) -> Tensor:
    """Return orthonormal axes (384, 3, 3) whose third row is the direction."""
    third = cubemap.directions(BLOCKS, device).reshape(-1, 3)
    helper = torch.where(third[:, :1].abs() < 0.6, third.new_tensor([1.0, 0, 0]), third.new_tensor([0.0, 1, 0]))
    first = torch.nn.functional.normalize(torch.linalg.cross(third, helper), dim=1)
    return torch.stack([first, torch.linalg.cross(third, first), third], 1)
