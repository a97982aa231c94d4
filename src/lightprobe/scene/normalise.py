"""Where the object is and how large: the similarity that puts it at the origin with radius 1.

Found from masks and cameras alone: the rays through the mask centroids give a first place, the extent of the
masks a first size, and the visual hull in that volume the bounding box whose centre and farthest point are
used.
"""

from collections.abc import Sequence

import numpy as np
import scipy

from lightprobe.core.errors import InputError
from lightprobe.scene.camera import Camera, Similarity
from lightprobe.scene.hull import Hull, usual_agreement, visual_hull

_COARSE, _FINE = 64, 96  # voxels along an edge
_GROWTH = 1.5  # of the searched cube when the hull reaches its walls
_MARGIN = 1.15  # of the cube around the hull, for thin parts that fall between coarse voxels
_ATTEMPTS = 8  # at a box that holds the whole hull
ROUGH_AGREEMENT = 0.8  # for scenes whose masks or poses are rough
_ROUNDING = 1e-3  # of the object's size, below which the rounding of coordinates must lie
_FEW = 3  # whole masks, fewer than which say nothing
# Far behind the object lies space that few, similar cameras see, all with the object in front: it is not the
# object. Close-ups alone leave more of it, and then only what many of them see can be trusted.
_SEEN_BY_SOME, _SEEN_BY_MANY = 0.1, 0.3


def find_similarity(
    cameras: Sequence[Camera], alphas: Sequence[np.ndarray], *, agreement: float | None = None
) -> Similarity:
    """Return the similarity of the object in the `alphas` (H, W) of input-frame `cameras`; deterministic.

    agreement: as in `visual_hull`; where it leaves nothing, a lower one is tried. Raises `InputError` when no
    point of space lies inside the masks: poses and masks then do not belong together.
    """
    center, radius = first_guess(cameras, alphas)
    usual = usual_agreement(len(alphas)) if agreement is None else agreement
    trials = [(usual, _SEEN_BY_SOME), (usual, _SEEN_BY_MANY), (ROUGH_AGREEMENT, _SEEN_BY_MANY)]
    for needed, seen_by in trials if len(_whole(alphas)) >= _FEW else trials[1:]:
        found = _search(cameras, alphas, center, radius, needed, seen_by)
        if found is not None:
            return found
    raise InputError(
        "Masks and cameras do not agree: no bounded part of space lies inside the masks of the photos that see it; "
        "run `lightprobe inspect` to see whether masks are inverted or poses follow another convention."
    )


def _search(
    cameras: Sequence[Camera],
    alphas: Sequence[np.ndarray],
    center: np.ndarray,
    radius: float,
    agreement: float,
    seen_by: float,
) -> Similarity | None:
    """Return the similarity of the hull found from a first place and size, None if it has no end."""

    def carve(resolution: int) -> Hull:
        return visual_hull(cameras, alphas, resolution, lo=low, hi=high, agreement=agreement, seen_by=seen_by)

    low, high = center - radius, center + radius
    for _ in range(_ATTEMPTS):
        hull = carve(_COARSE)
        if not hull.occupancy.any():
            return None
        (low, high), fits = _better_box(hull)
        if fits:
            fine = carve(_FINE)
            return _enclosing(fine if fine.occupancy.any() else hull)
    return None


@np.errstate(over="ignore", invalid="ignore", divide="ignore")  # what comes of it is looked at
def first_guess(cameras: Sequence[Camera], alphas: Sequence[np.ndarray]) -> tuple[np.ndarray, float]:
    """Return a point (3,) near the object's middle and a rough radius around it, in the cameras' frame.

    Masks that the photo's border cuts say little about middle and size; they count only without others.
    """
    shown = [i for i, alpha in enumerate(alphas) if (alpha >= 0.5).any()]  # specks vanish in a small picture
    if not shown:
        raise InputError("No mask shows more than a few specks; run `lightprobe inspect` to see them.")
    whole = [i for i in _whole(alphas) if i in shown]
    chosen = whole if len(whole) >= _FEW else shown
    sized = [cameras[i].resized(alphas[i].shape[1], alphas[i].shape[0]) for i in chosen]
    pixels = [np.argwhere(alphas[i] >= 0.5)[:, ::-1] + 0.5 for i in chosen]
    rays = [_direction(camera, *points.mean(axis=0)) for camera, points in zip(sized, pixels, strict=True)]
    center = nearest_point(np.stack([camera.position for camera in sized]), np.stack(rays))
    if center is None:
        raise InputError(
            "The cameras stand or look where nothing can be computed; run `lightprobe inspect` and estimate the poses "
            "again."
        )
    radii = []
    for camera, points in zip(sized, pixels, strict=True):
        u, v, depth = camera.project(center[None])[0]
        if depth > 0:
            offset = np.hypot((points[:, 0] - u) / camera.fx, (points[:, 1] - v) / camera.fy)
            radii.append(depth * offset.max())
    radius = 1.3 * float(np.median(radii)) if radii else 0.0
    if not np.spacing(np.abs(center).max()) < _ROUNDING * radius < np.inf:
        raise InputError(
            "The cameras look away from the point their masks point to; run `lightprobe inspect` to see which pose "
            "convention fits."
        )
    return center, radius


def _better_box(hull: Hull) -> tuple[tuple[np.ndarray, np.ndarray], bool]:
    """Return the cube to search next, and whether it frames the hull: nothing cut off, little empty space."""
    low, high = _bounds(hull)
    middle, half = (low + high) / 2, (high - low).max() / 2
    size = (hull.hi - hull.lo).max() / 2
    cut = (low - hull.lo < hull.voxel).any() or (hull.hi - high < hull.voxel).any()
    half = _GROWTH * size if cut else _MARGIN * half + hull.voxel.max()
    return (middle - half, middle + half), not cut and half > 0.7 * size


def _enclosing(hull: Hull) -> Similarity:
    """Return the similarity that maps the hull's box centre to 0, its farthest point to distance 1.

    The object may reach a voxel past the farthest centre that won the vote; with that voxel it stays inside.
    """
    low, high = _bounds(hull)
    center = (low + high) / 2
    distance = np.linalg.norm(hull.centers(_main_parts(hull.occupancy)) - center, axis=1).max()
    return Similarity(center, float(distance + hull.voxel.max()))


def _bounds(hull: Hull) -> tuple[np.ndarray, np.ndarray]:
    """Return the lowest and highest corner of the occupied voxels."""
    points = hull.centers(_main_parts(hull.occupancy))
    return points.min(axis=0) - hull.voxel / 2, points.max(axis=0) + hull.voxel / 2


def _main_parts(occupancy: np.ndarray) -> np.ndarray:
    """Return `occupancy` without specks: connected parts below a hundredth of the largest one."""
    labels, _ = scipy.ndimage.label(occupancy, structure=np.ones((3, 3, 3)))
    sizes = np.bincount(labels.ravel())
    sizes[0] = 0
    return (sizes >= 0.01 * sizes.max())[labels] & occupancy


def _whole(alphas: Sequence[np.ndarray]) -> list[int]:
    """Return the indices of the masks that the photo's border does not cut."""
    borders = (np.concatenate([alpha[0], alpha[-1], alpha[:, 0], alpha[:, -1]]) for alpha in alphas)
    return [index for index, border in enumerate(borders) if border.max() < 0.5]


def _direction(camera: Camera, u: float, v: float) -> np.ndarray:
    """Return the unit world direction (3,) of the ray through pixel position (u, v)."""
    local = np.array([(u - camera.cx) / camera.fx, -(v - camera.cy) / camera.fy, -1.0])
    world = camera.camera_to_world[:3, :3] @ local
    return world / np.linalg.norm(world)


def nearest_point(origins: np.ndarray, directions: np.ndarray) -> np.ndarray | None:
    """Return the point (3,) with the least sum of distances to the rays (N, 3): reweighted least squares.

    None where the rays are no numbers, or so far apart that sums overflow.
    """
    across = np.eye(3) - directions[:, :, None] * directions[:, None, :]
    weight = np.ones(len(origins))
    point = np.zeros(3)
    for _ in range(20):
        matrix = (weight[:, None, None] * across).sum(axis=0)
        right = (weight[:, None] * np.einsum("nij,nj->ni", across, origins)).sum(axis=0)
        if not np.isfinite([*matrix.ravel(), *right]).all():
            return None
        point = np.linalg.lstsq(matrix, right, rcond=None)[0]
        distance = np.linalg.norm(np.einsum("nij,nj->ni", across, point - origins), axis=1)
        weight = 1 / np.maximum(distance, 1e-3 * distance.mean() + 1e-12)
    return point if np.isfinite(point).all() else None
