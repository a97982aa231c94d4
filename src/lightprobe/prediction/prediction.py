"""What a prediction is, and its files."""

import base64
import html
from dataclasses import dataclass
from pathlib import Path

from torch import Tensor

from lightprobe.core.config.prediction import Sun
from lightprobe.core.errors import ConfigError, ConvergenceError
from lightprobe.light.display import png
from lightprobe.light.environment import Environment
from lightprobe.light.files import check_map_name, plane, write_plane
from lightprobe.light.sources import SplitLight
from lightprobe.models.calibration import Calibration
from lightprobe.prediction.background import BackgroundUse
from lightprobe.prediction.confidence import RANGE, confidence_colors
from lightprobe.prediction.verdict import PhotoVerdict


@dataclass(frozen=True)
class Prediction:
    """The light around the object in one photo, in the input frame's axes and the photo's exposure."""

    environment: Environment
    confidence: Tensor  # (6, R, R) in (0, 1): exp(-the error to expect of ln radiance)
    seconds: dict[str, float]  # wall time of the parts "rasterise" to "confidence", and "total"
    verdict: PhotoVerdict  # whether the photo can be what it is taken for; good or doubtful
    background: BackgroundUse = BackgroundUse.ABSENT
    split: SplitLight | None = None  # the same light as suns and lamps and the rest, if they were asked for
    calibration: Calibration | None = None  # that the light has been through

    def __post_init__(self) -> None:
        """Raise `ConvergenceError` for a map that nobody could use."""
        light = self.environment.texels
        if not (light.isfinite().all() & (light >= 0).all() & self.confidence.isfinite().all()):
            raise ConvergenceError(
                "The predicted light came out negative, infinite or NaN: check the photo, its camera and mask, try "
                "another --method, or train the run anew."
            )

    def map(self, sun: Sun = Sun.INSIDE) -> Environment:
        """Return the light to write as a map: whole, or without its suns and lamps where they were found."""
        return self.environment if sun is Sun.INSIDE or self.split is None else self.split.rest

    def save(
        self,
        path: Path | str,
        confidence: Path | str | None = None,
        *,
        height: int | None = None,
        sun: Sun = Sun.INSIDE,
    ) -> None:
        """Write the map as equirectangular .exr or .hdr, and its confidence, if named, as a one-channel .exr.

        height: rows of the map, by default 2R of the environment's R. sun: what becomes of suns and lamps;
        those that are left out of the map are in `split.sources` and in no file (`lightprobe predict` lists
        them in one). Raises `ConfigError` for other names, before anything is written.
        """
        path, confidence = Path(path), None if confidence is None else Path(confidence)
        check_names(path, confidence)
        self.map(sun).save(path, height)
        if confidence is not None:
            self.save_confidence(confidence)

    def _repr_png_(self) -> bytes:
        """Return the map as notebooks show it."""
        return self.environment._repr_png_()

    def _repr_html_(self) -> str:
        """Return the map and its confidence beside each other, with the verdict, as notebooks show it."""
        confidence = png(confidence_colors(plane(self.confidence)))
        low, high = RANGE
        figures = _figure(self._repr_png_(), "light")
        figures += _figure(confidence, f"confidence, {low} or less violet, {high} or more yellow")
        words = [f"photo {self.verdict.status.value}", *self.verdict.sentences]
        words += [f"{self.seconds['total']:.2f} s"] if "total" in self.seconds else []
        return f'<div style="display:flex;gap:1em">{figures}</div><p>{html.escape("; ".join(words))}</p>'

    def save_confidence(self, path: Path) -> None:
        """Write the confidence as a one-channel equirectangular EXR."""
        write_plane(path, self.confidence)


def _figure(picture: bytes, caption: str) -> str:
    address = f"data:image/png;base64,{base64.b64encode(picture).decode()}"
    shown = f'<img src="{address}" alt="{caption}" width="384"><figcaption>{caption}</figcaption>'
    return f'<figure style="margin:0">{shown}</figure>'


def check_names(path: Path | None, confidence: Path | None) -> None:
    """Raise `ConfigError` when a map and its confidence cannot be written under these names."""
    if path is not None:
        check_map_name(path)
    if confidence is not None and confidence.suffix.lower() != ".exr":
        raise ConfigError(f"Cannot write a confidence as '{confidence.name}': name it .exr.")
    if path is not None and confidence is not None and path.resolve() == confidence.resolve():
        raise ConfigError(f"Map and confidence would both be {path}: give them two names.")
