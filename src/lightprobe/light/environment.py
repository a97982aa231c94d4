"""Distant light around an object: texels of a cubemap in memory, equirectangular EXR or Radiance maps in files.

Both have z up and the axes of the user's frame, which shares its directions with the normalised frame.
Functions that compute with light texel by texel take and return the texels alone, as `light` (6, R, R, 3).
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from lightprobe.core.config.export import ColorSpace
from lightprobe.core.errors import InputError
from lightprobe.imaging import read_hdr
from lightprobe.light import cubemap, equirect
from lightprobe.light.display import displayed, png
from lightprobe.light.files import environment_files, panorama, write_map
from lightprobe.light.resize import resize_light, rotate_light
from lightprobe.light.upsampling import resized_map

_RESOLUTIONS = (8, 16, 32, 64, 128)  # that a file may be read at


@dataclass(frozen=True)
class Environment:
    """HDR radiance from all directions, in the exposure of the photo it belongs to."""

    texels: Tensor  # (6, R, R, 3) float32 linear RGB radiance >= 0, as in `light.cubemap`

    def __post_init__(self) -> None:
        """Raise `ValueError` for a tensor of another shape."""
        shape = tuple(self.texels.shape)
        if len(shape) != 4 or shape != (6, shape[1], shape[1], 3):
            raise ValueError(f"an environment has texels (6, R, R, 3), not {shape}")

    @property
    def resolution(self) -> int:
        """Texels along each cubemap edge, R."""
        return self.texels.shape[1]

    @property
    def device(self) -> torch.device:
        """Where the texels are."""
        return self.texels.device

    def to(self, device: torch.device) -> "Environment":
        """Return the environment on another device."""
        return Environment(self.texels.to(device))

    def solid_angles(self) -> Tensor:
        """Return the texels' solid angles (6, R, R) in steradians; they sum to 4 pi."""
        return cubemap.solid_angles(self.resolution, self.device)

    def mean(self) -> Tensor:
        """Return the mean radiance (3,) over the sphere."""
        return cubemap.sphere_mean(self.texels)

    def scaled(self, factor: Tensor | float) -> "Environment":
        """Return the environment times `factor`, one or (3,): under another exposure or white balance."""
        return Environment(self.texels * factor)

    def resized(self, resolution: int) -> "Environment":
        """Return the environment at another power-of-two resolution: area averages, or repeated texels."""
        return Environment(resize_light(self.texels, resolution))

    def rotated(self, rotation: Tensor, resolution: int | None = None) -> "Environment":
        """Return the environment whose radiance in direction d is this one's in `rotation` (3, 3) d."""
        return Environment(rotate_light(self.texels, rotation, resolution or self.resolution))

    @staticmethod
    def from_panorama(image: np.ndarray, resolution: int | None = None) -> "Environment":
        """Return the environment of an equirectangular map (H, 2H, 3), with R by default half the map's rows.

        R is then a power of two from 8 to 128. Raises `InputError` unless W = 2H.
        """
        fits = [side for side in _RESOLUTIONS if side <= image.shape[0] // 2]
        wanted = resolution or max(fits, default=_RESOLUTIONS[0])
        texels = torch.from_numpy(np.ascontiguousarray(image, np.float32))
        return Environment(equirect.to_cubemap(texels, wanted))

    def panorama(self, height: int | None = None) -> np.ndarray:
        """Return the equirectangular map (2R, 4R, 3) float32, or one of `height` rows (`light.upsampling`)."""
        image = panorama(self.texels)
        return image if height is None else resized_map(image, height)

    @staticmethod
    def load(
        path: Path | str, device: torch.device | None = None, resolution: int | None = None
    ) -> "Environment":
        """Read an equirectangular EXR or Radiance map, by default onto the CPU; R as in `from_panorama`.

        Raises `InputError` naming the file when it is no W = 2H map of finite radiance.
        """
        return Environment.from_panorama(read_map(Path(path)), resolution).to(device or torch.device("cpu"))

    def _repr_png_(self) -> bytes:
        """Return the map as notebooks show it: exposed, highlights bent."""
        return png(displayed(self.panorama()))

    def save(
        self, path: Path | str, height: int | None = None, color_space: ColorSpace = ColorSpace.SRGB
    ) -> None:
        """Write an equirectangular .exr or .hdr of 2R rows or `height`; `ConfigError` for another suffix.

        color_space: as in `write_map`.
        """
        write_map(Path(path), self.panorama(height), color_space)


def read_map(path: Path) -> np.ndarray:
    """Return an equirectangular EXR or Radiance map (H, 2H, 3) float32 >= 0, all of its texels.

    Raises `InputError` naming the file when it is no W = 2H map of finite radiance.
    """
    image = read_hdr(path)
    height, width, channels = image.shape
    if width != 2 * height or channels < 3:
        size = f"{width} x {height} with {channels} channels"
        raise InputError(f"{path} is {size}; an environment needs RGB and W = 2H.")
    if not np.isfinite(image[..., :3]).all() or image[..., :3].min() < 0:
        raise InputError(f"{path} contains negative, infinite or NaN radiance; repair it in an image editor.")
    return np.ascontiguousarray(image[..., :3], np.float32)


def load_environments(folder: Path, resolution: int) -> list[Environment]:
    """Return every .exr and .hdr map of a folder, on the CPU, in the order of their names.

    Raises `InputError` when the folder has none, or one that cannot be used.
    """
    return [Environment.load(path, resolution=resolution) for path in environment_files(folder)]
