"""A predicted environment in files: the map, a picture of it, and its confidence."""

from pathlib import Path

import numpy as np
from torch import Tensor

from lightprobe.core.errors import ConfigError
from lightprobe.imaging import write_exr, write_png, write_radiance
from lightprobe.light import equirect
from lightprobe.predict import Prediction

_LUMA = np.array([0.2126, 0.7152, 0.0722], np.float32)


def panorama(cube: Tensor) -> np.ndarray:
    """Return a cubemap (6, R, R, C) as an equirectangular array (2R, 4R, C) float32 in the convention of the files."""
    return equirect.from_cubemap(cube, 2 * cube.shape[1]).detach().cpu().numpy()


def exposure(image: np.ndarray) -> float:
    """Return the factor that shows a linear HDR image (H, W, 3) at a middling brightness, whatever suns it has."""
    luma = image @ _LUMA
    typical = float(np.minimum(luma, 5 * np.median(luma)).mean())
    return 0.5 / typical if typical > 0 else 1.0


def tone_mapped(image: np.ndarray, factor: float) -> np.ndarray:
    """Return linear display values in [0, 1): 1 - exp(-factor * radiance), highlights bent, not cut."""
    return 1 - np.exp(-factor * np.maximum(image, 0))


def write_map(path: Path, image: np.ndarray) -> None:
    """Write an equirectangular map (H, 2H, C); the suffix chooses OpenEXR or Radiance HDR.

    Raises `ConfigError` for any other suffix.
    """
    suffix = path.suffix.lower()
    if suffix not in (".exr", ".hdr"):
        raise ConfigError(f"Cannot write an environment as '{path.name}': name it .exr or .hdr.")
    (write_exr if suffix == ".exr" else write_radiance)(path, image)


def write_prediction(prediction: Prediction, path: Path) -> None:
    """Write `path` (.exr or .hdr), and beside it the tone-mapped .png and the .confidence.exr."""
    image = panorama(prediction.environment)
    write_map(path, image)
    write_png(path.with_suffix(".png"), tone_mapped(image, exposure(image)))
    write_confidence(prediction, path.with_suffix(".confidence.exr"))


def write_confidence(prediction: Prediction, path: Path) -> None:
    """Write the confidence as a one-channel equirectangular EXR."""
    write_exr(path, panorama(prediction.confidence[..., None])[..., 0])
