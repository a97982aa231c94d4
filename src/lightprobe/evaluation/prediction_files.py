"""A predicted environment in files: the map, a picture of it, and its confidence."""

from pathlib import Path

from lightprobe.core.config.prediction import Sun
from lightprobe.imaging import write_png
from lightprobe.light.display import exposure, tone_mapped
from lightprobe.light.files import write_map
from lightprobe.prediction import Prediction


def write_prediction(
    prediction: Prediction, path: Path, height: int | None = None, sun: Sun = Sun.INSIDE
) -> None:
    """Write `path` (.exr or .hdr), and beside it the tone-mapped .png and the .confidence.exr.

    `height` and `sun` as in `Prediction.save`.
    """
    image = prediction.map(sun).panorama(height)
    write_map(path, image)
    write_png(path.with_suffix(".png"), tone_mapped(image, exposure(image)))
    prediction.save_confidence(path.with_suffix(".confidence.exr"))
