"""Masks and the hint box of a scene that `lightprobe prepare` makes, as a person draws them on the page."""

import io
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from lightprobe.core.errors import ConfigError, InputError
from lightprobe.core.files import inside, read_json, shell_word
from lightprobe.imaging import (
    IMAGE_SUFFIXES,
    image_size,
    read_ldr,
    read_mask,
    resize_area,
    shrink_area,
    srgb_encode,
    write_mask,
)
from lightprobe.preparation.cache import HIDDEN
from lightprobe.preparation.mask_files import corrected_names
from lightprobe.preparation.options import store_hint, stored_hint
from lightprobe.preparation.preparing import locked_scene
from lightprobe.preparation.writing import outlined
from lightprobe.scene.masks import same_shape
from lightprobe.scene.plain_photos import list_photos

PREPARED = "prepare.json"  # marks a scene that `lightprobe prepare` made
MASK_SIDE = 1600  # pixels of the longer side at which masks are painted
_THUMBNAIL = 240  # pixels of the longer side of a photo in the list


@dataclass(frozen=True)
class SceneSource:
    """A folder of photos whose masks can be corrected, or in one of whose photos the object can be shown."""

    folder: Path
    prepared: bool  # else plain photos, without cameras and masks

    def images(self) -> list[Path]:
        """Return the photos that the folder holds now, in the order of the page."""
        if not self.prepared:
            return list_photos(self.folder)
        folder = inside(self.folder, "images", source=self.folder / PREPARED)
        return sorted(path for path in folder.iterdir() if path.suffix.lower() in IMAGE_SUFFIXES)

    def image(self, index: int) -> Path:
        """Return a photo's file; raise `InputError` when there is none or it lies outside of the folder."""
        images = self.images()
        if not 0 <= index < len(images):
            raise InputError("This scene has no such photo any more; load the page again.")
        return inside(self.folder, str(images[index].relative_to(self.folder)), source=self.folder)

    def mask_file(self, index: int) -> Path:
        """Return where a photo's mask is or goes; raise `InputError` where that lies outside of the folder."""
        return inside(self.folder, f"masks/{self.image(index).stem}.png", source=self.folder / PREPARED)

    def to_json(self) -> dict[str, Any]:
        """Return what the page lists: photos with the stability of the mask, warnings, the drawn box."""
        report = read_json(self.folder / PREPARED) if self.prepared else {}
        report = report if isinstance(report, dict) else {}
        stability, doubtful = report.get("mask_stability"), report.get("doubtful_masks")
        stability = stability if isinstance(stability, dict) else {}
        doubtful = doubtful if isinstance(doubtful, list) else []
        corrected = corrected_names(self.folder) if self.prepared else []
        return {
            "name": self.folder.resolve().name,
            "folder": str(self.folder),
            "prepared": self.prepared,
            "photos": [
                {
                    "name": path.stem,
                    "file": path.name,
                    "stability": stability.get(path.stem),
                    "doubtful": path.stem in doubtful,
                    "corrected": path.stem in corrected,
                }
                for path in self.images()
            ],
            "warnings": [text for text in report.get("warnings", []) if isinstance(text, str)],
            "hint": stored_hint(self.folder) if self.prepared else None,
        }


def mask_picture(scene: SceneSource, index: int) -> bytes:
    """Return a photo's mask as grey PNG, black where there is none; raise `InputError` for a damaged one."""
    path = scene.mask_file(index)
    if path.is_file():
        mask = shrink_area(read_mask(path), MASK_SIDE)
    else:
        width, height = image_size(scene.image(index))
        scale = min(MASK_SIDE / max(width, height), 1.0)
        mask = np.zeros((max(round(height * scale), 1), max(round(width * scale), 1)), np.float32)
    buffer = io.BytesIO()
    Image.fromarray(np.rint(255 * np.clip(mask, 0, 1)).astype(np.uint8)).save(buffer, "PNG", compress_level=1)
    return buffer.getvalue()


def thumbnail(scene: SceneSource, index: int) -> bytes:
    """Return a photo as small JPEG, with the outline of its mask; raise `InputError` for a damaged file."""
    color = shrink_area(read_ldr(scene.image(index))[0], _THUMBNAIL)
    picture = np.rint(255 * srgb_encode(np.clip(color, 0, 1))).astype(np.uint8)
    mask = scene.mask_file(index) if scene.prepared else None
    if mask is not None and mask.is_file():
        picture = outlined(picture, resize_area(read_mask(mask), *picture.shape[:2]) >= 0.5)
    buffer = io.BytesIO()
    Image.fromarray(picture).save(buffer, "JPEG", quality=85)
    return buffer.getvalue()


def save_mask(scene: SceneSource, index: int, painted: Path) -> Path:
    """Write a painted mask over a photo's, at the photo's size, and return its file.

    Raises `ConfigError` for a folder of plain photos, `InputError` for a picture of another shape or without
    object, `ResourceError` while another process writes the scene.
    """
    if not scene.prepared:
        raise ConfigError("This folder has no masks yet; draw a box and prepare it first.")
    width, height = image_size(scene.image(index))
    mask = read_mask(painted)
    if not same_shape((mask.shape[1], mask.shape[0]), (width, height)):
        raise InputError(
            f"The painted mask is {mask.shape[1]} x {mask.shape[0]}, but the photo is {width} x {height}."
        )
    if not 0 < (mask >= 0.5).mean() < 1:
        raise InputError(
            "The mask shows no object, or nothing but it; paint the object and leave the rest free."
        )
    target = scene.mask_file(index)
    (scene.folder / HIDDEN).mkdir(exist_ok=True)
    with locked_scene(scene.folder):  # masks take each other's place
        write_mask(target, mask, (height, width))
    return target


def save_box(scene: SceneSource, index: int, box: Sequence[float]) -> str:
    """Keep a box around the object in a prepared scene, and return the command that takes it up.

    box: left, top, right, bottom in shares of the photo's width and height. Raises `InputError` for no box in
    it.
    """
    image = scene.image(index)
    width, height = image_size(image)
    x0, y0, x1, y1 = (round(share * size) for share, size in zip(box, (width, height) * 2, strict=True))
    if not (0 <= x0 < x1 <= width and 0 <= y0 < y1 <= height):
        raise InputError("The box lies outside of the photo or is empty; draw it from corner to corner.")
    folder = scene.folder
    if scene.prepared:
        store_hint(folder, image.stem, (x0, y0, x1, y1))
        return f"lightprobe prepare PHOTOS -o {shell_word(folder)}"
    hint = shell_word(f"{image.name}={x0},{y0},{x1},{y1}")
    return f"lightprobe prepare {shell_word(folder)} -o SCENE --hint {hint}"
