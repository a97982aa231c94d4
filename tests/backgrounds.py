"""A photo's background that is a known light."""

import math

import numpy as np
import torch
from torch import Tensor

from lightprobe.light import cubemap
from lightprobe.scene.background import Background
from lightprobe.scene.photo import Pixels
from tests.lit_sphere import patch_light
from tests.shapes import camera_at

CAMERA = camera_at((2.6, 1.4, 1.2), size=64, focal=60.0)
LIGHT = patch_light((0.2, 1.0, 0.5)) * (1 + 0.5 * cubemap.directions(16)[..., 2:])


def around(photo: Pixels, light: Tensor, white: float = math.inf) -> Background:
    """Return the background of a photo, `light` infinitely far, clipped at `white`."""
    row, column = np.mgrid[:64, :64]
    local = np.stack([(column + 0.5 - CAMERA.cx) / 60, -(row + 0.5 - CAMERA.cy) / 60, -np.ones((64, 64))], -1)
    texel = cubemap.nearest_texel(torch.from_numpy(local @ CAMERA.camera_to_world[:3, :3].T), light.shape[1])
    color = light.reshape(-1, 3)[texel].numpy()
    return Background(np.minimum(color, white), photo.alpha == 0, color >= white, CAMERA)
