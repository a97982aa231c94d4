"""Points followed through all photos that show them: the patch around each, aligned with its best view.

Detected features lie a pixel or two beside what they mark, and a feature is seldom found in more than three photos:
cameras around an object then bend like a chain. Here a point's patch in its best view, the one that looks along the
middle of all rays to it, is looked for in every photo whose camera sees it from a similar side: put where the cameras
say, stretched as its neighbours are, and moved by Gauss-Newton steps (Lucas & Kanade 1981; Baker & Matthews 2004).
Contrast and brightness of a patch do not count, as each photo has another light. Points found so in ten photos hold
all cameras together; and a camera that is wrong sees hardly any of its points where it should.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy

from lightprobe.core.threads import in_threads
from lightprobe.preparation.features import opencv_library
from lightprobe.preparation.mapping import Solution, bent
from lightprobe.scene.camera import Camera

RIGHT = 0.12  # share of the points shown where they should be: wrong cameras have .03, right ones .2 to .8
AGREEING = 0.5  # of the views whose points a photo should show: a camera that shows no more's may be wrong
_TELLING = 15  # points of a view that a photo should show, from which they tell something
_HALF = 6  # pixels from the middle of a patch to its edge
_BLUR = 0.8  # pixels: what is finer is noise
_STEPS = 8
_ALIKE = 0.8  # correlation of patches from which they show the same
_WIDEST = 50.0  # degrees between the rays of the best view and another that may show the point
_SAME_SIDE = 35.0  # degrees within which a view should show it
_NEIGHBOURS = 9  # points nearby, itself among them, that tell how a patch is stretched
_NEAR = 40.0  # pixels over which these count less
_STIFF = 5.0  # squared pixels: so much a patch resists being stretched
_AREA = (0.1, 8.0)  # of a patch over its best view's, between which it shows enough
_RIM = 8.0  # pixels from the frame's edge


@dataclass(frozen=True)
class Tracks:
    """Where T patches of a solution's points were found."""

    photo: np.ndarray  # (T,) int
    point: np.ndarray  # (T,) int
    place: np.ndarray  # (T, 2) float64 pixels
    share: dict[int, float]  # by photo: of the points that it should show, those that it shows
    agreement: dict[
        int, float
    ]  # by photo: of the views whose points it should show, those of which it shows some


class _View:
    """A photo with its camera and where this sees the points."""

    def __init__(self, picture: np.ndarray, camera: Camera, k: float, points: np.ndarray):
        cv2 = opencv_library()
        self.grey = cv2.GaussianBlur(picture.astype(np.float32), (0, 0), _BLUR)
        self.slopes = [cv2.Sobel(self.grey, cv2.CV_32F, *axis, ksize=3) / 8 for axis in ((1, 0), (0, 1))]
        x, y, depth = camera.project(points).T
        self.place = bent(np.stack([x, y], 1), camera, k)
        self.ray = points - camera.position
        self.ray /= np.maximum(np.linalg.norm(self.ray, axis=1, keepdims=True), 1e-12)
        height, width = picture.shape
        inside = (self.place >= _RIM) & (self.place <= [width - _RIM, height - _RIM])
        self.shown = (depth > 0) & inside.all(1)


def followed(
    solution: Solution, pictures: Sequence[np.ndarray], farthest: float, only: int | None = None
) -> Tracks:
    """Return the tracks of a solution's points through its photos.

    pictures: (H, W) uint8 of even contrast, by the index of the photo. farthest: pixels that a patch may lie
    beside the place that the cameras say. only: the photo that is looked at; all of them by default.
    """
    bends, points = solution.distortion(), solution.points
    views = {i: _View(pictures[i], each, bends[i], points) for i, each in solution.cameras().items()}
    best = _best_views(solution)
    first = solution.seen_by[best]
    at, towards = np.zeros((len(points), 2)), np.zeros((len(points), 3))
    neighbours = {}
    for index in np.unique(first).tolist():
        own = first == index
        at[own], towards[own] = views[index].place[own], views[index].ray[own]
        seen = np.unique(solution.seen[solution.seen_by == index])
        if len(seen) > _NEIGHBOURS:
            neighbours[index] = seen, scipy.spatial.cKDTree(views[index].place[seen])
    widest, side = np.cos(np.radians([_WIDEST, _SAME_SIDE]))
    cosine = {index: (view.ray * towards).sum(1) for index, view in views.items()}
    work = [
        (index, other, np.flatnonzero(view.shown & (cosine[index] > widest) & (first == other)))
        for index, view in views.items()
        for other in neighbours
        if other != index and only in (None, index)
    ]

    def found(task: tuple[int, int, np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
        index, other, wanted = task
        if not len(wanted):
            return wanted, np.zeros((0, 2))
        seen, tree = neighbours[other]
        stretch = _stretches(
            wanted, seen[tree.query(at[wanted], k=_NEIGHBOURS)[1]], views[other], views[index], points
        )
        area = np.linalg.det(stretch)
        fine = (area > _AREA[0]) & (area < _AREA[1])
        wanted, stretch = wanted[fine], stretch[fine]
        start = views[index].place[wanted]
        place, alike = _align(views[other], at[wanted], views[index], start, stretch)
        good = (alike > _ALIKE) & (np.linalg.norm(place - start, axis=1) < farthest)
        return wanted[good], place[good]

    results = in_threads(found, work)
    counts: dict[int, list[tuple[int, int]]] = {index: [] for index in views}
    for (index, other, _), (wanted, _) in zip(work, results, strict=True):
        should = int((views[index].shown & (cosine[index] > side) & (first == other)).sum())
        counts[index].append((int((cosine[index][wanted] > side).sum()), should))
    photo = [first, *(np.full(len(wanted), task[0]) for task, (wanted, _) in zip(work, results, strict=True))]
    point = [np.arange(len(points)), *(wanted for wanted, _ in results)]
    place = [at, *(place for _, place in results)]
    share = {
        index: sum(a for a, _ in some) / max(sum(b for _, b in some), 1) for index, some in counts.items()
    }
    agreement = {}
    for index, some in counts.items():
        told = [a >= RIGHT * b for a, b in some if b >= _TELLING]
        agreement[index] = float(np.mean(told)) if told else 1.0
    return Tracks(np.concatenate(photo), np.concatenate(point), np.concatenate(place), share, agreement)


def _best_views(solution: Solution) -> np.ndarray:
    """Return for each point the row of the view that looks along the middle of all its rays, (P,) int."""
    position = {int(photo): pose[:3, 3] for photo, pose in zip(solution.photo, solution.pose, strict=True)}
    rays = np.array([position[int(photo)] for photo in solution.seen_by]).reshape(-1, 3)
    rays = rays - solution.points[solution.seen]
    rays /= np.maximum(np.linalg.norm(rays, axis=1, keepdims=True), 1e-12)
    middle = np.zeros_like(solution.points)
    np.add.at(middle, solution.seen, rays)
    order = np.argsort((rays * middle[solution.seen]).sum(1), kind="stable")
    best = np.zeros(len(solution.points), int)
    best[solution.seen[order]] = order  # the last one written is the nearest to the middle
    return best


def _stretches(
    wanted: np.ndarray, near: np.ndarray, before: _View, after: _View, points: np.ndarray
) -> np.ndarray:
    """Return how the patches of `wanted` points (M,) are stretched from view to view, (M, 2, 2).

    near: (M, K) points that lie nearby in the first view; those at another depth count less.
    """
    a = before.place[near] - before.place[wanted][:, None]
    b = after.place[near] - after.place[wanted][:, None]
    depth = np.linalg.norm(points[near] - points[wanted][:, None], axis=2)
    usual = np.median(depth, axis=1, keepdims=True) + 1e-12
    weight = (np.exp(-(a**2).sum(2) / _NEAR**2) + 1e-3) * np.exp(-((depth / (2 * usual)) ** 2))
    stiff = _STIFF * np.eye(2)
    normal = np.einsum("mki,mk,mkj->mij", a, weight, a) + stiff
    told = np.einsum("mki,mk,mkj->mij", a, weight, b) + stiff
    return np.linalg.solve(normal, told).transpose(0, 2, 1)


def _align(
    first: _View, there: np.ndarray, second: _View, here: np.ndarray, stretch: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return where patches around `there` (M, 2) of one view lie in another, (M, 2), and how alike, (M,).

    here: (M, 2), where they are looked for first. stretch: (M, 2, 2).
    """
    span = np.arange(-_HALF, _HALF + 1, dtype=np.float64)
    grid = np.stack(np.meshgrid(span, span), -1).reshape(-1, 2)
    wanted, _ = _even(_sampled(first.grey, there[:, None] + grid))
    offset = np.einsum("mij,qj->mqi", stretch, grid)
    place = here.copy()
    for _ in range(_STEPS):
        shown, contrast = _even(_sampled(second.grey, place[:, None] + offset))
        error = shown - wanted
        along = [_sampled(slope, place[:, None] + offset) / contrast for slope in second.slopes]
        x, y = (each - each.mean(1, keepdims=True) for each in along)
        xx, xy, yy = (x * x).sum(1) + 1e-6, (x * y).sum(1), (y * y).sum(1) + 1e-6
        ex, ey = (x * error).sum(1), (y * error).sum(1)
        step = np.stack([yy * ex - xy * ey, xx * ey - xy * ex], 1) / (xx * yy - xy * xy + 1e-12)[:, None]
        place -= np.clip(step, -1, 1)
    shown, _ = _even(_sampled(second.grey, place[:, None] + offset))
    return place, (shown * wanted).sum(1)


def _sampled(picture: np.ndarray, places: np.ndarray) -> np.ndarray:
    """Return a picture (H, W) at places (M, Q, 2) in pixels, (M, Q)."""
    cv2 = opencv_library()
    x, y = ((places[..., axis] - 0.5).astype(np.float32) for axis in (0, 1))
    # remap takes fewer than 2^15 rows and columns
    step = 32_000
    if not len(x):
        return x
    parts = [
        cv2.remap(picture, x[i : i + step], y[i : i + step], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REFLECT)
        for i in range(0, len(x), step)
    ]
    return np.concatenate(parts)


def _even(patches: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return patches (M, Q) of mean 0 and length 1, and the lengths (M, 1) that they had."""
    shifted = patches - patches.mean(1, keepdims=True)
    length = np.linalg.norm(shifted, axis=1, keepdims=True) + 1e-3
    return shifted / length, length
