"""Every photo decoded once: its features, a small picture and the user's mask, kept for the next call."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import scipy

from lightprobe.core.errors import InputError
from lightprobe.core.threads import in_threads
from lightprobe.preparation import learned, salient_object
from lightprobe.preparation.cache import Cache, key_of
from lightprobe.preparation.features import Box, Features, find_features, match_photos
from lightprobe.preparation.judging import sampled
from lightprobe.preparation.mapping import FEWEST_MATCHES, Matches, Pair
from lightprobe.preparation.photos import COLOR_SIDE, SourcePhoto, WorkingPictures, copies, working_pictures
from lightprobe.preparation.salient_object import kept_log_odds
from lightprobe.preparation.voxel_labelling import box_of_mask, square_around

OnPhoto = Callable[[int, int], None]

_BATCH = 8  # photos whose features are found side by side, and lost when the command is killed
_MARGIN = 0.15  # of the object's longer side around it, in the detail that features are found in
_BLURRED = 0.5  # of the median sharpness of all photos: below, a photo without a camera is called blurred
_FEW_FEATURES = 80  # from which few are left to match


@dataclass(frozen=True)
class Seen:
    """What is kept of one photo."""

    features: Features
    grey: np.ndarray  # (H, W) uint8, which the features were found in
    color: np.ndarray  # (h, w, 3) uint8 sRGB
    given: np.ndarray | None  # (h, w) float32, the user's mask
    sharpness: float


def look_at_all(
    photos: Sequence[SourcePhoto], cache: Cache, on_photo: OnPhoto = lambda done, total: None
) -> list[Seen]:
    """Return what is kept of each photo, shapes as in `Seen`; raises `InputError` for a damaged file."""
    kind = _kinds()
    keys = [key_of(photo.checksum, _stamp(photo.mask), photo.cutout, kind, COLOR_SIDE) for photo in photos]
    kept = [cache.find(_step(photo), key) for photo, key in zip(photos, keys, strict=True)]
    missing = [index for index, values in enumerate(kept) if values is None]
    if len(missing) < len(photos):
        on_photo(len(photos) - len(missing), len(photos))
    for first in range(0, len(missing), _BATCH):
        batch = missing[first : first + _BATCH]
        for index, values in zip(batch, _looked_at([photos[index] for index in batch], cache), strict=True):
            cache.keep(_step(photos[index]), keys[index], values)
            kept[index] = values
        on_photo(len(photos) - len(missing) + first + len(batch), len(photos))
    return [_seen(values) for values in kept if values is not None]


def _kinds() -> list[bool]:
    """Return which networks are there that features and details are found by."""
    return [learned.is_installed(), salient_object.is_installed()]


def _step(photo: SourcePhoto) -> str:
    return f"photo-{photo.name}"


def _looked_at(photos: Sequence[SourcePhoto], cache: Cache) -> list[dict[str, np.ndarray]]:
    """Return what is kept of each photo as arrays; shapes as in `Seen`."""
    pictures = [working_pictures(photo) for photo in photos]
    can_see = learned.is_installed() and salient_object.is_installed()

    def box(each: tuple[SourcePhoto, WorkingPictures]) -> Box | None:
        photo, picture = each
        if picture.alpha is not None:
            return _around(picture.alpha >= 0.5, picture.grey.shape)
        if not can_see:
            return None
        return _around(kept_log_odds(cache, photo.name, picture.color) > 0, picture.grey.shape)

    boxes = in_threads(box, list(zip(photos, pictures, strict=True)))
    found = find_features([each.grey for each in pictures], boxes)
    return [
        {
            **{"points": features.points, "descriptors": features.descriptors},
            **{"grey": each.grey, "color": each.color},
            "size": np.array([features.width, features.height]),
            "sharpness": np.array(each.sharpness),
            **({} if each.alpha is None else {"given": each.alpha}),
            **({} if features.close is None else {"close": features.close, "box": np.array(features.box)}),
        }
        for each, features in zip(pictures, found, strict=True)
    ]


def _around(mask: np.ndarray, size: tuple[int, int]) -> Box | None:
    """Return the square around the largest piece of a mask (h, w) bool, in a picture of (height, width); None: no piece."""
    pieces, count = scipy.ndimage.label(mask)
    if not count:
        return None
    largest = 1 + int(np.argmax(np.bincount(pieces.ravel())[1:]))
    across, down = size[1] / mask.shape[1], size[0] / mask.shape[0]
    left, right, top, bottom = box_of_mask(pieces == largest)
    box = left * across, right * across, top * down, bottom * down
    left, right, top, bottom = square_around(box, _MARGIN)
    height, width = (float(length) for length in size)
    return (
        max(0.0, float(np.floor(left))),
        min(width, float(np.ceil(right))),
        max(0.0, float(np.floor(top))),
        min(height, float(np.ceil(bottom))),
    )


def _seen(kept: Mapping[str, np.ndarray]) -> Seen:
    """Return the kept arrays, of any shape, of one photo as what they are."""
    width, height = (int(length) for length in kept["size"])
    box = kept.get("box")
    told = None if box is None else (float(box[0]), float(box[1]), float(box[2]), float(box[3]))
    features = Features(kept["points"], kept["descriptors"], width, height, kept.get("close"), told)
    return Seen(features, kept["grey"], kept["color"], kept.get("given"), float(kept["sharpness"]))


def _stamp(mask: Path | None) -> list[float] | None:
    found = None if mask is None else mask.stat()
    return None if found is None else [found.st_size, found.st_mtime]


def match_all(photos: Sequence[SourcePhoto], seen: Sequence[Seen], cache: Cache, on_pair) -> dict:
    """Return the matches (M, 2) uint32 of all pairs of photos that are worth it."""

    def make() -> dict[str, np.ndarray]:
        found = match_photos([each.features for each in seen], _allowed(photos, seen), on_pair)
        pairs = np.array(list(found), np.int64).reshape(-1, 2)
        rows = np.concatenate([np.zeros((0, 2), np.uint32), *found.values()])
        counts = np.array([len(each) for each in found.values()], np.int64)
        return {"pairs": pairs, "rows": rows, "counts": counts}

    kept = cache.arrays(
        "matches",
        key_of(_kinds(), [[photo.checksum, _stamp(photo.mask), photo.cutout] for photo in photos]),
        make,
    )
    parts = np.split(kept["rows"], np.cumsum(kept["counts"])[:-1]) if len(kept["counts"]) else []
    return {(int(i), int(j)): part for (i, j), part in zip(kept["pairs"], parts, strict=True)}


def match_pairs(
    photos: Sequence[SourcePhoto], seen: Sequence[Seen], pairs: Sequence[Pair], on_pair
) -> Matches:
    """Return the matches (M, 2) uint32 of some pairs of photos."""
    return match_photos([each.features for each in seen], _allowed(photos, seen), on_pair, pairs)


def _allowed(photos: Sequence[SourcePhoto], seen: Sequence[Seen]) -> list[np.ndarray]:
    """Return which features may be matched, (N,) bool: none of a copy, and only those inside a cutout."""
    again = copies(photos)
    allowed = []
    for photo, each in zip(photos, seen, strict=True):
        shown = np.ones(len(each.features.points), bool)
        if photo.cutout and each.given is not None:
            shown = sampled(each.given, each.features)
        allowed.append(shown & (photo.name not in again))
    return allowed


def refuse_copies(photos: Sequence[SourcePhoto], fewest: int) -> None:
    """Raise `InputError` where too few different photos are left without copies of the same file."""
    again = copies(photos)
    if len(photos) - len(again) < fewest:
        raise InputError(
            f"Of {len(photos)} photos {len(again)} are copies of others, such as {next(iter(again))} of "
            f"{next(iter(again.values()))}; at least {fewest} are needed, and 30 or more for a good result."
        )


def reason_lost(
    photo: SourcePhoto,
    each: Seen,
    best_match: int,
    median_sharpness: float,
    original: str | None,
    together: Sequence[str] = (),
) -> str:
    """Return why a photo has no camera, in a few words.

    together: the other photos of a reconstruction that does not join the kept one and has this photo.
    """
    if original is not None:
        return f"the same file as {original}"
    if together:
        more = f" and {len(together) - 1} more" if len(together) > 1 else ""
        return f"fits {together[0]}{more}, apart from those that have cameras; photos between are missing"
    if each.sharpness < _BLURRED * median_sharpness:
        return f"blurred; sharpness {each.sharpness / median_sharpness:.2f} of the others'"
    if len(each.features.points) < _FEW_FEATURES:
        return f"few features; {len(each.features.points)} found"
    if best_match < 2 * FEWEST_MATCHES:
        return f"few matches; at most {best_match} with another photo"
    return f"not enough inliers; {best_match} matches with its best partner do not fit the cameras"
