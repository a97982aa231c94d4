"""The object as poses are tried on it: its asset, with all that does not depend on the view made before."""

import numpy as np
import torch
from torch import Tensor

from lightprobe.geometry.mesh import uv_tangents
from lightprobe.geometry.textures import sample
from lightprobe.imaging import resize_area
from lightprobe.kernels import rasterize
from lightprobe.render.asset import Asset, gbuffer_of, shading_normals
from lightprobe.render.coarse_transport import CoarseTransport
from lightprobe.render.surface import Surface, View
from lightprobe.render.visibility import PointVisibility
from lightprobe.scene.camera import Camera

LIGHT_SIDE = 4  # texels along a cubemap edge of the lights that photos are explained by
_SAMPLES = 3  # of a silhouette along a pixel's edge, in small photos
_POINTS = 400  # of the mesh, that poses are compared by
_SIDE = 3000  # samples along the photo's longer side, at most, unless the photo has more pixels


class KnownObject:
    """An asset with its normals, tangents and textures ready for many small renders; no autograd."""

    def __init__(self, asset: Asset):
        """Take an asset in the normalised frame, on its device."""
        self.asset, self.mesh = asset, asset.mesh
        self._normals, self._tangents = asset.mesh.normals(), uv_tangents(asset.mesh)
        self._flat = asset.textures.flat()
        vertices = asset.mesh.vertices.cpu().double().numpy()
        self.points = vertices[:: max(1, len(vertices) // _POINTS)]  # (N, 3), that poses are compared by

    @torch.no_grad()
    def transport(self, surface: Surface, view: View) -> Tensor:
        """Return the matrices (3, P, 96) from channels of a light of 6 x 4 x 4 texels to visible points."""
        mesh, visibility = self.mesh, self.asset.visibility
        material = sample(self._flat, surface.interpolate(mesh.uvs, mesh.uv_faces))
        normal = shading_normals(surface, mesh, self._normals, self._tangents, material[:, 5:])
        points = None
        if visibility is not None:
            points = PointVisibility.of(visibility, mesh.faces, surface.face, surface.barycentric)
        return CoarseTransport.of(gbuffer_of(surface, view, normal, material, points), LIGHT_SIDE).matrix

    def silhouette(self, camera: Camera) -> np.ndarray:
        """Return the coverage (H, W) float32 in [0, 1] of the object seen by a normalised-frame camera."""
        samples = max(1, min(_SAMPLES, _SIDE // max(camera.width, camera.height)))
        fine = camera.resized(camera.width * samples, camera.height * samples)
        screen = View.of(fine, self.mesh.vertices.device).project(self.mesh.vertices)
        face = rasterize(screen, self.mesh.faces, fine.height, fine.width).face
        covered = (face >= 0).to(torch.uint8).cpu().numpy()
        if samples == 1:
            return covered.astype(np.float32)
        return resize_area(covered, camera.height, camera.width)

    def inside_share(self, camera: Camera) -> float:
        """Return the share of the vertices, hidden or not, that project into the camera's picture, 0 to 1."""
        place = camera.project(self.mesh.vertices.double().cpu().numpy())
        inside = (place[:, 2] > 0) & (place[:, 0] >= 0) & (place[:, 0] <= camera.width)
        return float((inside & (place[:, 1] >= 0) & (place[:, 1] <= camera.height)).mean())
