"""The object as poses are tried on it: its asset, with all that does not depend on the view found beforehand."""

import torch
from torch import Tensor

from lightprobe.geometry.mesh import uv_tangents
from lightprobe.geometry.textures import sample
from lightprobe.light.prefilter import BLOCKS
from lightprobe.render.asset import Asset, gbuffer_of, shading_normals
from lightprobe.render.coarse_transport import CoarseTransport
from lightprobe.render.surface import Surface, View
from lightprobe.render.visibility import PointVisibility

LIGHT_SIDE = 4  # texels along a cubemap edge of the lights that photos are explained by


class KnownObject:
    """An asset with its normals, tangents and textures ready for many small renders; no autograd."""

    def __init__(self, asset: Asset):
        """Take an asset in the normalised frame, on its device."""
        self.asset, self.mesh = asset, asset.mesh
        self._normals, self._tangents, self._flat = (
            asset.mesh.normals(),
            uv_tangents(asset.mesh),
            asset.textures.flat(),
        )

    @torch.no_grad()
    def transport(self, surface: Surface, view: View) -> Tensor:
        """Return the matrices (3, P, 96) from each channel of a light of 6 x 4 x 4 texels to visible points."""
        mesh, visibility = self.mesh, self.asset.visibility
        material = sample(self._flat, surface.interpolate(mesh.uvs, mesh.uv_faces))
        normal = shading_normals(surface, mesh, self._normals, self._tangents, material[:, 5:])
        points = None
        if visibility is not None:
            points = PointVisibility.of(visibility, mesh.faces, surface.face, surface.barycentric)
        matrix = CoarseTransport.of(gbuffer_of(surface, view, normal, material, points)).matrix
        block = BLOCKS // LIGHT_SIDE
        texels = matrix.reshape(-1, 1, BLOCKS, BLOCKS)
        pooled = torch.nn.functional.avg_pool2d(texels, block) * block**2
        return pooled.reshape(3, -1, 6 * LIGHT_SIDE**2)
