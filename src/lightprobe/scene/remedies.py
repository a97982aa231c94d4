"""Sentences about what is wrong with a scene's masks and cameras, each with a command or a line that mends it."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import scipy

from lightprobe.core.errors import InputError
from lightprobe.core.files import shell_word
from lightprobe.imaging import srgb_encode
from lightprobe.scene.causes import Cause, Kind
from lightprobe.scene.diagnosis import Diagnosis
from lightprobe.scene.photo import Photo
from lightprobe.scene.pixels import load_thumbnail

_NAMED = 12  # photos that a sentence names, and files that its command does
_LOOKED_AT, _SIDE = 5, 192  # photos whose masks are compared with their edges, and pixels of the longer side
_CLEARLY = 1.25  # ratio of edges along two outlines that tells which is the mask's
_TURNED_BY = {3: 180, 6: 270, 8: 90}  # degrees clockwise that undo an EXIF orientation


def sentence(diagnosis: Diagnosis, photos: Sequence[Photo], orientations: Sequence[int], root: Path) -> str:
    """Return what is wrong with which photos, how the hull shows it, and what to do.

    photos: all of the scene in `root`, in the order that the diagnosis counts, with their EXIF `orientations`.
    """
    chosen = [photos[i] for i in diagnosis.photos]
    total = len(photos)
    who = which([photo.name for photo in chosen], total)
    fit = f"hull IoU {diagnosis.before:.2f} as they are, {diagnosis.after:.2f} without that"
    cause = diagnosis.cause
    if diagnosis.unclear:
        fit += f"; {listed([photos[i].name for i in diagnosis.unclear])} may have it, too, and fit either way"
    if cause.kind is Kind.TURNED:
        tags = {orientations[i] for i in diagnosis.photos}
        return _turned(cause, chosen, total, fit, tags, root)
    remedy = cause.remedy
    if cause.kind is Kind.INVERTED:
        masks = [photo.mask_path for photo in chosen if photo.mask_path is not None]
        remedy += f"; `mogrify -negate {files(masks, total, root)}` inverts them" if masks else ""
    subject = f"The {cause.subject} of {who}" if cause.subject != "photos" else who[0].upper() + who[1:]
    return f"{subject} look {cause.state} ({fit}): {remedy}."


def which(names: Sequence[str], total: int) -> str:
    """Return words for the photos `names` of `total`."""
    if len(names) == total:
        return f"all {total} photos"
    return f"{len(names)} of {total} photos ({listed(names)})"


def listed(names: Sequence[str]) -> str:
    """Return the first names, and how many are left."""
    return ", ".join(names[:_NAMED]) + (f" and {len(names) - _NAMED} more" if len(names) > _NAMED else "")


def files(paths: Sequence[Path], total: int, root: Path) -> str:
    """Return the words of a command, given in the folder `root`, for files of some of `total` photos."""
    inside = [path.relative_to(root) if path.is_relative_to(root) else path for path in paths]
    kinds = {f"{shell_word(path.parent)}/*{path.suffix}" for path in inside}
    if len(paths) == total and len(kinds) < len(paths):
        return " ".join(sorted(kinds))
    return " ".join(
        [*(shell_word(path) for path in inside[:_NAMED]), *(["..."] if len(inside) > _NAMED else [])]
    )


def _turned(cause: Cause, chosen: Sequence[Photo], total: int, fit: str, tags: set[int], root: Path) -> str:
    """Return the sentence about masks that fit their cameras only when turned by `cause.turn` degrees clockwise.

    The mask is wrong where the outline of the turned one lies on the photo's edges, the camera where its own does.
    An EXIF orientation explains either: programs turn photos by it or do not.
    """
    who = which([photo.name for photo in chosen], total)
    ratio = _edges_along_turned(chosen, cause.turn)
    is_exif = len(tags) == 1 and _TURNED_BY.get(min(tags)) == cause.turn
    masks, images = (
        [photo.mask_path for photo in chosen if photo.mask_path],
        [photo.image_path for photo in chosen],
    )
    turn = f"turned by {cause.turn} degrees"
    if masks and ratio > _CLEARLY and is_exif:
        return (
            f"The masks of {who} are upright and the photos are not, whose EXIF orientation {min(tags)} turns both "
            f"({fit}): turn the photos themselves, `mogrify -auto-orient {files(images, total, root)}`."
        )
    if masks and ratio > _CLEARLY:
        return (
            f"The masks of {who} are {turn} against photos and cameras ({fit}): "
            f"`mogrify -rotate {cause.turn} {files(masks, total, root)}` turns them."
        )
    if ratio < 1 / _CLEARLY and is_exif:
        return (
            f"The cameras of {who} are for the photos as stored, which their EXIF orientation {min(tags)} turns "
            f"({fit}): take it out, `exiftool -n -Orientation=1 {files(images, total, root)}`, or estimate the cameras "
            "from the photos turned upright."
        )
    line = f"turn the cameras about their view axes ({cause.remedy} for each camera-to-world matrix m)"
    if ratio < 1 / _CLEARLY:
        return f"The cameras of {who} are {turn} against photos and masks ({fit}): {line}."
    return f"Masks and cameras of {who} are {turn} against each other ({fit}): turn the masks, or {line}."


def _edges_along_turned(photos: Sequence[Photo], turn: int) -> float:
    """Return how much stronger a photo's edges are along the turned mask's outline than along the mask's own.

    Below 1 where a mask and its photo are one file or where a turned one has another shape; 1 where nothing tells.
    """
    ratios = []
    for photo in photos[:_LOOKED_AT]:
        try:
            color, alpha = load_thumbnail(photo, _SIDE)
        except InputError:
            continue
        mask = alpha >= 0.5
        turned = np.rot90(mask, -turn // 90)
        if photo.mask_path is None or turned.shape != mask.shape:
            return 0.0
        edges = np.hypot(*np.gradient(srgb_encode(color).mean(axis=-1)))
        own, other = (_along(edges, shape) for shape in (mask, turned))
        ratios.append((other + 1e-6) / (own + 1e-6))
    return float(np.exp(np.mean(np.log(ratios)))) if ratios else 1.0


def _along(edges: np.ndarray, shape: np.ndarray) -> float:
    """Return the mean of `edges` (h, w) beside the outline of `shape` (h, w) bool."""
    band = scipy.ndimage.binary_dilation(shape) & ~scipy.ndimage.binary_erosion(shape, border_value=1)
    return float(edges[band].mean()) if band.any() else 0.0
