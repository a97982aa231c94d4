"""Visibility from points past a mesh, usually their own: one depth map for each direction."""

import torch
from torch import Tensor

from lightprobe.geometry.mesh import vertex_normals
from lightprobe.light import cubemap
from lightprobe.light.prefilter import BLOCKS
from lightprobe.render.depth_maps import DepthMaps, frames
from lightprobe.render.visibility import VertexVisibility

SIDE = 512  # pixels of a depth map
_HORIZON = -0.2  # directions further below a vertex's horizon are blocked, whatever the depth map says


def vertex_visibility(vertices: Tensor, faces: Tensor, colors: Tensor, side: int = SIDE) -> VertexVisibility:
    """Return what the vertices (V, 3) of a mesh with base colours (F, 3) see; `side`: pixels of a depth map.

    What nothing blocks gets the mean colour as that of its blockers, which matters to no one.
    """
    return point_visibility(vertices, faces, colors, vertices, vertex_normals(vertices, faces), side)


@torch.no_grad()
def point_visibility(
    vertices: Tensor,
    faces: Tensor,
    colors: Tensor,
    points: Tensor,
    normals: Tensor,
    side: int = SIDE,
    *,
    asked: Tensor | None = None,
) -> VertexVisibility:
    """Return what surface points (P, 3) with unit normals (P, 3) see past a mesh, their own or another.

    vertices (V, 3), about the origin, faces (F, 3) and base colours (F, 3): the mesh; `side` as there.
    asked (384,) bool: directions in which it can be in the way, by default all.
    """
    maps = DepthMaps.of(vertices, faces, points, normals, side)
    directions = cubemap.directions(BLOCKS, vertices.device).reshape(-1, 3)
    cosine = directions @ normals.T
    weight = cosine.clamp(min=0) * cubemap.solid_angles(BLOCKS, vertices.device).reshape(-1, 1)
    table = torch.zeros(cosine.shape, dtype=torch.uint8, device=vertices.device)
    # A trace of the mean colour stands for blockers that are not there.
    total, reflected = torch.full_like(points[:, :1], 1e-6), 1e-6 * colors.mean(0).expand_as(points)
    for k, axes in enumerate(frames(directions)):
        if asked is not None and not asked[k]:
            table[k] = 255 * (cosine[k] > _HORIZON)
            continue
        lit, blocker = maps.visibility(axes)
        lit = torch.where(cosine[k] > _HORIZON, lit, 0.0)
        table[k] = (255 * lit).round().to(torch.uint8)
        blocked = (weight[k] * (1 - lit) * (blocker >= 0))[:, None]
        total += blocked
        reflected = torch.addcmul(reflected, blocked, colors.index_select(0, blocker.clamp(min=0)))
    return VertexVisibility(table.T.contiguous(), reflected / total)
