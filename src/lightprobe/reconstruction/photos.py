"""Training photos as tensors, at the size a pass works at."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeVar

import torch
from torch import Tensor

from lightprobe.render.surface import View
from lightprobe.scene import load_pixels
from lightprobe.scene.photo import OPAQUE, Photo, Scene

_Photo = TypeVar("_Photo")  # whatever stands for one
_WHOLE = 0.99  # of the mask's highest coverage, above which a pixel shows the object alone


@dataclass(frozen=True)
class Target:
    """One photo in the normalised frame; N = height * width pixels, row-major."""

    name: str
    view: View
    color: Tensor  # (N, 3) linear, premultiplied
    alpha: Tensor  # (N,)
    clipped: Tensor  # (N, 3) bool: the pixel is at least as bright as its colour
    background_level: float | None = None  # as `trials.plausibility.background_level` has it

    @property
    def covered(self) -> Tensor:
        """Which pixels the object covers more than half, (N,) bool."""
        return self.alpha > 0.5

    def inside(self, pixel: Tensor) -> Tensor:
        """Return the places (M,) int64 in `pixel` (K,) int64 of those pixels that lie wholly inside the mask.

        Masks that are nearly white inside, as some programs make them, count as white.
        """
        return (self.alpha[pixel] > _WHOLE * self.alpha.max()).nonzero()[:, 0]


def load_targets(scene: Scene, photos: Sequence[Photo], side: int, device: torch.device) -> list[Target]:
    """Return the photos reduced to at most `side` pixels along the longer edge."""
    support = None if scene.support is None else scene.support.normalised(scene.similarity)
    targets = []
    for photo in photos:
        pixels, camera = load_pixels(photo, side)
        # A white that is nearly 1 counts as 1, lest photos be darker than they are.
        white = pixels.alpha.max(initial=0.0)
        alpha = torch.from_numpy(pixels.alpha / white if white >= OPAQUE else pixels.alpha).reshape(-1)
        color = torch.from_numpy(pixels.color).reshape(-1, 3) * alpha[:, None]
        view = View.of(camera.normalised(scene.similarity), device, support)
        clipped = torch.from_numpy(pixels.clipped).reshape(-1, 3)
        targets.append(Target(photo.name, view, color.to(device), alpha.to(device), clipped.to(device)))
    return targets


def evenly_spaced(photos: Sequence[_Photo], count: int) -> list[_Photo]:
    """Return `count` photos spread evenly over the sequence, all where there are fewer."""
    count = min(count, len(photos))
    return [photos[int((k + 0.5) * len(photos) / count)] for k in range(count)]
