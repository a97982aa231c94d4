"""Which of several reconstructions is the object's: judged by what happens on it, not by how much registered.

Before a still background an object that is turned moves against everything else: the background then gives
cameras without flaw, and wrong ones for the object. So the matches of two photos on the object are asked:
which share of the matches that fit together in any way (some fundamental matrix) fits the cameras, within
`match_tolerance`?
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from lightprobe.core.threads import in_threads
from lightprobe.preparation.features import Features, moved, pycolmap_library
from lightprobe.preparation.geometry import epipolar_distance, match_tolerance, same_side
from lightprobe.preparation.mapping import Matches, Solution

_ENOUGH = 12  # matches of a pair on the object that say something
_TRIALS = 10_000  # of a pair's geometry, as COLMAP has it for two views; more take seconds where few fit
_MOST_PAIRS = 600  # pairs that are asked; the strongest
_STILL_PAIR = 0.5  # share of still matches of a pair from one tripod
_STILL_SCENE = 0.5  # share of such pairs in photos from one tripod
_STILL_OFTEN = 2  # photos in which a feature stands still: neighbours do where an axis of rotation shows
_CENTRAL = 0.25  # of the longer side around the middle: what is photographed is there
_HOPS = 2  # from a photo with a hint along its matches


@dataclass(frozen=True)
class ObjectFit:
    """How well a reconstruction explains the object."""

    registered: int
    explained: float  # share of the object's matches, 0 to 1; of photos that have a camera
    points: int  # on the object
    error: float  # pixels, mean over these points
    angle: float  # degrees, median of their widest angles between two cameras

    def score(self, total: int) -> float:
        """Return what is compared: the share of photos registered times the share explained."""
        return self.registered / max(total, 1) * self.explained

    def to_json(self) -> dict[str, float | int]:
        """Return the fit as prepare.json has it."""
        return {
            "registered": self.registered,
            "object_matches_explained": round(self.explained, 4),
            "object_points": self.points,
            "reprojection_error_px": round(self.error, 4),
            "triangulation_angle_deg": round(self.angle, 2),
        }


def still_share(photos: Sequence[Features], matches: Matches) -> float:
    """Return the share of pairs whose matches (M, 2) mostly stand at the same place in both photos."""
    pairs = [(pair, rows) for pair, rows in matches.items() if len(rows) >= _ENOUGH]
    still = [1 - moved(photos[i], photos[j], rows).mean() > _STILL_PAIR for (i, j), rows in pairs]
    return float(np.mean(still)) if still else 0.0


def from_one_tripod(photos: Sequence[Features], matches: Matches) -> bool:
    """Tell whether the background stands at the same place in most photos; `matches` (M, 2) by pair."""
    return still_share(photos, matches) > _STILL_SCENE


def moving_features(photos: Sequence[Features], matches: Matches) -> list[np.ndarray]:
    """Return which features, (N,) bool of each photo, do not stand still by their matches (M, 2)."""
    still = [np.zeros(len(features.points), int) for features in photos]
    for (i, j), rows in matches.items():
        resting = rows[~moved(photos[i], photos[j], rows)]
        still[i][resting[:, 0]] += 1
        still[j][resting[:, 1]] += 1
    return [counts < _STILL_OFTEN for counts in still]


def inside_masks(photos: Sequence[Features], masks: Mapping[int, np.ndarray]) -> list[np.ndarray]:
    """Return which features lie inside the masks (h, w) of their photos, (N,) bool each."""
    return [
        sampled(masks[index], features) if index in masks else np.zeros(len(features.points), bool)
        for index, features in enumerate(photos)
    ]


def sampled(mask: np.ndarray, features: Features) -> np.ndarray:
    """Return the mask (h, w) at the features, (N,) bool."""
    height, width = mask.shape
    columns = np.clip(features.points[:, 0] * width / features.width, 0, width - 1).astype(int)
    rows = np.clip(features.points[:, 1] * height / features.height, 0, height - 1).astype(int)
    return mask[rows, columns] >= 0.5


def spread(inside: Sequence[np.ndarray], matches: Matches) -> list[np.ndarray]:
    """Return `inside` (N,) bool of each photo with what matches it, and what matches that in turn."""
    known = [flags.copy() for flags in inside]
    for _ in range(_HOPS):
        following = [flags.copy() for flags in known]
        for (i, j), rows in matches.items():
            following[j][rows[known[i][rows[:, 0]], 1]] = True
            following[i][rows[known[j][rows[:, 1]], 0]] = True
        known = following
    return known


def central(photos: Sequence[Features]) -> list[np.ndarray]:
    """Return which features lie around the middle of their photos, (N,) bool each."""
    offsets = (each.points - [each.width / 2, each.height / 2] for each in photos)
    pairs = zip(offsets, photos, strict=True)
    return [np.linalg.norm(off, axis=1) < _CENTRAL * max(each.width, each.height) for off, each in pairs]


class ObjectMatches:
    """The matches of pairs on the object that fit together in some way."""

    def __init__(
        self, photos: Sequence[Features], matches: Matches, inside: Sequence[np.ndarray], seed: int = 0
    ):
        """Find them; `matches` (M, 2) by pair, `inside` (N,) bool: the features on the object."""
        self._photos, self._inside = photos, inside
        chosen = {
            (i, j): rows[inside[i][rows[:, 0]] & inside[j][rows[:, 1]]] for (i, j), rows in matches.items()
        }
        strong = [pair for pair in chosen if len(chosen[pair]) >= _ENOUGH]
        asked = sorted(strong, key=lambda pair: (-len(chosen[pair]), pair))[:_MOST_PAIRS]

        def fit(pair: tuple[int, int]) -> np.ndarray:
            return _fitting(photos[pair[0]], photos[pair[1]], chosen[pair], seed)

        fitting = in_threads(fit, asked)
        fits = zip(asked, fitting, strict=True)
        self.pairs = {pair: chosen[pair][kept] for pair, kept in fits if kept.sum() >= _ENOUGH}

    def judge(self, solution: Solution) -> ObjectFit:
        """Return how a reconstruction does on them."""
        cameras, bends = solution.cameras(), solution.distortion()
        fits, total = 0, 0
        for (i, j), rows in self.pairs.items():
            if i in cameras and j in cameras and same_side(cameras[i], cameras[j]):
                off = epipolar_distance(self._photos, (i, j), rows, cameras, bends)
                fits, total = (
                    fits + int((off < match_tolerance(cameras[i].width, cameras[i].height)).sum()),
                    total + len(rows),
                )
        on_object = np.zeros(len(solution.points), bool)
        for photo in np.unique(solution.seen_by):
            mine = solution.seen_by == photo
            on_object[solution.seen[mine][self._inside[photo][solution.feature[mine]]]] = True
        errors = solution.errors[on_object]
        explained, error = fits / total if total else 0.0, float(errors.mean()) if len(errors) else 0.0
        points, angle = int(on_object.sum()), _angle(solution, on_object)
        return ObjectFit(len(cameras), explained, points, error, angle)


def unexplained(photos: Sequence[Features], matches: Matches, solution: Solution) -> Matches:
    """Return the matches (M, 2) that do not fit the cameras, and all matches of photos without a camera."""
    cameras, bends = solution.cameras(), solution.distortion()
    left = {}
    for (i, j), rows in matches.items():
        if i in cameras and j in cameras and len(rows):
            off = epipolar_distance(photos, (i, j), rows, cameras, bends)
            rows = rows[off > match_tolerance(cameras[i].width, cameras[i].height)]
        left[i, j] = rows
    return left


def _fitting(a: Features, b: Features, rows: np.ndarray, seed: int) -> np.ndarray:
    """Return which matches fit a fundamental matrix, (M,) bool."""
    pycolmap = pycolmap_library()
    options = pycolmap.RANSACOptions()
    options.max_error, options.random_seed = match_tolerance(a.width, a.height), seed
    options.max_num_trials = _TRIALS
    points = (each.points[rows[:, k]].astype(np.float64) for k, each in enumerate((a, b)))
    found = pycolmap.estimate_fundamental_matrix(*points, options)
    return np.zeros(len(rows), bool) if found is None else np.asarray(found["inlier_mask"], bool)


def _angle(solution: Solution, chosen: np.ndarray) -> float:
    """Return the median over `chosen` points (P,) of the widest angle between their cameras, degrees."""
    place = {int(photo): pose[:3, 3] for photo, pose in zip(solution.photo, solution.pose, strict=True)}
    places = np.array([place[int(photo)] for photo in solution.seen_by]).reshape(-1, 3)
    rays = places - solution.points[solution.seen]
    rays /= np.maximum(np.linalg.norm(rays, axis=1, keepdims=True), 1e-12)
    order = np.argsort(solution.seen, kind="stable")
    starts = np.searchsorted(solution.seen[order], np.arange(len(solution.points) + 1))
    widest = []
    for point in np.flatnonzero(chosen)[:2000]:
        mine = rays[order[starts[point] : starts[point + 1]]]
        widest.append(np.degrees(np.arccos(np.clip((mine @ mine.T).min(), -1, 1))))
    return float(np.median(widest)) if widest else 0.0
