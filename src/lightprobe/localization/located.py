"""What locating a photo gives: camera, mask and verdict, and the files they go to."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import scipy
from PIL import Image

from lightprobe.core.files import atomic_path, write_json
from lightprobe.imaging import shrink_area, srgb_encode, write_mask
from lightprobe.localization.verdict import PoseVerdict
from lightprobe.scene.camera import Camera
from lightprobe.scene.overlay import HULL_COLOR
from lightprobe.scene.photo import Pixels

_OVERLAY_SIDE = 1024  # pixels of the overlay's longer side, at most


@dataclass(frozen=True)
class Located:
    """A photo of the object with the camera that took it."""

    camera: Camera  # input frame, pixels of the photo
    mask: np.ndarray  # (H, W) float32 in [0, 1], coverage of the object; a large photo's is reduced
    verdict: PoseVerdict
    color: np.ndarray  # (H, W, 3) float32 the photo, linear, background included, reduced as the mask is
    clipped: np.ndarray  # (H, W, 3) bool: the photo's white hides how bright it was, background included
    seconds: float

    @property
    def pixels(self) -> Pixels:
        """The photo as `Predictor.predict` takes it with `pixel_camera`: linear (H, W, 3), black beside the
        mask.
        """
        inside = self.mask[..., None] > 0
        return Pixels(self.color * inside, self.mask, self.clipped & inside)

    @property
    def pixel_camera(self) -> Camera:
        """The camera of `pixels`, which are reduced where the photo is large."""
        return self.camera.resized(self.mask.shape[1], self.mask.shape[0])

    def to_json(self) -> dict[str, Any]:
        """Return the camera as the JSON that `--camera` reads, with the verdict beside it; no pixels."""
        return {**self.camera.to_json(), "verdict": self.verdict.to_json()}

    def save_camera(self, path: Path) -> None:
        """Write `to_json`."""
        write_json(Path(path), self.to_json())

    def save_mask(self, path: Path) -> None:
        """Write the mask at the photo's size as PNG, white object on black."""
        write_mask(Path(path), self.mask, (self.camera.height, self.camera.width))

    def save_overlay(self, path: Path) -> None:
        """Write the photo with the outline of the mask over it, as PNG of at most 1024 pixels."""
        write_overlay(Path(path), self.color, self.mask)


def write_overlay(path: Path, color: np.ndarray, mask: np.ndarray) -> None:
    """Write a photo, linear colour (H, W, 3), with the outline of a mask (H, W), as PNG of at most 1024
    pixels.
    """
    picture = srgb_encode(np.clip(shrink_area(color, _OVERLAY_SIDE), 0, 1))
    shown = np.rint(255 * picture).astype(np.uint8)
    inside = shrink_area(mask, _OVERLAY_SIDE) >= 0.5
    outline = scipy.ndimage.binary_dilation(inside) & ~inside
    if max(inside.shape) >= _OVERLAY_SIDE // 2:
        outline = scipy.ndimage.binary_dilation(outline)  # as thick as in small pictures
    shown[outline] = HULL_COLOR
    with atomic_path(path) as temporary:
        Image.fromarray(shown).save(temporary, format="PNG")
