"""The mask of an object at a pose: its coverage of every pixel of the photo."""

import numpy as np
import torch

from lightprobe.imaging import resize_area
from lightprobe.kernels import rasterize
from lightprobe.render.asset import Asset
from lightprobe.render.surface import View
from lightprobe.scene.camera import Camera

_SAMPLES = 3  # along a pixel's edge, of small photos
_SIDE = 3000  # samples along the photo's longer side, at most, unless the photo has more pixels


def silhouette(asset: Asset, camera: Camera) -> np.ndarray:
    """Return the coverage (H, W) float32 in [0, 1] of the asset seen by a normalised-frame camera."""
    samples = max(1, min(_SAMPLES, _SIDE // max(camera.width, camera.height)))
    view = View.of(
        camera.resized(camera.width * samples, camera.height * samples), asset.mesh.vertices.device
    )
    screen = view.project(asset.mesh.vertices)
    face = rasterize(screen, asset.mesh.faces, view.height, view.width).face
    covered = (face >= 0).to(torch.uint8).cpu().numpy()
    return resize_area(covered, camera.height, camera.width) if samples > 1 else covered.astype(np.float32)


def inside_share(asset: Asset, camera: Camera) -> float:
    """Return which share of the asset's vertices, whatever hides them, a camera has within its picture, 0 to
    1.
    """
    place = camera.project(asset.mesh.vertices.double().cpu().numpy())
    inside = (place[:, 2] > 0) & (place[:, 0] >= 0) & (place[:, 0] <= camera.width)
    return float((inside & (place[:, 1] >= 0) & (place[:, 1] <= camera.height)).mean())
