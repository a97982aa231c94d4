"""The finished picture of an asset: several samples a pixel, and sharp shadows of suns.

Phase I and the predictors sample the surface once per pixel, so that a thin bar, a crease or the weave of a cloth
breaks into steps, which a comparison with a photo would score. Here the samples of a pixel are averaged as a
camera's pixel averages its square, and suns of the known light cast sharp shadows.

A sample of the object takes some hundreds of bytes until it is a colour. Pictures of more than a million
pixels are therefore made in bands of rows, one after the other, each anew for every call.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import torch
from torch import Tensor
from torch.nn import functional

from lightprobe.geometry.mesh import Mesh, edge_faces
from lightprobe.light.prefilter import Prefilter
from lightprobe.render import silhouette
from lightprobe.render.asset import Asset, rasterize_asset
from lightprobe.render.gbuffer import GBuffer
from lightprobe.render.split_sum import Shading
from lightprobe.render.suns import Suns, sharpened
from lightprobe.render.surface import View
from lightprobe.scene.camera import Camera

SAMPLES = 2  # along each edge of a pixel
_WHOLE = 2**22  # samples up to which a picture is made as a whole, and what depends on no light is kept
_BAND = 2**20  # samples in a band of a larger one
_RIM = 1  # rows of pixels around a band, for outlines between it and its neighbours


@dataclass(frozen=True)
class Picture:
    """One view of an asset, ready for any light."""

    asset: Asset
    camera: Camera  # normalised frame
    prefilter: Prefilter
    device: torch.device
    whole: "_Band | None"  # None: too large to be kept

    @staticmethod
    def of(asset: Asset, camera: Camera, prefilter: Prefilter, device: torch.device) -> "Picture":
        """Return the view that a normalised-frame camera takes; asset and prefilter are on `device`."""
        fits = SAMPLES**2 * camera.width * camera.height <= _WHOLE
        whole = _Band.of(asset, camera, prefilter, device) if fits else None
        return Picture(asset, camera, prefilter, device, whole)

    def render(self, env: Tensor) -> tuple[Tensor, Tensor]:
        """Return the linear premultiplied image (H, W, 3) and coverage (H, W) under `env` (6, R, R, 3)."""
        bands = [images[0] for _, images in self.bands([env])]
        images, covers = zip(*bands, strict=True)
        return torch.cat(images), torch.cat(covers)

    def bands(self, lights: Sequence[Tensor]) -> Iterator[tuple[slice, list[tuple[Tensor, Tensor]]]]:
        """Yield rows (h) of the picture from the top, with image (h, W, 3) and coverage (h, W) per light.

        Together the rows are what `render` returns; no whole picture is held in memory.
        """
        if self.whole is not None:
            yield slice(0, self.camera.height), [self.whole.render(env) for env in lights]
            return
        for rows, camera, inner in row_bands(self.camera):
            band = _Band.of(self.asset, camera, self.prefilter, self.device)
            yield rows, [(image[inner], cover[inner]) for image, cover in map(band.render, lights)]


def row_bands(camera: Camera) -> Iterator[tuple[slice, Camera, slice]]:
    """Yield bands of rows of a large picture from the top, their cameras, which see a rim, too, and the rows within."""
    step = max(1, _BAND // (SAMPLES**2 * camera.width))
    for top in range(0, camera.height, step):
        bottom = min(top + step, camera.height)
        first, last = max(0, top - _RIM), min(camera.height, bottom + _RIM)
        band = replace(camera, cy=camera.cy - first, height=last - first)
        yield slice(top, bottom), band, slice(top - first, bottom - first)


@dataclass(frozen=True)
class _Band:
    """Rows of a picture, or all of it: what is found here depends on no light."""

    mesh: Mesh
    prefilter: Prefilter
    gbuffer: GBuffer  # of all samples
    shading: Shading
    crossings: silhouette.Crossings
    cover: Tensor  # (N,) coverage of all samples

    @staticmethod
    @torch.no_grad()
    def of(asset: Asset, camera: Camera, prefilter: Prefilter, device: torch.device) -> "_Band":
        """Return the rows that the camera, cut to them, takes."""
        camera = camera.resized(SAMPLES * camera.width, SAMPLES * camera.height)
        gbuffer, view = rasterize_asset(asset, camera, device), View.of(camera, device)
        screen, faces = view.project(asset.mesh.vertices), asset.mesh.faces
        edges = edge_faces(faces, silhouette.outline_vertices(screen, faces))
        crossings = silhouette.silhouette_crossings(screen, faces, edges, gbuffer.pixel, view)
        cover = silhouette.coverage(gbuffer.pixel, crossings, view.height * view.width)
        return _Band(asset.mesh, prefilter, gbuffer, Shading.of(gbuffer, prefilter), crossings, cover)

    @torch.no_grad()
    def render(self, env: Tensor) -> tuple[Tensor, Tensor]:
        """Return the linear premultiplied image (H, W, 3) and coverage (H, W) under `env` (6, R, R, 3)."""
        radiance = self.shading.apply(self.prefilter.apply(env))
        suns = Suns.of(env)
        if self.gbuffer.visibility is not None and len(suns.block) > 0:
            _, diffuse, _ = self.shading.factors
            radiance = (radiance + diffuse * sharpened(self.gbuffer, self.mesh, suns)).clamp(min=0)
        image = silhouette.spread_color(radiance, self.gbuffer.pixel, self.crossings, self.cover)
        shape = 1, 4, self.gbuffer.height, self.gbuffer.width
        samples = torch.cat([image, self.cover[:, None]], 1).T.reshape(shape)
        pixels = functional.avg_pool2d(samples, SAMPLES)[0].permute(1, 2, 0)
        return pixels[..., :3], pixels[..., 3]
