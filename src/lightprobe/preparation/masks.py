"""Masks of all photos from their cameras, the sparse points, and a hint in one photo or none.

First the points are told apart: points of the object mark the object in every photo, as none shows beside it;
points of the background mark the photos that see them. Graph cuts between these marks give first masks. Then
the masks carve a visual hull, which says where in each photo the others have the object, and every photo is
cut anew near the hull's outline, closer in each round.

All pictures are as through a pinhole; masks (h, w) bool have the pictures' size.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import scipy

from lightprobe.core.errors import InputError
from lightprobe.preparation.cutting import BACKGROUND, MAYBE_BACKGROUND, MAYBE_OBJECT, OBJECT, cut, masks_of
from lightprobe.preparation.mapping import Solution
from lightprobe.scene.camera import Camera, Similarity
from lightprobe.scene.consistency import fitted_hull, overlap, silhouette
from lightprobe.scene.hull import Hull
from lightprobe.scene.normalise import find_similarity

MARGINS = (0.08, 0.05, 0.03)  # of the object's size: how far from the hull's outline each round looks
# Of the photos, for the hull of the first cuts and of each round: first cuts lose parts that few points mark,
# such as a raised arm, and a strict hull would lose them in all photos.
AGREEMENTS = (0.7, 0.8, 0.9, 0.9)
_MANY = 10  # photos from which a part of them may err
_RESOLUTION = 96  # voxels along an edge of the hull
_DOT = 0.012  # of the longer side: radius around a point that has its label
_REACH = 1.35  # radii of the object's points within which it may reach
_BALL = 0.8  # of the ball that most photos show whole, where nothing tells what the object is
NEAR_PHOTOS = 2  # near a photo, whose points mark the object in it beside the photo's own points
FEWEST = 12  # points from which the object's place is known
SHARP_POINT = 2.0  # pixels of mean error up to which a point is trusted


@dataclass(frozen=True)
class View:
    """One photo to cut."""

    camera: Camera  # of the small picture
    color: np.ndarray  # (h, w, 3) uint8 sRGB
    given: np.ndarray | None  # (h, w) bool: the mask where it is known
    fixed: bool  # the given mask stays as it is; otherwise it is a hint like any other


@dataclass(frozen=True)
class Cutout:
    """Masks and what the hull says to them."""

    masks: dict[int, np.ndarray]  # (h, w) bool by photo
    agreement: dict[int, float]  # IoU of mask and hull
    similarity: Similarity | None
    hull: Hull | None


def object_points(solution: Solution, views: Mapping[int, View], everything: bool) -> np.ndarray:
    """Return +1 for points on the object, -1 for points off it, 0 for unknown ones, (P,) int8.

    everything: all points belong to the object, as in what moves before a still background. With masks given,
    what shows outside of one is off the object; without, the object is what the cameras look at. Raises
    `InputError` where no point is left for the object.
    """
    sharp = solution.errors <= SHARP_POINT
    hinted = {index: view for index, view in views.items() if view.given is not None}
    inside = np.zeros(len(solution.points), int)
    outside, framed = np.zeros((2, len(solution.points)), bool)
    for view in hinted.values():
        visible, shown = _at(view.camera, view.given, solution.points)
        inside += visible & shown
        outside |= visible & ~_at(view.camera, _grown(view.given), solution.points)[1]  # the rim is inside
        framed |= visible
    candidate = sharp & ~outside & ((inside > 0) | ~framed)
    cropped = any(_cropped(view.given) for view in hinted.values() if view.given is not None)
    least = 0.0
    if not everything and (cropped or not hinted):  # a close-up tells what is off the object, not its end
        center, radius = _looked_at(views)
        least = max((_shown_radius(view, center) for view in hinted.values()), default=0.0)
        candidate &= np.linalg.norm(solution.points - center, axis=1) < max(radius, least)
    elif not everything:
        candidate &= _seen_inside(solution, hinted, candidate & (inside > 0))
    if candidate.sum() < FEWEST:
        raise InputError(
            "No points of the object were found: give a mask or a box of it in one photo that shows it well, "
            "with --hint PHOTO=MASK.png or --hint PHOTO=x0,y0,x1,y1."
        )
    return _within_reach(solution.points, candidate, outside, everything, least)


def _seen_inside(solution: Solution, hinted: Mapping[int, View], shown: np.ndarray) -> np.ndarray:
    """Return which points lie near those `shown` in a mask that its photo itself saw, (P,) bool both.

    Others merely lie behind or before the object in that photo.
    """
    own = seen_by(solution, list(hinted)) & shown
    if own.sum() < FEWEST:
        return shown
    center = np.median(solution.points[own], axis=0)
    radius = np.quantile(np.linalg.norm(solution.points[own] - center, axis=1), 0.9)
    return np.linalg.norm(solution.points - center, axis=1) < 2 * radius  # the back is behind what it saw


def _cropped(mask: np.ndarray) -> bool:
    """Tell whether a mask (h, w) bool ends at the border of its photo."""
    return bool(mask[0].any() or mask[-1].any() or mask[:, 0].any() or mask[:, -1].any())


def _grown(mask: np.ndarray | None) -> np.ndarray | None:
    """Return a mask (h, w) bool with what lies as near to it as a point's mark reaches."""
    if mask is None or not mask.any():
        return mask
    return scipy.ndimage.distance_transform_edt(~mask) < _DOT * max(mask.shape)


def _shown_radius(view: View, center: np.ndarray) -> float:
    """Return how far from `center` (3,) the hint's mask reaches, at the depth of the center."""
    if view.given is None:
        return 0.0
    x, y, depth = view.camera.project(center[None])[0]
    rows, columns = np.nonzero(view.given)
    if depth <= 0 or not len(rows):
        return 0.0
    return float(np.hypot(columns + 0.5 - x, rows + 0.5 - y).max() * depth / view.camera.fx)


def _within_reach(
    points: np.ndarray, candidate: np.ndarray, outside: np.ndarray, everything: bool, least: float
) -> np.ndarray:
    """Return labels (P,) int8: candidates in their own bulk are the object, what is far from it is not.

    least: radius of the bulk at least, which a hint shows.
    """
    center = np.median(points[candidate], axis=0)
    distance = np.linalg.norm(points - center, axis=1)
    radius = max(_REACH * np.quantile(distance[candidate], 0.9), least)
    labels = np.where(candidate & (distance < radius), 1, 0).astype(np.int8)
    if not everything:
        labels[(distance > _REACH * radius) | outside] = -1
    return labels


def _looked_at(views: Mapping[int, View]) -> tuple[np.ndarray, float]:
    """Return the point (3,) nearest to all optical axes, and the radius of the ball that photos show."""
    places = np.stack([view.camera.position for view in views.values()])
    axes = np.stack([-view.camera.camera_to_world[:3, 2] for view in views.values()])
    across = np.eye(3) - axes[:, :, None] * axes[:, None, :]
    center = np.linalg.lstsq(across.sum(0), (across @ places[:, :, None]).sum(0)[:, 0], rcond=None)[0]
    radii = []
    for view in views.values():
        camera = view.camera
        x, y, depth = camera.project(center[None])[0]
        if depth > 0:
            radii.append(min(x, camera.width - x, y, camera.height - y) * depth / camera.fx)
    return center, _BALL * max(float(np.median(radii)) if radii else 0.0, 0.0)


def _at(camera: Camera, mask: np.ndarray | None, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return which points (P, 3) lie in a camera's frame, and which show inside its mask, (P,) bool both."""
    visible, rows, columns = in_frame(camera, points)
    shown = np.zeros(len(points), bool)
    shown[visible] = False if mask is None else mask[rows, columns]
    return visible, shown


def in_frame(camera: Camera, points: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return which points (P, 3) a camera's frame has, (P,) bool, and the rows and columns (K,) of these."""
    x, y, depth = camera.project(points).T
    visible = (depth > 0) & (x >= 0) & (y >= 0) & (x < camera.width) & (y < camera.height)
    return visible, y[visible].astype(int), x[visible].astype(int)


def first_trimap(view: View, solution: Solution, labels: np.ndarray, photo: int) -> np.ndarray:
    """Return the trimap (h, w) uint8 of a photo by the points' labels (P,)."""
    camera = view.camera
    shape = (camera.height, camera.width)
    dot = dot_radius(shape)
    mine = seen_by(solution, [photo])
    sure = (labels == 1) & seen_by(solution, photos_from_near(solution, photo, solution.points[labels == 1]))
    near = away_from(camera, solution.points[sure if sure.sum() >= FEWEST else labels == 1])
    reach = _reach(camera, solution.points[labels == 1], shape)
    trimap = np.where(reach, MAYBE_BACKGROUND, BACKGROUND).astype(np.uint8)
    trimap[reach & (near < 5 * dot)] = MAYBE_OBJECT
    trimap[away_from(camera, solution.points[(labels == -1) & mine]) < dot] = BACKGROUND
    trimap[near < dot] = OBJECT
    return trimap


def seen_by(solution: Solution, photos: Sequence[int]) -> np.ndarray:
    """Return which points some of the photos saw, (P,) bool."""
    seen = np.zeros(len(solution.points), bool)
    seen[solution.seen[np.isin(solution.seen_by, photos)]] = True
    return seen


def photos_from_near(
    solution: Solution, photo: int, points: np.ndarray, others: int = NEAR_PHOTOS
) -> list[int]:
    """Return a photo and the `others` that look at `points` (P, 3) from nearly where it does.

    What these saw falls on the object in it, too: errors of cameras far apart put points beside it.
    """
    towards = solution.pose[:, :3, 3] - np.median(points, axis=0)
    towards /= np.maximum(np.linalg.norm(towards, axis=1, keepdims=True), 1e-12)
    alike = towards @ towards[list(solution.photo).index(photo)]
    return [int(other) for other in solution.photo[np.argsort(-alike, kind="stable")[: 1 + others]]]


def away_from(camera: Camera, points: np.ndarray) -> np.ndarray:
    """Return how far each pixel (h, w) is from the nearest that shows one of the points (P, 3), or inf."""
    _, rows, columns = in_frame(camera, points)
    free = np.ones((camera.height, camera.width), bool)
    free[rows, columns] = False
    return np.full(free.shape, np.inf) if free.all() else scipy.ndimage.distance_transform_edt(free)


def dot_radius(shape: tuple[int, ...]) -> float:
    """Return the radius in pixels around a point, in a picture (h, w), that has its label."""
    return max(1.0, _DOT * max(shape))


def _reach(camera: Camera, points: np.ndarray, shape: tuple[int, int]) -> np.ndarray:
    """Return where the object may show, (h, w) bool: within a ball around its points (P, 3)."""
    center = (np.quantile(points, 0.02, axis=0) + np.quantile(points, 0.98, axis=0)) / 2
    radius = _REACH * np.quantile(np.linalg.norm(points - center, axis=1), 0.98)
    x, y, depth = camera.project(center[None])[0]
    if depth <= radius:
        return np.ones(shape, bool)
    rows, columns = np.mgrid[: shape[0], : shape[1]] + 0.5
    return (columns - x) ** 2 + (rows - y) ** 2 < (camera.fx * radius / np.sqrt(depth**2 - radius**2)) ** 2


def cut_all(views: Mapping[int, View], solution: Solution, labels: np.ndarray) -> dict[int, np.ndarray]:
    """Return the first masks (h, w) bool by the points' labels (P,)."""

    def first(photo: int) -> np.ndarray:
        view = views[photo]
        if view.fixed and view.given is not None:
            return view.given
        return cut(view.color, first_trimap(view, solution, labels, photo))

    return masks_of(first, views)


def carve(
    views: Mapping[int, View], masks: Mapping[int, np.ndarray], agreement: float = AGREEMENTS[-1]
) -> Cutout:
    """Return the hull of the masks (h, w) bool and its agreement with each; no hull where they do not fit.

    agreement: share of the photos that see a place whose masks must hold it.
    """
    photos = [photo for photo in masks if masks[photo].any()]
    cameras = [views[photo].camera for photo in photos]
    alphas = [masks[photo].astype(np.float32) for photo in photos]
    try:
        similarity = find_similarity(cameras, alphas)
    except InputError:
        return Cutout(dict(masks), {}, None, None)
    strict = None if len(photos) < _MANY else agreement
    hull = fitted_hull(cameras, alphas, similarity, _RESOLUTION, agreement=strict)
    overlaps = {
        photo: overlap(mask, silhouette(hull, views[photo].camera, similarity, mask.shape))
        for photo, mask in masks.items()
    }
    return Cutout(dict(masks), overlaps, similarity, hull)


def silhouette_of(cutout: Cutout, view: View) -> np.ndarray:
    """Return the hull's picture (h, w) bool in a photo; nothing where there is no hull."""
    shape = (view.camera.height, view.camera.width)
    if cutout.hull is None or cutout.similarity is None:
        return np.zeros(shape, bool)
    return silhouette(cutout.hull, view.camera, cutout.similarity, shape)
