"""Photos, scenes and what flows from the loaders to the rest.

Colour: `Pixels.color` is linear, straight (not premultiplied) RGB in which 1.0 is the white of that photo.
"""

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from lightprobe.scene.camera import Camera, Similarity

CLIPPED = 0.98  # linear value from which an 8-bit photo is taken as saturated; half a code below 255 is .989


@dataclass(frozen=True)
class Truth:
    """Ground-truth files of a synthetic photo: for evaluation only, never an input. Absent ones are None."""

    environment: Path | None = None
    linear: Path | None = None  # premultiplied linear render
    base_color: Path | None = None  # sRGB-encoded
    orm: Path | None = None  # linear; G roughness, B metallic
    normal: Path | None = None  # world-space
    light: str | None = None  # name of the environment that this and other photos' were made from


@dataclass(frozen=True)
class Photo:
    """One photo of the object with its camera in the input frame."""

    name: str  # unique in the scene and safe as a file name
    camera: Camera
    image_path: Path
    mask_path: Path | None = None  # None: the image's own alpha channel
    ev100: float | None = None  # exposure value from EXIF, if complete
    truth: Truth = field(default_factory=Truth)


@dataclass(frozen=True)
class Pixels:
    """Decoded pixels of one photo."""

    color: np.ndarray  # (H, W, 3) float32, linear, straight
    alpha: np.ndarray  # (H, W) float32 in [0, 1], coverage of the object


@dataclass(frozen=True)
class Scene:
    """Photos split for training and testing, and the similarity to the normalised frame."""

    root: Path
    format: str  # "nerd", "transforms" or "colmap": how it was read
    train: tuple[Photo, ...]
    test: tuple[Photo, ...]
    relight: tuple[Photo, ...]  # synthetic only: novel lights with ground truth
    similarity: Similarity
