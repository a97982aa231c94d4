"""The finished picture of an asset: several samples a pixel, and sharp shadows of suns.

Phase I and the predictors look at one point of the surface per pixel. That is fast, and a picture would show it: a thin
bar, a crease or the weave of a cloth breaks into steps, and a comparison with a photo would score the steps. Here the
samples of a pixel are averaged as a camera's pixel averages its square, and the light is known, so that its suns are.
"""

from dataclasses import dataclass

import torch
from torch import Tensor
from torch.nn import functional

from lightprobe.geometry.mesh import Mesh, edge_faces
from lightprobe.light.prefilter import Prefilter
from lightprobe.render.asset import Asset, rasterize_asset
from lightprobe.render.gbuffer import GBuffer
from lightprobe.render.silhouette import Crossings, coverage, outline_vertices, silhouette_crossings, spread_color
from lightprobe.render.split_sum import Shading
from lightprobe.render.suns import Suns, sharpened
from lightprobe.render.surface import View
from lightprobe.scene.camera import Camera

SAMPLES = 2  # along each edge of a pixel


@dataclass(frozen=True)
class Picture:
    """One view of an asset, ready for any light: what is found here depends on none."""

    mesh: Mesh
    prefilter: Prefilter
    gbuffer: GBuffer  # of all samples
    shading: Shading
    crossings: Crossings
    cover: Tensor  # (N,) coverage of all samples

    @staticmethod
    @torch.no_grad()
    def of(asset: Asset, camera: Camera, prefilter: Prefilter, device: torch.device) -> "Picture":
        """Return the view that a normalised-frame camera takes; asset and prefilter are on `device`."""
        camera = camera.resized(SAMPLES * camera.width, SAMPLES * camera.height)
        gbuffer, view = rasterize_asset(asset, camera, device), View.of(camera, device)
        screen, faces = view.project(asset.mesh.vertices), asset.mesh.faces
        edges = edge_faces(faces, outline_vertices(screen, faces))
        crossings = silhouette_crossings(screen, faces, edges, gbuffer.pixel, view)
        cover = coverage(gbuffer.pixel, crossings, view.height * view.width)
        return Picture(asset.mesh, prefilter, gbuffer, Shading.of(gbuffer, prefilter), crossings, cover)

    @torch.no_grad()
    def render(self, env: Tensor) -> tuple[Tensor, Tensor]:
        """Return the linear premultiplied image (H, W, 3) and coverage (H, W) under `env` (6, R, R, 3)."""
        radiance = self.shading.apply(self.prefilter.apply(env))
        suns = Suns.of(env)
        if self.gbuffer.openness is not None and len(suns.block) > 0:
            _, diffuse, _ = self.shading.factors
            radiance = (radiance + diffuse * sharpened(self.gbuffer, self.mesh, suns)).clamp(min=0)
        image = spread_color(radiance, self.gbuffer.pixel, self.crossings, self.cover)
        samples = torch.cat([image, self.cover[:, None]], 1).T.reshape(1, 4, self.gbuffer.height, self.gbuffer.width)
        pixels = functional.avg_pool2d(samples, SAMPLES)[0].permute(1, 2, 0)
        return pixels[..., :3], pixels[..., 3]
