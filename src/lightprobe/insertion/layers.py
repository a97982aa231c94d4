"""What an insertion leaves: the picture, and the layers that it is made of.

    picture = photo x shadow x (1 - mask) + beauty

in linear light, before grain. `shadow` is what the thing multiplies the light of ground and known object by:
below 1 where it takes light away, above where it throws some. `beauty` is premultiplied with `mask`.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from lightprobe.core.files import filled_folder
from lightprobe.imaging import write_exr, write_png


@dataclass(frozen=True)
class LayerFiles:
    """Where picture and layers go."""

    picture: Path  # .png
    beauty: Path  # .exr, RGBA
    shadow: Path  # .exr, RGB
    mask: Path  # .exr, one channel

    @staticmethod
    def of(picture: Path) -> "LayerFiles":
        """Return the files named after a picture: NAME.beauty.exr and so on beside it."""
        return LayerFiles(
            picture, *(picture.with_name(f"{picture.stem}.{n}.exr") for n in ("beauty", "shadow", "mask"))
        )


@dataclass(frozen=True)
class Insertion:
    """A photo with a thing in it; (H, W) are the photo's."""

    color: np.ndarray  # (H, W, 3) float32 linear, straight, with grain
    alpha: (
        np.ndarray | None
    )  # (H, W) of a cut-out photo, with the thing and its shadow; None: the photo is opaque
    beauty: np.ndarray  # (H, W, 3) float32 linear, premultiplied
    shadow: np.ndarray  # (H, W, 3) float32
    mask: np.ndarray  # (H, W) float32, coverage of the thing where nothing stands before it
    at: tuple[float, float]  # pixel of the thing's foot
    scale: float  # its height relative to the known object's
    warnings: tuple[str, ...]

    def write(self, files: LayerFiles) -> None:
        """Write the layers and the picture: all of them appear, or none; one folder holds them."""
        with filled_folder(files.picture.parent) as folder:
            write_exr(folder / files.beauty.name, np.dstack([self.beauty, self.mask]))
            write_exr(folder / files.shadow.name, self.shadow)
            write_exr(folder / files.mask.name, self.mask)
            write_png(folder / files.picture.name, self.color, self.alpha)
