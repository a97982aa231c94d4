"""Features of photos under changing light, on pictures of even contrast, and which photos match.

Learned ones (`learned`) where the package with their weights is installed. Otherwise SIFT by COLMAP, which ends where an object
shines or neighbouring photos stand more than some 20 degrees apart; its descriptors are compared by their scalar
product, 128 bytes each, of nearly equal length.
"""

import contextlib
import shutil
import signal
import tempfile
import threading
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import torch
from PIL import Image

from lightprobe.core.errors import ResourceError
from lightprobe.core.extras import extra_library
from lightprobe.core.partial import partial_folder
from lightprobe.core.threads import in_threads
from lightprobe.preparation import learned

Box = tuple[float, float, float, float]  # left, right, top, bottom in pixels

_SILENT = 4  # beyond glog's FATAL, 3
_BESIDE = 64 << 20  # bytes that are to be free beside what is asked for
MOST = 2500  # features of a photo: twice as many take four times as long to match and register no photo more
_PEAK = 0.0015  # contrast of a feature's blob, a quarter of COLMAP's: objects are smoother than houses
_RATIO = 0.8  # the best match must be nearer than this times the second best (Lowe 2004)
_FURTHEST = 0.7  # radians between descriptors that may still match, as in COLMAP
MOST_LEARNED = 1024  # learned ones: matching takes a tenth of a second a pair, four times as long with 2048
_LEARNED_SIDE = 960  # pixels of the longer side that these are found in: more shows them too little at once
_DETAIL_SIDE = 640  # likewise of the detail around the object
_MAGNIFY = 2.0  # at most, of a smaller picture: beyond, there is nothing new
_LIKELY = 0.8  # cosine of learned descriptors that may be of one place
_FEW_LEARNED = 512  # as the following
_FEW = 300  # features of a photo that are compared to find out which photos match at all
_THREADS = 4  # at most: each takes half a gigabyte for a picture of 1600 pixels
_ROW = 200  # bytes of a feature in COLMAP's database, or a little less
_LEAST_SIDE = 32  # pixels of a picture with features: COLMAP's affine ones end the process below 16
_AT_ONCE = 16  # pairs that are matched between two words on progress
PARTNERS = 16  # photos that each photo is matched with: 14 and 24 give the same cameras of two shoots of 66
EVERY = 48  # photos up to which each is matched with all others
STILL = 0.004  # of the longer side: what moves less between two photos stands still in them


def pycolmap_library() -> Any:
    """Return `pycolmap`, told to be silent; raise `ConfigError` saying how to install it."""
    module = extra_library("pycolmap", "Finding the cameras of plain photos")
    module.logging.minloglevel = _SILENT  # what it says is said again in our words
    before = signal.getsignal(signal.SIGTERM)
    if before is not None and threading.current_thread() is threading.main_thread():
        signal.signal(
            signal.SIGTERM, before
        )  # its own prints a stack trace for everybody who ends a preparation
    return module


def opencv_library() -> Any:
    """Return OpenCV's `cv2`; raise `ConfigError` saying how to install it when it is missing."""
    return extra_library("cv2", "Cutting the object out of plain photos")


@contextlib.contextmanager
def working_folder(needed: int) -> Iterator[Path]:
    """Yield a new folder in the system's temporary one for COLMAP's database, deleted at the end.

    COLMAP works on files, and ends the process where the disk is full. needed: bytes that will be written
    there. Raises `ResourceError` where so much is not free.
    """
    parent = Path(tempfile.gettempdir())
    free = shutil.disk_usage(parent).free
    if free < needed + _BESIDE:
        raise ResourceError(
            f"{parent} has {free >> 20} MB free, finding cameras needs {(needed + _BESIDE) >> 20} MB there; free some, "
            "or name another folder in the environment variable TMPDIR."
        )
    with partial_folder(parent) as folder:
        yield folder


@dataclass(frozen=True)
class Features:
    """The features of one photo, largest blobs or likeliest points first."""

    points: np.ndarray  # (N, 2) float32, pixels of the working picture: x, y
    descriptors: np.ndarray  # (N, 128) uint8, or (N, 64) float32 where they are learned
    width: int  # of the working picture
    height: int
    close: np.ndarray | None = None  # (N,) bool: found in the detail around the object; None: none of them
    box: Box | None = None  # of that detail, in the working picture

    def within(self, close: bool) -> tuple[np.ndarray, np.ndarray, tuple[int, int]]:
        """Return the rows (K,) of those found in the whole picture, or `close`, their places there (K, 2), and its size."""
        if self.close is None or self.box is None:
            rows = np.arange(0 if close else len(self.points))
            return rows, self.points[rows], (self.width, self.height)
        rows = np.flatnonzero(self.close == close)
        if not close:
            return rows, self.points[rows], (self.width, self.height)
        left, right, top, bottom = self.box
        places = self.points[rows] - np.array([left, top], np.float32)
        return rows, places, (round(right - left), round(bottom - top))

    @property
    def are_learned(self) -> bool:
        """Tell learned features from SIFT's."""
        return self.descriptors.dtype != np.uint8

    def select(self, chosen: np.ndarray) -> "Features":
        """Return the features at `chosen` (N,) bool or (K,) int."""
        close = None if self.close is None else self.close[chosen]
        return replace(self, points=self.points[chosen], descriptors=self.descriptors[chosen], close=close)


def find_features(pictures: Sequence[np.ndarray], boxes: Sequence[Box | None]) -> list[Features]:
    """Return the features of each picture (H, W) uint8; raises `ConfigError` without pycolmap.

    boxes: around the object, in pixels, where known: learned features are found in that detail, too.
    """
    pycolmap = pycolmap_library()
    if learned.is_installed():
        return in_threads(lambda each: _learned(*each), list(zip(pictures, boxes, strict=True)))
    options = pycolmap.FeatureExtractionOptions()
    options.num_threads, options.use_gpu = min(torch.get_num_threads(), _THREADS), False
    options.sift.max_num_features, options.sift.peak_threshold = MOST, _PEAK
    options.sift.estimate_affine_shape = True  # an object is seen from all around, its surface at a slant
    named = {f"{index}.png": picture for index, picture in enumerate(pictures)}
    looked_at = {name: picture for name, picture in named.items() if min(picture.shape) >= _LEAST_SIDE}
    needed = sum(picture.size + 4 * MOST * _ROW for picture in looked_at.values())
    with working_folder(needed) as folder:  # COLMAP's own threads read files only
        database = folder / "features.db"
        for name, picture in looked_at.items():
            Image.fromarray(picture).save(folder / name, compress_level=0)
        each, cpu = pycolmap.CameraMode.PER_IMAGE, pycolmap.Device.cpu
        named_files = database, folder, list(looked_at)
        pycolmap.extract_features(*named_files, each, extraction_options=options, device=cpu)
        opened = pycolmap.Database.open(database)
        found = [_stored(opened, name, picture) for name, picture in named.items()]
        opened.close()
    return found


def _learned(picture: np.ndarray, box: Box | None) -> Features:
    """Return the learned features of a picture (H, W) uint8, and of a detail of it."""
    height, width = picture.shape
    points, descriptors = _found(picture, _LEARNED_SIDE)
    if box is None:
        return Features(points, descriptors, width, height)
    left, right, top, bottom = box
    detail = picture[int(top) : int(bottom), int(left) : int(right)]
    places, more = _found(detail, _DETAIL_SIDE)
    close = np.arange(len(points) + len(places)) >= len(points)
    points = np.concatenate([points, places + np.array([left, top], np.float32)])
    return Features(points, np.concatenate([descriptors, more]), width, height, close, box)


def _found(picture: np.ndarray, side: int) -> tuple[np.ndarray, np.ndarray]:
    """Return points (N, 2) and descriptors (N, 64) of a picture (H, W) uint8 that is reduced or enlarged to a side."""
    cv2 = opencv_library()
    height, width = picture.shape
    scale = min(_MAGNIFY, side / max(picture.shape))
    size = max(1, round(width * scale)), max(1, round(height * scale))
    small = cv2.resize(picture, size, interpolation=cv2.INTER_AREA if scale < 1 else cv2.INTER_CUBIC)
    points, descriptors = learned.find(small, MOST_LEARNED)
    points *= np.array([width / small.shape[1], height / small.shape[0]], np.float32)
    return points, descriptors


def _stored(database: Any, name: str, picture: np.ndarray) -> Features:
    """Return the features of a picture (H, W) that COLMAP's database has."""
    height, width = picture.shape
    none = Features(np.zeros((0, 2), np.float32), np.zeros((0, 128), np.uint8), width, height)
    if not database.exists_image(name):
        return none
    number = database.read_image_with_name(name).image_id
    rows = np.asarray(database.read_keypoints(number), np.float32)
    if not len(rows):
        return none
    size = np.abs(rows[:, 2] * rows[:, 5] - rows[:, 3] * rows[:, 4])  # of x, y, the matrix circle to blob
    order = np.argsort(-size, kind="stable")[:MOST]
    data = np.asarray(database.read_descriptors(number).data, np.uint8).reshape(len(rows), 128)
    return Features(rows[order, :2].copy(), data[order], width, height)


def match(a: Features, b: Features) -> np.ndarray:
    """Return the matches (M, 2) uint32 of two photos: features that are clearly each other's nearest."""
    if min(len(a.points), len(b.points)) < 2:
        return np.zeros((0, 2), np.uint32)
    if a.are_learned:
        return np.concatenate([_matched(a, b, close) for close in (False, True)])
    scores = _unit(a.descriptors) @ _unit(b.descriptors).T
    column = torch.from_numpy(scores.numpy().argmax(axis=1))  # a quarter of the time of PyTorch's
    rows = torch.arange(len(column))
    best, back = scores[rows, column], scores.amax(dim=0)[column]
    scores[rows, column] = -1.0
    second = scores.amax(dim=1)
    angle, runner_up = best.clamp(-1, 1).acos(), second.clamp(-1, 1).acos()
    sure = (angle < _RATIO * runner_up) & (angle < _FURTHEST) & (back == best)
    found = torch.stack([rows[sure], column[sure]], 1).numpy().astype(np.uint32)
    return found[np.sort(np.unique(found[:, 1], return_index=True)[1])]  # of two alike the first


def _matched(a: Features, b: Features, close: bool) -> np.ndarray:
    """Return the matches (M, 2) uint32 of learned features of two whole pictures, or of two details."""
    (first, places_a, size_a), (second, places_b, size_b) = (each.within(close) for each in (a, b))
    found, _ = learned.match(
        (places_a, a.descriptors[first]), (places_b, b.descriptors[second]), size_a, size_b
    )
    return np.stack([first[found[:, 0]], second[found[:, 1]]], 1).astype(np.uint32)


def match_photos(
    photos: Sequence[Features],
    allowed: Sequence[np.ndarray] | None = None,
    on_pair: Callable[[int, int], None] = lambda done, total: None,
    asked: Sequence[tuple[int, int]] | None = None,
) -> dict[tuple[int, int], np.ndarray]:
    """Return the matches (M, 2) uint32 of the `asked` pairs (i, j), i < j, or of all worth it, by the features' indices.

    allowed: the features (N,) bool of each photo that may be matched; the others cannot take a match from
    these.
    """
    everything = [np.ones(len(features.points), bool) for features in photos]
    rows = [np.flatnonzero(flags) for flags in (everything if allowed is None else allowed)]
    chosen = [features.select(kept) for features, kept in zip(photos, rows, strict=True)]
    pairs, found = likely_pairs(chosen) if asked is None else asked, {}
    for first in range(0, len(pairs), _AT_ONCE):
        some = pairs[first : first + _AT_ONCE]
        matched = in_threads(lambda pair: match(chosen[pair[0]], chosen[pair[1]]), some)
        for (i, j), matches in zip(some, matched, strict=True):
            found[i, j] = np.stack([rows[i][matches[:, 0]], rows[j][matches[:, 1]]], 1).astype(np.uint32)
        on_pair(first + len(some), len(pairs))
    return found


def moved(a: Features, b: Features, matches: np.ndarray) -> np.ndarray:
    """Return which matches (M, 2) are at another place in the second photo, (M,) bool."""
    shift = np.abs(_relative(a)[matches[:, 0]] - _relative(b)[matches[:, 1]])
    return shift.max(axis=1, initial=0.0) > STILL


def _relative(features: Features) -> np.ndarray:
    return features.points / max(features.width, features.height)


def likely_pairs(photos: Sequence[Features]) -> list[tuple[int, int]]:
    """Return the pairs (i, j), i < j, that are worth matching: all, or each photo's best partners.

    Found by matching the largest features alone; what stands still counts little, as between photos from one
    tripod it would drown what does not.
    """
    count = len(photos)
    everything = [(i, j) for i in range(count) for j in range(i + 1, count)]
    if count <= EVERY:
        return everything
    few = _FEW_LEARNED if any(each.are_learned for each in photos) else _FEW
    small = [_first(features, few) for features in photos]
    scores = np.zeros((count, count))
    for i, j in everything:
        found = _likely(small[i], small[j])
        away = moved(small[i], small[j], found).sum()
        scores[i, j] = scores[j, i] = away + 0.1 * (len(found) - away)
    near = np.argsort(-scores, axis=1, kind="stable")[:, :PARTNERS]
    chosen = {(min(i, int(j)), max(i, int(j))) for i in range(count) for j in near[i] if scores[i, j] > 0}
    return sorted(chosen)


def _first(features: Features, count: int) -> Features:
    """Return the largest, or likeliest, features; half of them of the detail where there is one."""
    parts = [features.within(close)[0] for close in (False, True)]
    return features.select(np.concatenate([rows[: count // (1 + (len(parts[1]) > 0))] for rows in parts]))


def _likely(a: Features, b: Features) -> np.ndarray:
    """Return matches (M, 2) that are found fast; many of the learned ones are wrong."""
    if not a.are_learned or not len(a.points) or not len(b.points):
        return match(a, b)
    scores = a.descriptors @ b.descriptors.T
    column = scores.argmax(1)
    rows = np.arange(len(column))
    kept = (scores.argmax(0)[column] == rows) & (scores[rows, column] > _LIKELY)
    return np.stack([rows[kept], column[kept]], 1)


def _unit(descriptors: np.ndarray) -> torch.Tensor:
    rows = torch.from_numpy(descriptors).float()
    return rows / rows.norm(dim=1, keepdim=True).clamp_min(1e-6)
