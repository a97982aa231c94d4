"""What one photo tells about its light: its trusted pixels on the known object.

A pixel is trusted when the object covers it in the photo (mask) and in the rasterised asset. Large photos are
reduced by area averaging first, so that the cost of a prediction is bounded; the average of linear light is
what a coarser camera would have seen.
"""

from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from lightprobe.core.errors import InputError
from lightprobe.models.probe_pixels import ProbePixels, probe_pixels
from lightprobe.render.asset import Asset, rasterize_asset
from lightprobe.render.gbuffer import GBuffer
from lightprobe.scene.camera import Camera
from lightprobe.scene.photo import OPAQUE, Pixels

_HALF = 0.5  # coverage from which a pixel counts as the object's
_FEWEST_PIXELS = 16  # that a light can be found from


@dataclass(frozen=True)
class Observation:
    """One photo on the asset; K trusted pixels, on one device."""

    gbuffer: GBuffer
    rows: Tensor  # (K,) int64 rows of the G-buffer
    pixels: ProbePixels  # (K) linear colours in the photo's exposure
    clipped: Tensor  # (K, 3) bool: the photo's white hides how bright the pixel was
    light_level: Tensor  # () radiance of the constant light that explains the photo's total luma
    overlap: float  # of the mask and the rasterised object, intersection over union
    offset: float  # between the centres of both, in object radii at the object's distance


def observe(
    asset: Asset, pixels: Pixels, camera: Camera, device: torch.device, max_pixels: int
) -> Observation:
    """Return what `pixels` shows of the asset seen by a normalised-frame `camera`.

    The photo is reduced until about `max_pixels` of its pixels lie in the mask. Raises `InputError` when the
    photo and camera differ in size, the mask is empty, or the asset is out of view.
    """
    height, width = pixels.alpha.shape
    if (camera.width, camera.height) != (width, height):
        raise InputError(
            f"The photo has {width} x {height} pixels but its camera {camera.width} x {camera.height}; "
            "give the camera of this photo."
        )
    pixels = pixels.within(max_pixels)
    camera = camera.resized(pixels.alpha.shape[1], pixels.alpha.shape[0])
    gbuffer = rasterize_asset(asset, camera, device)
    cover = torch.from_numpy(pixels.alpha).to(device).reshape(-1)
    covered = cover[gbuffer.pixel]
    rows = (covered >= OPAQUE).nonzero()[:, 0]
    if len(rows) < _FEWEST_PIXELS:
        raise InputError(
            f"Only {len(rows)} pixels of the mask show the object as seen by this camera; check the pose and the mask."
        )
    at = gbuffer.pixel[rows]
    seen = probe_pixels(gbuffer, rows, torch.from_numpy(pixels.color).to(device).reshape(-1, 3)[at])
    hidden = torch.from_numpy(pixels.clipped).to(device).reshape(-1, 3)[at]
    overlap, offset = _overlap(cover, covered), _offset(cover >= _HALF, gbuffer.pixel, camera)
    return Observation(gbuffer, rows, seen, hidden, seen.light_level(), overlap, offset)


def _overlap(cover: Tensor, covered: Tensor) -> float:
    """Return the intersection over union of a mask (N,) and the object's pixels, where the mask is `covered`
    (P,).
    """
    both = int((covered >= _HALF).sum())
    return both / (int((cover >= _HALF).sum()) + len(covered) - both)


def _offset(mask: Tensor, pixel: Tensor, camera: Camera) -> float:
    """Return how far the centre of a mask (N,) bool lies from that of the object's pixels (P,), in normalised
    units.

    It is the move, across the view, of an object or a camera that would bring one to the other.
    """
    away = [_center(at, camera) for at in (mask.nonzero()[:, 0], pixel)]
    return float(np.linalg.norm(away[0] - away[1]) * np.linalg.norm(camera.position))


def _center(pixel: Tensor, camera: Camera) -> np.ndarray:
    """Return the mean (2,) of the pixels' places on the image plane at distance 1."""
    column, row = pixel % camera.width, torch.div(pixel, camera.width, rounding_mode="floor")
    return np.array([float(column.double().mean()) / camera.fx, float(row.double().mean()) / camera.fy])
