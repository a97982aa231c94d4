"""Environments at other resolutions."""

import functools

import torch
from torch import Tensor

from lightprobe.kernels import weighted_gather
from lightprobe.light import cubemap


def resize_light(light: Tensor, resolution: int) -> Tensor:
    """Return the light (6, R, R, 3) at another power-of-two `resolution`: area averages, or repeated texels."""
    side = light.shape[1]
    if resolution >= side:
        factor = resolution // side
        return light.repeat_interleave(factor, 1).repeat_interleave(factor, 2)
    factor = side // resolution
    angle = cubemap.solid_angles(side, light.device)[..., None]
    blocks = (6, resolution, factor, resolution, factor)
    weighted = (light * angle).reshape(*blocks, 3).sum((2, 4))
    return weighted / angle.reshape(*blocks, 1).sum((2, 4))


def magnify_light(light: Tensor, resolution: int) -> Tensor:
    """Return the light (6, r, r, 3) smoothly interpolated at a finer resolution."""
    if light.shape[1] == resolution:
        return light
    taps = _magnifying_taps(light.shape[1], resolution, light.device)
    return weighted_gather(light.reshape(-1, 3), *taps).reshape(6, resolution, resolution, 3)


@functools.lru_cache(maxsize=16)
def _magnifying_taps(side: int, resolution: int, device: torch.device) -> tuple[Tensor, Tensor]:
    """Return `cubemap.bilinear_taps` of the texels of a cubemap of `resolution` in one of `side`."""
    return cubemap.bilinear_taps(cubemap.directions(resolution, device).reshape(-1, 3), side)


def rotate_light(light: Tensor, rotation: Tensor, resolution: int) -> Tensor:
    """Return the light (6, R, R, 3) with the radiance in direction d that `light` has in `rotation` (3, 3) d.

    A light of another resolution is averaged or interpolated.
    """
    side = max(light.shape[1], resolution)
    directions = cubemap.directions(side, light.device).reshape(-1, 3) @ rotation.to(light).T
    taps = cubemap.bilinear_taps(directions, light.shape[1])
    return resize_light(weighted_gather(light.reshape(-1, 3), *taps).reshape(6, side, side, 3), resolution)
