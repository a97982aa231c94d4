"""A map inside a GLB, by glTF's extension EXT_lights_image_based: prefiltered faces, and harmonics of the irradiance.

Where the extension's words leave a choice, this is what Babylon.js reads, the program that implements it:

- Faces are those of OpenGL's cubemap in the frame (-x, y, z) of glTF's y-up (x, y, z): Babylon's world is left-handed.
- A PNG of four channels holds radiance over `intensity` as RGBD: (r, g, b)^2.2 / d, with d >= 1 / 255, so up to 255.
- Harmonics are of the irradiance over `intensity`, in the same frame, with Condon-Shortley signs.

Levels are evenly spaced in roughness from 0 to 1; those above 0 are looked up as renders look them up
(`light.prefilter`).
"""

import io
import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import torch
from PIL import Image
from torch import Tensor

from lightprobe.kernels import weighted_gather
from lightprobe.light import cubemap, equirect
from lightprobe.light.environment import Environment
from lightprobe.light.prefilter import cached
from lightprobe.light.resize import rotate_light
from lightprobe.light.spherical_harmonics import plain_harmonics
from lightprobe.light.upsampling import resized_map

SIDE, LEVELS = 256, 5  # pixels of the first level's faces; of the last, 16, as the extension recommends
_ROWS = 512  # of the map that the faces are made from, at most: as fine as they are
_PREFILTERED = 64  # texels along a cubemap edge of the light that rough levels are made from
_AXES = torch.tensor(
    [[-1.0, 0, 0], [0, 0, 1], [0, -1, 0]], dtype=torch.float64
)  # rows: the frame's axes, z up
_RANGE, _GAMMA = 255.0, 2.2  # of RGBD
_COSINE = (math.pi, *[2 * math.pi / 3] * 3, *[math.pi / 4] * 5)  # from radiance's harmonics to irradiance's
# Condon's and Shortley's, in the order of `spherical_harmonics.BASIS`
_SIGNS = 1, -1, 1, -1, 1, -1, 1, -1, 1


@dataclass(frozen=True)
class ImageBasedLight:
    """A light as the extension has it."""

    intensity: float
    irradiance: tuple[tuple[float, ...], ...]  # (9, 3)
    faces: tuple[tuple[bytes, ...], ...]  # (LEVELS, 6) PNG files

    @staticmethod
    def of(image: np.ndarray) -> "ImageBasedLight":
        """Return the light of a map (H, 2H, 3) of linear radiance >= 0."""
        levels = list(_levels(image if len(image) <= _ROWS else resized_map(image, _ROWS)))
        intensity = float(levels[0].max()) / _RANGE or 1.0
        weights = torch.tensor(_COSINE) * torch.tensor(_SIGNS) / intensity
        harmonics = weights[:, None] * plain_harmonics(levels[0])
        faces = tuple(tuple(_rgbd(face / intensity) for face in level.numpy()) for level in levels)
        return ImageBasedLight(intensity, tuple(map(tuple, harmonics.tolist())), faces)


def _levels(image: np.ndarray) -> Iterator[Tensor]:
    """Yield the cubemaps (6, R, R, 3) of all levels, in the extension's frame."""
    texels = torch.from_numpy(np.ascontiguousarray(image, np.float32))
    yield rotate_light(equirect.to_cubemap(texels, SIDE), _AXES.T, SIDE)
    light = Environment.from_panorama(image, _PREFILTERED).texels
    prefilter = cached(_PREFILTERED)
    stack = prefilter.apply(light)
    for level in range(1, LEVELS):
        side = SIDE >> level
        towards = (cubemap.directions(side).reshape(-1, 3) @ _AXES.float()).contiguous()
        roughness = torch.full((len(towards),), level / (LEVELS - 1))
        yield weighted_gather(stack, *prefilter.specular_taps(towards, roughness)).reshape(6, side, side, 3)


def _rgbd(radiance: np.ndarray) -> bytes:
    """Return the PNG of a face (R, R, 3) of values in [0, 255]."""
    greatest = np.maximum(radiance.max(-1, keepdims=True), 1e-30)
    divisor = np.clip(np.floor(_RANGE / greatest), 1, 255)  # of 255
    color = 255 * (radiance * (divisor / 255)).clip(0, 1) ** (1 / _GAMMA)
    buffer = io.BytesIO()
    pixels = np.concatenate([np.rint(color), divisor], -1).astype(np.uint8)
    Image.fromarray(pixels).save(buffer, "PNG")
    return buffer.getvalue()
