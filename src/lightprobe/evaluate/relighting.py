"""The object under a given light, for any camera of the user's."""

from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from lightprobe.core.errors import InputError
from lightprobe.decompose import Decomposition
from lightprobe.imaging import read_hdr
from lightprobe.light import equirect, prefilter
from lightprobe.render.asset import render_asset
from lightprobe.scene.camera import Camera

_RESOLUTIONS = (8, 16, 32, 64, 128)


def relight(decomposition: Decomposition, environment: Tensor, camera: Camera) -> tuple[Tensor, Tensor]:
    """Return the object under `environment` (6, R, R, 3) seen by an input-frame camera.

    The image (H, W, 3) is linear and premultiplied, the coverage (H, W) in [0, 1]; both on the environment's device.
    """
    asset = decomposition.asset.to(environment.device)
    operator = prefilter.cached(environment.shape[1], environment.device)
    with torch.no_grad():
        return render_asset(asset, camera.normalised(decomposition.similarity), environment, operator)


def load_environment(path: Path, device: torch.device, resolution: int | None = None) -> Tensor:
    """Read an equirectangular EXR or Radiance map into a cubemap (6, R, R, 3), R by default half the map's rows.

    R is a power of two from 8 to 128. Raises `InputError` naming the file when it is no W = 2H map of finite radiance.
    """
    image = read_hdr(path)
    height, width, channels = image.shape
    if width != 2 * height or channels < 3:
        raise InputError(f"{path} is {width} x {height} with {channels} channels; an environment needs RGB and W = 2H.")
    if not np.isfinite(image[..., :3]).all() or image[..., :3].min() < 0:
        raise InputError(f"{path} contains negative, infinite or NaN radiance; repair it in an image editor.")
    wanted = resolution or max((r for r in _RESOLUTIONS if r <= height // 2), default=_RESOLUTIONS[0])
    cube = equirect.to_cubemap(torch.from_numpy(np.ascontiguousarray(image[..., :3], np.float32)), wanted)
    return cube.to(device)
