"""Every photo decoded once: its features, a small picture and the user's mask, kept for the same command to go on."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from lightprobe.core.errors import InputError
from lightprobe.preparation.cache import Cache, key_of
from lightprobe.preparation.features import Features, find_features, match_photos
from lightprobe.preparation.judging import sampled
from lightprobe.preparation.mapping import FEWEST_MATCHES
from lightprobe.preparation.photos import SourcePhoto, copies, working_pictures

_BLURRED = 0.5  # of the median sharpness of all photos: below, a photo without a camera is called blurred
_FEW_FEATURES = 80  # from which few are left to match


@dataclass(frozen=True)
class Seen:
    """What is kept of one photo."""

    features: Features
    color: np.ndarray  # (h, w, 3) uint8 sRGB
    given: np.ndarray | None  # (h, w) float32, the user's mask
    sharpness: float


def look_at(photo: SourcePhoto, cache: Cache) -> Seen:
    """Return what is kept of a photo, shapes as in `Seen`; raises `InputError` for a damaged file."""
    key = key_of(photo.checksum, None if photo.mask is None else _stamp(photo), photo.cutout)

    def make() -> dict[str, np.ndarray]:
        pictures = working_pictures(photo)
        found = find_features(pictures.grey)
        values = {
            "points": found.points, "descriptors": found.descriptors, "color": pictures.color,
            "size": np.array([found.width, found.height]), "sharpness": np.array(pictures.sharpness),
        }  # fmt: skip
        return values if pictures.alpha is None else {**values, "given": pictures.alpha}

    kept = cache.arrays(f"photo-{photo.name}", key, make)
    width, height = (int(length) for length in kept["size"])
    features = Features(kept["points"], kept["descriptors"], width, height)
    return Seen(features, kept["color"], kept.get("given"), float(kept["sharpness"]))


def _stamp(photo: SourcePhoto) -> list[float]:
    assert photo.mask is not None
    found = photo.mask.stat()
    return [found.st_size, found.st_mtime]


def match_all(photos: Sequence[SourcePhoto], seen: Sequence[Seen], cache: Cache, on_pair) -> dict:
    """Return the matches (M, 2) uint32 of all pairs of photos that are worth it."""

    def make() -> dict[str, np.ndarray]:
        found = match_photos([each.features for each in seen], _allowed(photos, seen), on_pair)
        pairs = np.array(list(found), np.int64).reshape(-1, 2)
        rows = np.concatenate([np.zeros((0, 2), np.uint32), *found.values()])
        return {"pairs": pairs, "rows": rows, "counts": np.array([len(each) for each in found.values()], np.int64)}

    kept = cache.arrays("matches", key_of([photo.checksum for photo in photos]), make)
    parts = np.split(kept["rows"], np.cumsum(kept["counts"])[:-1]) if len(kept["counts"]) else []
    return {(int(i), int(j)): part for (i, j), part in zip(kept["pairs"], parts, strict=True)}


def _allowed(photos: Sequence[SourcePhoto], seen: Sequence[Seen]) -> list[np.ndarray]:
    """Return which features may be matched, (N,) bool: none of a copy, and of a cutout those that are shown."""
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


def reason_lost(photo: SourcePhoto, each: Seen, best_match: int, median_sharpness: float, original: str | None) -> str:
    """Return why a photo has no camera, in a few words."""
    if original is not None:
        return f"the same file as {original}"
    if each.sharpness < _BLURRED * median_sharpness:
        return f"blurred; sharpness {each.sharpness / median_sharpness:.2f} of the others'"
    if len(each.features.points) < _FEW_FEATURES:
        return f"few features; {len(each.features.points)} found"
    if best_match < 2 * FEWEST_MATCHES:
        return f"few matches; at most {best_match} with another photo"
    return f"not enough inliers; {best_match} matches with its best partner do not fit the cameras"
