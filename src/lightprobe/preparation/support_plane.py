"""The plane on which the object stands in each place, and what it looks like there.

In one place everything stands still: light, shadows and what the object stands on. A pixel that shows the plane
therefore has the colour that the other photos of the place have at the same point of the plane; a pixel that has
another colour shows something above it. In most shoots the object stands the same way up everywhere; then the
planes of all places are one in the object's frame, and a place with a bare table takes that of the others.

    plane: normal . x = offset; height = normal . x - offset, positive on the object's side, in the cameras' unit
"""

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from lightprobe.preparation.features import opencv_library
from lightprobe.preparation.mapping import Solution
from lightprobe.scene.camera import Camera

_NEAR = 3.0  # radii around the object's points within which its support shows
_THIN = 0.015  # of the object's radius: distance from a plane up to which a point lies on it
_ON = 0.02  # of the object's radius: height up to which a point is taken for the plane's
_FEWEST = 10  # points that make a plane: three fit any
_TRIALS = 2000  # of three points: enough where one point in seven lies on the plane
_BELOW = 0.05  # share of the object's points and of the cameras that may lie beneath: errors
_UNDER = 0.5  # radii of the object's points between a plane and the lowest of them, at most
_SAME = 0.5  # share of a plane's own points from which another plane explains them as well
_CELLS = 320  # along an edge of the plane's picture: as fine as the photos
_REACH = 2.2  # radii around the object's middle that the plane's picture shows
_GAMMA = 2.2  # of sRGB, near enough to compare exposures
_CLIPPED = 0.96  # of white: what is brighter may be any brighter light
_LEAST_DEVIATION = 4.0  # of 8-bit CIELAB: noise and interpolation
_SEVERAL = 3  # photos that must show a point of the plane


@dataclass(frozen=True)
class SupportPlane:
    """A plane with the object on its positive side."""

    normal: np.ndarray  # (3,) float64, unit length
    offset: float

    def height(self, points: np.ndarray) -> np.ndarray:
        """Return how far above the plane `points` (..., 3) lie, (...) float64."""
        return points @ self.normal - self.offset

    def mapped(self, rotation: np.ndarray, scale: float) -> "SupportPlane":
        """Return the plane with the world turned by `rotation` (3, 3), then scaled."""
        return SupportPlane(rotation @ self.normal, scale * self.offset)


def common_plane(solution: Solution, on_object: np.ndarray, seed: int = 0) -> SupportPlane | None:
    """Return the plane that the object stands on by the points of all photos together, None where none is found.

    on_object (P,) bool, as for `find_planes`.
    """
    chosen = solution.points[on_object]
    if len(chosen) < _FEWEST:
        return None
    near, radius = _around(solution, chosen)
    rng = np.random.default_rng(seed)
    found = _fit(solution.points[near], chosen, solution.pose[:, :3, 3], radius, rng)
    return None if found is None else found[0]


def _around(solution: Solution, chosen: np.ndarray) -> tuple[np.ndarray, float]:
    """Return which points lie around those `chosen` (K, 3), (P,) bool, and the radius of these."""
    center = np.median(chosen, axis=0)
    radius = float(np.quantile(np.linalg.norm(chosen - center, axis=1), 0.9))
    return np.linalg.norm(solution.points - center, axis=1) < _NEAR * radius, radius


def find_planes(
    solution: Solution, places: Mapping[int, int], on_object: np.ndarray, seed: int = 0
) -> dict[int, SupportPlane]:
    """Return the support plane by place; none for a place where no plane is found.

    places: by photo. on_object (P,) bool: points that are thought to lie on the object; some on the support do no
    harm.
    """
    chosen = solution.points[on_object]
    if len(chosen) < _FEWEST:
        return {}
    near, radius = _around(solution, chosen)
    of_photo = np.array([places.get(int(photo), -1) for photo in solution.seen_by])
    which = sorted(set(places.values()))
    mine = {place: near & _seen(solution, of_photo == place) for place in which}
    stands = np.array([places.get(int(photo), -1) for photo in solution.photo])
    eyes = {place: solution.pose[stands == place, :3, 3] for place in which}
    rng = np.random.default_rng(seed)

    def fit(points: np.ndarray, eyes: np.ndarray) -> tuple[SupportPlane, int] | None:
        return _fit(points, chosen, eyes, radius, rng)

    shared = fit(solution.points[near], solution.pose[:, :3, 3])
    planes = {}
    for place in which:
        points = solution.points[mine[place]]
        own = fit(points, eyes[place])
        if own is not None and shared is not None:
            held = (np.abs(shared[0].height(points)) < _THIN * radius).sum()
            if held >= _SAME * own[1]:  # the object stands in this place as in the others
                own = shared
        found = own or shared
        if found is not None:
            planes[place] = found[0]
    return planes


def shared_points(solution: Solution, places: Mapping[int, int]) -> np.ndarray:
    """Return which points photos of two places or more saw, (P,) bool: the object alone is in several places.

    places: by photo.
    """
    pairs = np.stack([solution.seen, [places.get(int(photo), -1) for photo in solution.seen_by]])
    seen, place = np.unique(pairs, axis=1)
    return np.bincount(seen[place >= 0], minlength=len(solution.points)) >= 2


def above_planes(solution: Solution, labels: np.ndarray, planes: Mapping[int, SupportPlane]) -> np.ndarray:
    """Return the `labels` (P,) int8 of points, as from `masks.object_points`, with those on a plane off the object."""
    points, found = solution.points, labels.copy()
    on_object = points[labels == 1]
    if not len(on_object):
        return found
    radius = np.quantile(np.linalg.norm(on_object - np.median(on_object, axis=0), axis=1), 0.9)
    for plane in planes.values():
        found[(labels == 1) & (plane.height(points) < _ON * radius)] = -1
    return found


def _seen(solution: Solution, chosen: np.ndarray) -> np.ndarray:
    flags = np.zeros(len(solution.points), bool)
    flags[solution.seen[chosen]] = True
    return flags


def _fit(
    points: np.ndarray, on_object: np.ndarray, eyes: np.ndarray, radius: float, rng: np.random.Generator
) -> tuple[SupportPlane, int] | None:
    """Return the plane that most `points` (K, 3) lie on, with object and cameras above it, and their number."""
    if len(points) < _FEWEST:
        return None
    thin, best, most = _THIN * radius, None, 0.0
    for _ in range(_TRIALS):
        plane = _through(points[rng.choice(len(points), 3, replace=False)], eyes)
        if plane is None:
            continue
        off = np.abs(plane.height(points))
        score = np.maximum(1 - (off / thin) ** 2, 0).sum()  # MSAC: nearer points count more
        if score > most and _beneath(plane, on_object, eyes, radius):
            best, most = plane, score
    if best is None:
        return None
    for _ in range(5):
        inliers = points[np.abs(best.height(points)) < thin]
        if len(inliers) < _FEWEST:
            return None
        middle = inliers.mean(axis=0)
        normal = np.linalg.svd(inliers - middle, full_matrices=False)[2][2]
        normal = normal if normal @ best.normal > 0 else -normal
        best = SupportPlane(normal, float(normal @ middle))
    return best, len(inliers)


def _through(three: np.ndarray, eyes: np.ndarray) -> SupportPlane | None:
    normal = np.cross(three[1] - three[0], three[2] - three[0])
    length = float(np.linalg.norm(normal))
    if length < 1e-12:
        return None
    plane = SupportPlane(normal / length, float(normal @ three[0] / length))
    up = np.median(plane.height(eyes)) > 0
    return plane if up else SupportPlane(-plane.normal, -plane.offset)


def _beneath(plane: SupportPlane, on_object: np.ndarray, eyes: np.ndarray, radius: float) -> bool:
    heights = plane.height(on_object)
    return bool(
        (heights < -2 * _THIN * radius).mean() <= _BELOW
        and (plane.height(eyes) < 0).mean() <= _BELOW
        and np.quantile(heights, _BELOW) < _UNDER * radius
        and np.quantile(heights, 0.9) > _UNDER * radius  # not a face that the object's points lie on
    )


@dataclass(frozen=True)
class PlaneChart:
    """Coordinates on a plane: cell (row, column) shows origin + column across + row along."""

    origin: np.ndarray  # (3,)
    across: np.ndarray  # (3,)
    along: np.ndarray  # (3,)

    @staticmethod
    def around(plane: SupportPlane, center: np.ndarray, reach: float, cells: int) -> "PlaneChart":
        """Return the chart of so many `cells` along an edge that reaches so far around a point (3,)."""
        across = np.cross(plane.normal, np.eye(3)[np.abs(plane.normal).argmin()])
        across /= np.linalg.norm(across)
        along = np.cross(plane.normal, across)
        cell = 2 * reach / cells
        foot = center - plane.height(center) * plane.normal
        return PlaneChart(foot - reach * (across + along), cell * across, cell * along)

    def to_pixels(self, camera: Camera) -> np.ndarray:
        """Return the homography (3, 3) from cells to pixels, both by their centres' indices."""
        right, up, back = camera.camera_to_world[:3, :3].T
        rows = np.stack(
            [
                camera.fx * right - (camera.cx - 0.5) * back,
                -camera.fy * up - (camera.cy - 0.5) * back,
                -back,
            ]
        )
        return rows @ np.stack([self.across, self.along, self.origin - camera.position], axis=1)


@dataclass(frozen=True)
class Expected:
    """What a photo would show if nothing stood on the plane."""

    low: np.ndarray  # (h, w, 3) float32, 8-bit CIELAB, least of the neighbouring pixels
    high: np.ndarray  # (h, w, 3) float32, largest
    deviation: np.ndarray  # (h, w) float32, of the colours of the place's photos there
    known: np.ndarray  # (h, w) bool, where the plane is known to look like this

    def off(self, lab: np.ndarray) -> np.ndarray:
        """Return how far a photo's colours, (h, w, 3) float32, are from the expected ones, (h, w) float32."""
        beyond = np.maximum(np.maximum(self.low - lab, lab - self.high), 0)
        return np.sqrt((beyond * beyond).sum(-1))


def expected_pictures(
    plane: SupportPlane,
    cameras: Sequence[Camera],
    colors: Sequence[np.ndarray],
    hidden: Sequence[np.ndarray],
    beside: Sequence[np.ndarray],
    center: np.ndarray,
    radius: float,
) -> list[Expected] | None:
    """Return what each photo of one place would show of the plane alone, None for too few photos.

    colors: (h, w, 3) uint8 sRGB. hidden: pixels (h, w) bool that show the object and not the plane. beside: pixels
    (h, w) bool that surely do not show the object; exposures are compared there. center (3,), radius: of the
    object.
    """
    cv2 = opencv_library()
    if len(cameras) < _SEVERAL:
        return None
    chart = PlaneChart.around(plane, center, _REACH * radius, _CELLS)
    maps = [chart.to_pixels(camera) for camera in cameras]
    size, back = (_CELLS, _CELLS), cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    light, valid, sure = [], [], []
    for matrix, color, behind, outside in zip(maps, colors, hidden, beside, strict=True):
        linear = (color.astype(np.float32) / 255) ** _GAMMA
        shown = (~behind).astype(np.float32)
        light.append(cv2.warpPerspective(linear, matrix, size, flags=back))
        weight = cv2.warpPerspective(shown, matrix, size, flags=back)
        apart = cv2.warpPerspective(outside.astype(np.float32), matrix, size, flags=back)
        valid.append((weight > 0.99) & (light[-1].max(-1) < _CLIPPED))
        sure.append(apart > 0.99)
    gains = _gains(light, valid, sure)
    stack = np.stack([each / gain for each, gain in zip(light, gains, strict=True)])
    stack[~np.stack(valid)] = np.nan
    count = np.stack(valid).sum(0)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # cells that no photo shows have no median
        middle = np.nanmedian(stack, axis=0)
        lightness = 255 * np.clip(stack * gains.mean(0), 0, 1).mean(-1) ** (1 / _GAMMA)
        spread = 1.48 * np.nanmedian(np.abs(lightness - np.nanmedian(lightness, axis=0)), axis=0)
    good = (count >= _SEVERAL) & np.isfinite(middle).all(-1)
    middle = np.where(good[..., None], middle, 0).astype(np.float32)
    spread = np.where(good, spread, 0).astype(np.float32)
    found = []
    for matrix, color, gain, outside in zip(maps, colors, gains, beside, strict=True):
        shape = color.shape[1::-1]
        flat = cv2.warpPerspective(middle * gain.astype(np.float32), matrix, shape, flags=cv2.INTER_LINEAR)
        known = cv2.warpPerspective(good.astype(np.float32), matrix, shape, flags=cv2.INTER_LINEAR) > 0.99
        noise = cv2.warpPerspective(spread, matrix, shape, flags=cv2.INTER_LINEAR)
        picture = (255 * np.clip(flat, 0, 1) ** (1 / _GAMMA) + 0.5).astype(np.uint8)
        lab = cv2.cvtColor(picture, cv2.COLOR_RGB2LAB).astype(np.float32)
        around = np.ones((3, 3), np.uint8)  # a pixel to either side, for cameras that err
        expected = Expected(cv2.erode(lab, around), cv2.dilate(lab, around), noise, known)
        own = cv2.cvtColor(color, cv2.COLOR_RGB2LAB).astype(np.float32)
        there = known & outside
        usual = 1.48 * float(np.median(expected.off(own)[there])) if there.any() else np.inf
        deviation = np.sqrt(max(usual, _LEAST_DEVIATION) ** 2 + noise**2).astype(np.float32)
        found.append(Expected(expected.low, expected.high, deviation, known))
    return found


def _gains(
    light: Sequence[np.ndarray], valid: Sequence[np.ndarray], sure: Sequence[np.ndarray]
) -> np.ndarray:
    """Return how much brighter than their mean each photo (n, n, 3) shows the plane, (K, 3) float64."""
    logs = np.log(np.stack(light) + 1e-3)
    usable = np.stack(valid) & np.stack(sure)
    count = len(light)
    rows, right = [], []
    for i in range(count):
        for j in range(i + 1, count):
            both = usable[i] & usable[j]
            if both.sum() >= 50:  # cells, so that their median means something
                row = np.zeros(count)
                row[i], row[j] = 1, -1
                rows.append(row)
                right.append(np.median((logs[i] - logs[j])[both], axis=0))
    if not rows:
        return np.ones((count, 3))
    rows.append(np.full(count, 1e-3))
    right.append(np.zeros(3))
    return np.exp(np.linalg.lstsq(np.array(rows), np.array(right), rcond=None)[0])
