"""Which photos were taken in one place: what the object stands on looks alike in them, and is lit alike.

In one place nothing moves, so that all its photos show one pattern at one point of the support plane, in one light:
shadows and all. Two places whose tables have one pattern differ in their light. Of two photos with known cameras the
plane is drawn as seen from above; alike are two drawings whose fine structure correlates and whose brightness
differs by a factor that is the same everywhere.
"""

from collections.abc import Mapping, Sequence

import numpy as np

from lightprobe.preparation.features import opencv_library
from lightprobe.preparation.mapping import Solution, bent
from lightprobe.preparation.support_plane import PlaneChart
from lightprobe.scene.support import SupportPlane

_CELLS = 128  # along an edge of a drawing
_REACH = 2.5  # of the object's radius: from the drawing's middle to its edge
_BALL = 1.05  # of the object's radius around its middle: what may hide the plane
_FINE = 5.0  # cells: what is finer is structure, what is coarser is light
_NOISE = 2.0  # 8-bit deviation below which structure is noise
_ENOUGH = 600  # cells that both photos must show
_CLIPPED = 250  # 8-bit: brighter may be any brighter light
_STOPS = 8 / 255  # stops of an 8-bit step of the pictures, which are logarithms
_MIDDLE = (0.1, 0.9)  # quantiles between which the brightness' factor is looked at
_LIGHT = 0.15  # correlation that one stop between these is worth
_MOST = 3.0  # stops that count
_ALIKE = (
    0.15  # correlation, less what the light costs, from which two photos are rather of one place than not
)


def same_place(
    solution: Solution,
    pictures: Sequence[np.ndarray],
    plane: SupportPlane,
    on_object: np.ndarray,
) -> dict[int, int]:
    """Return the place of each photo that has a camera, numbered from 0 in the photos' order.

    pictures: (H, W) uint8 of even contrast, by the index of the photo. plane: what the object stands on, the same in
    its frame in all places. on_object (P,) bool: points on the object. Photos are in the order in which they were
    taken, as their names have it, where neighbours are alike.
    """
    photos = [int(photo) for photo in solution.photo]
    likeness = _likeness(solution, pictures, plane, solution.points[on_object])
    beside = np.diagonal(likeness, 1)
    groups = _runs(likeness) if len(beside) and np.median(beside) > 0 else _clusters(likeness)
    numbers: dict[int, int] = {}
    return {
        photo: numbers.setdefault(int(group), len(numbers))
        for photo, group in zip(photos, groups, strict=True)
    }


def _likeness(
    solution: Solution, pictures: Sequence[np.ndarray], plane: SupportPlane, points: np.ndarray
) -> np.ndarray:
    """Return how much rather two photos are of one place than of two, (K, K), 0 where nothing tells."""
    drawings = _drawings(solution, pictures, plane, points)
    count = len(drawings)
    found = np.zeros((count, count))
    for i in range(count):
        for j in range(i):
            (a, coarse_a, shown_a), (b, coarse_b, shown_b) = drawings[i], drawings[j]
            shown = shown_a & shown_b
            if shown.sum() < _ENOUGH:
                continue
            x, y = a[shown], b[shown]
            correlation = (x * y).sum() / np.sqrt((x * x).sum() * (y * y).sum() + 1e-9)
            low, high = np.quantile((coarse_a - coarse_b)[shown], _MIDDLE)
            found[i, j] = found[j, i] = correlation - _LIGHT * min(high - low, _MOST) - _ALIKE
    return found


def _drawings(
    solution: Solution, pictures: Sequence[np.ndarray], plane: SupportPlane, points: np.ndarray
) -> list[tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """Return structure, brightness in stops and what is shown, (S, S) each, of the plane in each photo."""
    cv2 = opencv_library()
    middle = (np.quantile(points, 0.02, axis=0) + np.quantile(points, 0.98, axis=0)) / 2
    radius = float(np.quantile(np.linalg.norm(points - middle, axis=1), 0.95))
    chart = PlaneChart.around(plane, middle, _REACH * radius, _CELLS)
    row, column = np.mgrid[:_CELLS, :_CELLS].reshape(2, -1, 1) + 0.5
    places = chart.origin + column * chart.across + row * chart.along

    def smooth(values: np.ndarray) -> np.ndarray:
        return cv2.GaussianBlur(values, (0, 0), _FINE)

    bends, found = solution.distortion(), []
    for index, camera in solution.cameras().items():
        picture = cv2.GaussianBlur(pictures[index], (0, 0), 1.0).astype(np.float32)
        x, y, depth = camera.project(places).T
        at = bent(np.stack([x, y], 1), camera, bends[index])
        height, width = picture.shape
        shown = (depth > 0) & (at >= 2).all(1) & (at <= [width - 2, height - 2]).all(1)
        ray = places - camera.position
        length = np.linalg.norm(ray, axis=1)
        along = ray @ (middle - camera.position) / length
        past = np.sqrt(np.maximum(((middle - camera.position) ** 2).sum() - along**2, 0))
        shown &= (past > _BALL * radius) | (along > length)
        at = (at - 0.5).astype(np.float32).reshape(_CELLS, _CELLS, 2)
        drawn = cv2.remap(picture, at[..., 0], at[..., 1], cv2.INTER_LINEAR)
        weight = shown.reshape(_CELLS, _CELLS).astype(np.float32)
        total = np.maximum(smooth(weight), 1e-3)
        coarse = smooth(drawn * weight) / total
        fine = (drawn - coarse) * weight
        fine /= np.sqrt(smooth(fine * fine) / total) + _NOISE
        clear = (weight > 0) & (drawn < _CLIPPED)
        found.append((fine, coarse * _STOPS, clear))
    return found


def _runs(likeness: np.ndarray) -> np.ndarray:
    """Return the group (K,) of each photo, of photos that follow each other, by the greatest likeness within groups."""
    count = len(likeness)
    total = np.pad(likeness.cumsum(0).cumsum(1), ((1, 0), (1, 0)))
    best, start = np.zeros(count + 1), np.zeros(count + 1, int)
    for end in range(1, count + 1):
        first = np.arange(end)
        within = total[end, end] - total[first, end] - total[end, first] + total[first, first]
        worth = best[:end] + within / 2
        start[end] = int(np.argmax(worth))
        best[end] = worth[start[end]]
    group, end = np.zeros(count, int), count
    while end:
        group[start[end] : end] = start[end]
        end = start[end]
    return group


def _clusters(likeness: np.ndarray) -> np.ndarray:
    """Return the group (K,) of each photo: groups are joined, the most alike first, while they are alike at all."""
    group = np.arange(len(likeness))
    between = likeness.copy()
    np.fill_diagonal(between, -np.inf)
    while len(between) > 1:
        i, j = np.unravel_index(int(np.argmax(between)), between.shape)
        if not between[i, j] > 0:
            break
        group[group == j] = i
        between[i] += np.where(np.isfinite(between[j]), between[j], 0)
        between[:, i] = between[i]
        between[i, i] = between[i, j] = between[j, i] = -np.inf
        between[j], between[:, j] = -np.inf, -np.inf
    return group


def by_place(places: Mapping[int, int]) -> dict[int, list[int]]:
    """Return the photos of each place."""
    found: dict[int, list[int]] = {}
    for photo, place in places.items():
        found.setdefault(place, []).append(photo)
    return found
