"""A test photo beside the asset: everything an evaluation needs of it, read once.

Photos are scored at their full size. What would take hundreds of bytes for each of their pixels is made in
bands.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from lightprobe.evaluation.metrics import ImageScores, image_scores, on_white, psnr
from lightprobe.imaging import check_memory
from lightprobe.light import prefilter
from lightprobe.models import Decomposition
from lightprobe.render.asset import rasterize_asset
from lightprobe.render.gbuffer import GBuffer
from lightprobe.render.picture import Picture
from lightprobe.scene import load_pixels
from lightprobe.scene.camera import Camera
from lightprobe.scene.photo import Photo, Pixels

_SMALL = 2**20  # pixels that are worked on at once, and up to which a photo's G-buffer has its full size
_PIXEL_BYTES = 240  # that scoring takes for each of a photo's pixels
_OBJECT = 0.5  # coverage from which a pixel counts as the object's


@dataclass(frozen=True)
class TestView:
    """One photo at full size with what the asset shows there."""

    __test__ = False  # not a test class, whatever its name

    photo: Photo
    pixels: Pixels
    camera: Camera  # input frame
    gbuffer: GBuffer  # of the photo's size, or a smaller one where there is no true material to compare with
    picture: Picture
    reference: Tensor  # (H, W, 3) sRGB in [0, 1], the photo's object on white
    mask: Tensor  # (H, W) bool

    @staticmethod
    def load(
        photo: Photo, decomposition: Decomposition, light_resolution: int, device: torch.device
    ) -> "TestView":
        """Read the photo and make the asset's view ready for lights (6, R, R, 3) of resolution R."""
        check_memory(photo.image_path, (photo.camera.width, photo.camera.height), _PIXEL_BYTES)
        pixels, camera = load_pixels(photo)
        normalised = camera.normalised(decomposition.similarity)
        gbuffer = rasterize_asset(decomposition.asset, _material_camera(photo, normalised), device)
        operator = prefilter.cached(light_resolution, device)
        picture = Picture.of(decomposition.asset, normalised, operator, device)
        alpha = torch.from_numpy(pixels.alpha).to(device)
        reference = _on_white(torch.from_numpy(pixels.color).to(device), alpha)
        return TestView(photo, pixels, camera, gbuffer, picture, reference, alpha > _OBJECT)

    def shown(self, lights: Sequence[Tensor]) -> list[Tensor]:
        """Return the sRGB images on white (H, W, 3) of the object under each light (6, R, R, 3)."""
        images = [torch.empty_like(self.reference) for _ in lights]
        for rows, parts in self.picture.bands(lights):
            for image, part in zip(images, parts, strict=True):
                image[rows] = on_white(*part)
        return images

    def score(self, image: Tensor) -> ImageScores:
        """Compare an sRGB image on white (H, W, 3) with the photo."""
        return image_scores(image, self.reference, self.mask)

    def psnr(self, image: Tensor, mask: Tensor) -> float:
        """Return the PSNR in dB of an sRGB image on white (H, W, 3) over the pixels of `mask` (H, W) bool."""
        return psnr(image[mask], self.reference[mask])


def _on_white(color: Tensor, alpha: Tensor) -> Tensor:
    """Return linear straight colour (H, W, 3) with alpha (H, W) as sRGB on white, made in strips of rows."""
    step = max(1, _SMALL // alpha.shape[1])
    strips = zip(color.split(step), alpha.split(step), strict=True)
    return torch.cat([on_white(part * cover[..., None], cover) for part, cover in strips])


def _material_camera(photo: Photo, camera: Camera) -> Camera:
    """Return the camera of the G-buffer: of full size where true materials are compared pixel by pixel."""
    truth = photo.truth
    shrink = math.sqrt(min(1.0, _SMALL / (camera.width * camera.height)))
    if shrink == 1 or truth.base_color or truth.orm or truth.normal:
        return camera
    return camera.scaled(shrink)


def halves(alpha: np.ndarray) -> list[np.ndarray]:
    """Return four masks (H, W) bool: the object's pixels left, right, above and below its middle pixel.

    The middle is the median, so that each pair splits the object's pixels evenly; the two masks of a pair are
    neighbours in the list.
    """
    inside = alpha > _OBJECT
    masks = []
    for axis in (1, 0):
        place = np.indices(alpha.shape)[axis]
        first = inside & (place < np.median(place[inside]))
        masks += [first, inside & ~first]
    return masks
