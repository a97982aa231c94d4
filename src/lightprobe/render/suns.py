"""Sharp shadows of what is small and bright in a known light.

`render.visibility` knows the object's own shadows per vertex and in directions of eleven degrees, which suits an
unknown light. Under a known sun a shadow would lie where the middle of the sun's block throws it, and blur from
vertex to vertex. So light that stands out of its block is taken for a sun, and every pixel is looked up in a depth
map made from the sun's direction.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from lightprobe.geometry.mesh import Mesh, face_normals
from lightprobe.kernels import gather_rows
from lightprobe.light import cubemap
from lightprobe.light.prefilter import BLOCKS
from lightprobe.render.depth_maps import DepthMaps, frames
from lightprobe.render.gbuffer import GBuffer

SIDE = 1024  # pixels of a sun's depth map
_MOST = 8  # suns
_LEAST = 0.005  # of the light's whole flux
_OUTSTANDING = 3.0  # times the median of its block
_SMALLEST = 2 * BLOCKS  # resolution from which a block has texels to stand out


@dataclass(frozen=True)
class Suns:
    """The K suns of a light, the strongest first."""

    direction: Tensor  # (K, 3) unit
    flux: Tensor  # (K, 3) radiance times solid angle
    block: Tensor  # (K,) int64, where in the 6 x 8 x 8 blocks

    @staticmethod
    def of(env: Tensor) -> "Suns":
        """Return the suns of a light (6, R, R, 3)."""
        resolution = env.shape[1]
        if resolution < _SMALLEST:
            none = env.new_zeros(0, 3)
            return Suns(none, none, torch.zeros(0, dtype=torch.long, device=env.device))
        light, direction = (_by_block(t) for t in (env, cubemap.directions(resolution, env.device)))
        angle = _by_block(cubemap.solid_angles(resolution, env.device)[..., None])
        brightness = light.mean(-1, keepdim=True)
        usual = _OUTSTANDING * brightness.median(1, keepdim=True).values
        flux = (light * (1 - usual / brightness.clamp(min=1e-12)).clamp(min=0)) * angle
        strength = flux.sum((1, 2))
        order = torch.argsort(strength, descending=True, stable=True)[:_MOST]
        block = order[strength[order] > _LEAST * (light * angle).sum()]
        middle = (flux[block].sum(-1, keepdim=True) * direction[block]).sum(1)
        return Suns(torch.nn.functional.normalize(middle, dim=1), flux[block].sum(1), block)


def _by_block(texels: Tensor) -> Tensor:
    """Return a cubemap (6, R, R, C) as the texels of each block, (384, (R / 8)^2, C)."""
    share = texels.shape[1] // BLOCKS
    parts = texels.reshape(6, BLOCKS, share, BLOCKS, share, -1).permute(0, 1, 3, 2, 4, 5)
    return parts.reshape(6 * BLOCKS**2, share * share, -1)


@torch.no_grad()
def sharpened(
    gbuffer: GBuffer, mesh: Mesh, suns: Suns, others: Sequence[tuple[Tensor, Tensor]] = ()
) -> Tensor:
    """Return by how much sharp shadows of suns change the diffuse light (P, 3) of `PointVisibility.light`.

    others: vertices (V, 3), faces (F, 3) of further meshes that cast shadows; the G-buffer's visibility has them.
    """
    if gbuffer.visibility is None:
        raise ValueError("The G-buffer has no visibility.")
    blocks = suns.flux.new_zeros(6 * BLOCKS**2, 3)
    angle = cubemap.solid_angles(BLOCKS, suns.flux.device).reshape(-1, 1)
    blocks[suns.block] = suns.flux / angle[suns.block]
    change = -gbuffer.visibility.light(blocks, gbuffer.normal)[:, :3]
    outward = torch.nn.functional.normalize(face_normals(mesh.vertices, mesh.faces), dim=1, eps=1e-20)
    lifted = gather_rows(outward, gbuffer.face)
    maps = [DepthMaps.of(mesh.vertices, mesh.faces, gbuffer.position, lifted, SIDE)]
    for vertices, faces in others:
        middle = (vertices.amin(0) + vertices.amax(0)) / 2
        maps.append(DepthMaps.of(vertices - middle, faces, gbuffer.position - middle, lifted, SIDE))
    for direction, flux, axes in zip(suns.direction, suns.flux, frames(suns.direction), strict=True):
        lit = torch.stack([each.visibility(axes)[0] for each in maps]).prod(0)
        change += (lit * (gbuffer.normal @ direction).clamp(min=0))[:, None] * (flux / torch.pi)
    return change
