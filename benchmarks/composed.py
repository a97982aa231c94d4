"""Photos of a synthetic scene's object in front of the environment that lights it, as a camera would take them."""

import numpy as np
import torch

from lightprobe.imaging import read_hdr, read_ldr
from lightprobe.light import equirect
from lightprobe.render.surface import View
from lightprobe.scene.camera import Camera
from lightprobe.scene.photo import Photo


def background(environment: np.ndarray, camera: Camera) -> np.ndarray:
    """Return what `camera` sees of an equirectangular `environment` (h, 2h, 3), linear, as (H, W, 3) float32."""
    view = View.of(camera, torch.device("cpu"))
    rays = view.rays(torch.arange(camera.height * camera.width))
    map = torch.from_numpy(np.ascontiguousarray(environment[..., :3], np.float32))
    seen = equirect.sample(map, torch.nn.functional.normalize(rays, dim=1))
    return seen.reshape(camera.height, camera.width, 3).numpy()


def composed(photo: Photo) -> np.ndarray:
    """Return a photo with an alpha channel over its true environment, linear (H, W, 3), unclipped."""
    color, alpha = read_ldr(photo.image_path)
    if photo.truth.environment is None or alpha is None:
        raise ValueError(f"The light or the mask of {photo.name} is not known.")
    behind = background(read_hdr(photo.truth.environment), photo.camera)
    return color * alpha[..., None] + behind * (1 - alpha[..., None])
