"""A predicted environment in files: the map, a picture of it, and its confidence."""

from pathlib import Path

import numpy as np

from lightprobe.core.config.prediction import Sun
from lightprobe.imaging import LUMA, write_png
from lightprobe.light.files import write_map
from lightprobe.prediction import Prediction


def exposure(image: np.ndarray) -> float:
    """Return the factor that shows a linear HDR image (H, W, 3) at a middling brightness, whatever suns it has."""
    luma = image @ LUMA
    typical = float(np.minimum(luma, 5 * np.median(luma)).mean())
    return 0.5 / typical if typical > 0 else 1.0


def tone_mapped(image: np.ndarray, factor: float) -> np.ndarray:
    """Return linear display values in [0, 1): 1 - exp(-factor * radiance), highlights bent, not cut."""
    return 1 - np.exp(-factor * np.maximum(image, 0))


def write_prediction(
    prediction: Prediction, path: Path, height: int | None = None, sun: Sun = Sun.INSIDE
) -> None:  # fmt: skip
    """Write `path` (.exr or .hdr), and beside it the tone-mapped .png and the .confidence.exr.

    `height` and `sun` as in `Prediction.save`.
    """
    image = prediction.map(sun).panorama(height)
    write_map(path, image)
    write_png(path.with_suffix(".png"), tone_mapped(image, exposure(image)))
    prediction.save_confidence(path.with_suffix(".confidence.exr"))
