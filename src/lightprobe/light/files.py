"""Environment maps in files: equirectangular outside, cubemaps within."""

from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from lightprobe.core.errors import ConfigError, ConvergenceError, InputError
from lightprobe.imaging import read_hdr, write_exr, write_radiance
from lightprobe.light import equirect

_RESOLUTIONS = (8, 16, 32, 64, 128)
_SUFFIXES = (".exr", ".hdr")


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


def load_environments(folder: Path, resolution: int) -> list[Tensor]:
    """Return every .exr and .hdr map of a folder as cubemaps (6, R, R, 3) on the CPU, in the order of their names.

    Raises `InputError` when the folder has none, or one that cannot be used.
    """
    return [load_environment(path, torch.device("cpu"), resolution) for path in environment_files(folder)]


def environment_files(folder: Path) -> list[Path]:
    """Return every .exr and .hdr file of a folder in the order of their names; raise `InputError` when it has none."""
    if not folder.is_dir():
        raise InputError(f"{folder} is not a folder of environment maps.")
    paths = sorted(path for path in folder.iterdir() if path.suffix.lower() in _SUFFIXES)
    if not paths:
        raise InputError(f"{folder} has no .exr or .hdr environment map.")
    return paths


def panorama(cube: Tensor) -> np.ndarray:
    """Return a cubemap (6, R, R, C) as an equirectangular array (2R, 4R, C) float32 in the convention of the files."""
    return equirect.from_cubemap(cube, 2 * cube.shape[1]).detach().cpu().numpy()


def write_map(path: Path, image: np.ndarray) -> None:
    """Write an equirectangular map (H, 2H, C); the suffix chooses OpenEXR or Radiance HDR.

    Raises `ConfigError` for any other suffix, `ConvergenceError` for NaN or infinity, which no other program reads.
    """
    check_map_name(path)
    if not np.isfinite(image).all():
        raise ConvergenceError(f"The light for {path} holds NaN or infinity, so it is not written; train the run anew.")
    (write_exr if path.suffix.lower() == ".exr" else write_radiance)(path, image)


def check_map_name(path: Path) -> None:
    """Raise `ConfigError` when no environment can be written under this name."""
    if path.suffix.lower() not in _SUFFIXES:
        raise ConfigError(f"Cannot write an environment as '{path.name}': name it .exr or .hdr.")
