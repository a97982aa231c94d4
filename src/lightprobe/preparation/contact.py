"""The contact sheet: every photo with the outline of its mask, its name and what is to be said of it."""

import numpy as np

from lightprobe.scene.overlay import outline

_LINE = (255, 60, 0)  # sRGB of the outline
GOOD, DOUBTFUL, LOST = (220, 220, 220), (255, 200, 0), (255, 90, 90)  # sRGB of captions
LOW_AGREEMENT = 0.8  # IoU of mask and hull below which a mask is doubtful


def outlined(color: np.ndarray, mask: np.ndarray) -> np.ndarray:
    """Return a photo (h, w, 3) uint8 with what lies outside its mask (h, w) bool dimmed, and the outline
    drawn.
    """
    picture = np.where(mask[..., None], color, color // 3).astype(np.uint8)
    width = max(1, round(max(mask.shape) / 200))
    picture[outline(mask, width)] = _LINE
    return picture


def photo_cell(
    name: str, color: np.ndarray, mask: np.ndarray, agreement: float | None
) -> tuple[str, np.ndarray, tuple[int, int, int]]:
    """Return caption, picture (h, w, 3) uint8 and the caption's colour of a photo with a camera."""
    doubtful = agreement is None or agreement < LOW_AGREEMENT
    score = "" if agreement is None else f" {agreement:.2f}"
    return f"{name}{score}", outlined(color, mask), DOUBTFUL if doubtful else GOOD


def lost_cell(name: str, color: np.ndarray, reason: str) -> tuple[str, np.ndarray, tuple[int, int, int]]:
    """Return caption, picture (h, w, 3) uint8 and the caption's colour of a photo without a camera."""
    grey = np.repeat((color.mean(axis=2, keepdims=True) * 0.6).astype(np.uint8), 3, axis=2)
    return f"{name}: {reason.split(';')[0]}", grey, LOST
