"""A test photo beside the asset: everything an evaluation needs of it, read and rasterised once."""

from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from lightprobe.decompose import Decomposition
from lightprobe.evaluate.metrics import ImageScores, image_scores, on_white
from lightprobe.light import prefilter
from lightprobe.render.asset import rasterize_asset
from lightprobe.render.gbuffer import GBuffer
from lightprobe.render.picture import Picture
from lightprobe.scene import load_pixels
from lightprobe.scene.camera import Camera
from lightprobe.scene.photo import Photo, Pixels

_OBJECT = 0.5  # coverage from which a pixel counts as the object's


@dataclass(frozen=True)
class TestView:
    """One photo at full size with the asset's G-buffers."""

    __test__ = False  # not a test class, whatever its name

    photo: Photo
    pixels: Pixels
    camera: Camera  # input frame
    gbuffer: GBuffer
    picture: Picture
    reference: Tensor  # (H, W, 3) sRGB in [0, 1], the photo's object on white
    mask: Tensor  # (H, W) bool

    @staticmethod
    def load(photo: Photo, decomposition: Decomposition, light_resolution: int, device: torch.device) -> "TestView":
        """Read the photo and make the asset's view ready for lights of 6 x R x R texels, R the resolution."""
        pixels, camera = load_pixels(photo)
        normalised = camera.normalised(decomposition.similarity)
        gbuffer = rasterize_asset(decomposition.asset, normalised, device)
        operator = prefilter.cached(light_resolution, device)
        picture = Picture.of(decomposition.asset, normalised, operator, device)
        alpha = torch.from_numpy(pixels.alpha).to(device)
        color = torch.from_numpy(pixels.color).to(device)
        reference = on_white(color * alpha[..., None], alpha)
        return TestView(photo, pixels, camera, gbuffer, picture, reference, alpha > _OBJECT)

    def score(self, image: Tensor, mask: Tensor | None = None) -> ImageScores:
        """Compare an sRGB image on white (H, W, 3) with the photo; `mask` (H, W) bool replaces the object's own."""
        return image_scores(image, self.reference, self.mask if mask is None else mask)


def halves(alpha: np.ndarray) -> list[np.ndarray]:
    """Return four masks (H, W) bool: the object's pixels left, right, above and below its middle pixel.

    The middle is the median, so that each pair splits the object's pixels evenly; the two masks of a pair are
    neighbours in the list and together make the object.
    """
    inside = alpha > _OBJECT
    masks = []
    for axis in (1, 0):
        place = np.indices(alpha.shape)[axis]
        first = inside & (place < np.median(place[inside]))
        masks += [first, inside & ~first]
    return masks
