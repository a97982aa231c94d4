"""Landmarks: features of the training photos with the points of the mesh that they show."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from lightprobe.localization.features import SIDE, find_features
from lightprobe.render.asset import Asset
from lightprobe.render.surface import View, visible_surface
from lightprobe.scene import load_pixels
from lightprobe.scene.camera import Similarity
from lightprobe.scene.photo import Photo

PER_PHOTO = 250  # landmarks: with 120 photos a file of 5 MB
_INSIDE = 0.9  # coverage of the object
_FINE = 2  # the mesh is rasterised so many times finer than the photo: a landmark's place is half a pixel's


@dataclass(frozen=True)
class Landmarks:
    """N points of the object; several photos may show the same."""

    descriptor: Tensor  # (N, 128) uint8 as in `Features`
    point: Tensor  # (N, 3) float32, normalised frame
    photo: Tensor  # (N,) int32 which of the V training photos showed it, ascending
    side: (
        Tensor  # (V, 3) float32 unit direction from the object's origin to the camera of each training photo
    )

    def tensors(self) -> dict[str, Tensor]:
        """Return all tensors by name."""
        return dict(vars(self))


def find_landmarks(
    asset: Asset, photos: Sequence[Photo], similarity: Similarity, on_photo: Callable[[int, int], None]
) -> Landmarks:
    """Return the landmarks of training photos on the asset; `on_photo` is called with how many are done, and
    of all.
    """
    parts = []
    for index, photo in enumerate(photos):
        descriptor, point = _of_photo(asset, photo, similarity)
        parts.append((descriptor, point, torch.full((len(point),), index, dtype=torch.int32)))
        on_photo(index + 1, len(photos))
    position = np.stack([photo.camera.normalised(similarity).position for photo in photos])
    side = torch.as_tensor(position / np.linalg.norm(position, axis=1, keepdims=True), dtype=torch.float32)
    descriptor, point, number = (torch.cat(part) for part in zip(*parts, strict=True))
    return Landmarks(descriptor, point, number, side)


def _of_photo(asset: Asset, photo: Photo, similarity: Similarity) -> tuple[Tensor, Tensor]:
    """Return descriptors (N, 128) and points (N, 3) of one photo."""
    pixels, camera = load_pixels(photo, SIDE)
    features = find_features(pixels.color, PER_PHOTO, pixels.alpha >= _INSIDE)
    fine = camera.normalised(similarity).resized(camera.width * _FINE, camera.height * _FINE)
    surface = visible_surface(
        asset.mesh.vertices, asset.mesh.faces, View.of(fine, asset.mesh.vertices.device)
    )
    if not len(surface.pixel):
        return torch.zeros(0, 128, dtype=torch.uint8), torch.zeros(0, 3)
    row = np.full(fine.width * fine.height, -1)
    row[surface.pixel.cpu().numpy()] = np.arange(len(surface.pixel))
    column, line = (features.place * _FINE).astype(int).T.clip(0, [[fine.width - 1], [fine.height - 1]])
    hit = row[line * fine.width + column]
    seen = hit >= 0
    return torch.from_numpy(features.descriptor[seen]), surface.position.cpu()[torch.from_numpy(hit[seen])]
