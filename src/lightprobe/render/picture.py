"""The finished picture of an asset: several samples a pixel, and sharp shadows of suns.

Phase I and the predictors look at one point of the surface per pixel. That is fast, and a picture would show it: a thin
bar, a crease or the weave of a cloth breaks into steps, and a comparison with a photo would score the steps. Here the
samples of a pixel are averaged as a camera's pixel averages its square, and the light is known, so that its suns are.
"""

import torch
from torch import Tensor
from torch.nn import functional

from lightprobe.geometry.mesh import edge_faces
from lightprobe.light.prefilter import Prefilter
from lightprobe.render.asset import Asset, composite, rasterize_asset
from lightprobe.render.gbuffer import GBuffer
from lightprobe.render.split_sum import reflectance, shade
from lightprobe.render.suns import Suns, sharpened
from lightprobe.render.surface import View
from lightprobe.scene.camera import Camera

SAMPLES = 2  # along each edge of a pixel


def sampled_camera(camera: Camera) -> Camera:
    """Return the camera of the same view whose pixels are the picture's samples."""
    return camera.resized(SAMPLES * camera.width, SAMPLES * camera.height)


def picture_gbuffer(asset: Asset, camera: Camera, device: torch.device) -> GBuffer:
    """Return the G-buffer of all samples of the picture that a normalised-frame camera takes."""
    return rasterize_asset(asset, sampled_camera(camera), device)


@torch.no_grad()
def render_asset(asset: Asset, camera: Camera, env: Tensor, prefilter: Prefilter, gbuffer: GBuffer | None = None
                 ) -> tuple[Tensor, Tensor]:  # fmt: skip
    """Return the linear premultiplied image (H, W, 3) and coverage (H, W) of the asset under `env` (6, R, R, 3).

    camera: normalised frame; `gbuffer`: that of `picture_gbuffer`, when the caller has it.
    """
    if gbuffer is None:
        gbuffer = picture_gbuffer(asset, camera, env.device)
    radiance = shade(gbuffer, prefilter, prefilter.apply(env))
    suns = Suns.of(env)
    if gbuffer.openness is not None and len(suns.block) > 0:
        sharper = reflectance(gbuffer).diffuse * sharpened(gbuffer, asset.mesh, suns)
        radiance = (radiance + sharper).clamp(min=0)
    mesh, view = asset.mesh, View.of(sampled_camera(camera), env.device)
    image, cover = composite(gbuffer, radiance, mesh.vertices, mesh.faces, edge_faces(mesh.faces), view)
    samples = torch.cat([image, cover[..., None]], -1).permute(2, 0, 1)
    pixels = functional.avg_pool2d(samples[None], SAMPLES)[0].permute(1, 2, 0)
    return pixels[..., :3], pixels[..., 3]
