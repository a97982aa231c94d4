"""What a person corrected in some masks, carried into the voxels, and so into the masks of all photos.

What was taken away shows no object: all voxels on its rays are empty. What was added belongs to the object, and the
photo does not tell how far away: there it is where the widest labelling has voxels, else where its rays come closest to the
object, as deep as it is wide.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np
import scipy

from lightprobe.core.errors import InputError
from lightprobe.preparation.features import opencv_library
from lightprobe.preparation.minimum_cut import minimum_cut
from lightprobe.preparation.outlines import outline_cost
from lightprobe.preparation.salient_object import CERTAIN
from lightprobe.preparation.voxel_labelling import OUTSIDE, Labelling, View, depth_inside
from lightprobe.scene.camera import Camera
from lightprobe.scene.hull import Hull

_SLIVER = np.ones((2, 2))  # pixels: what is thinner was not meant, masks are rounded when they are written
_ROOM = 0.25  # of the grid's resolution, on each side, for what is added
_THIN = 1.5  # voxels that what is added may be farther from the object than its nearest; and its least depth
_SAMPLES = 2.0  # along a ray for each voxel
_SPREAD = 0.25  # of the photo's longer side around a click, in which a region may end
_STEPS = 60  # of the cut
_EVIDENCE = 0.25  # of the network's odds: it was wrong here
_BY_DISTANCE = 5.0  # logarithm by which what is farthest from the click is less likely meant
_COLOR = 3.0  # logarithm that a colour is worth at most
_BINS = 16  # of a channel of CIELAB
_BLUR = 0.7  # bins by which colours scatter
_RARE = 0.05  # pixels of every colour that are taken to be there
_SEED_WEIGHT = 20.0  # pixels that one around a click counts for
_SEED = 0.006  # of the longer side: around a click it is certain


@dataclass(frozen=True)
class Corrections:
    """What a person corrected, by the photo's name."""

    painted: Mapping[str, np.ndarray] = field(
        default_factory=dict
    )  # masks (H, W) bool of the photos' own pixels, which stay as they are
    # (h, w) int8 of the pinholes' pictures: 1 object, -1 not, 0 untold
    clicked: Mapping[str, np.ndarray] = field(default_factory=dict)

    @property
    def names(self) -> set[str]:
        """Names of the photos whose masks were corrected."""
        return {*self.painted, *self.clicked}


@dataclass(frozen=True)
class Change:
    """What the object's mask in a photo lacked, and what it had too much, (h, w) bool both."""

    added: np.ndarray
    removed: np.ndarray

    def __or__(self, other: "Change") -> "Change":
        """Return both changes of one mask as one."""
        return Change(self.added | other.added, self.removed | other.removed)

    @staticmethod
    def painted(before: np.ndarray, after: np.ndarray) -> "Change":
        """Return the change between masks (h, w) bool, without the slivers that come from rounding."""
        pairs = (after & ~before, before & ~after)
        return Change(*(scipy.ndimage.binary_opening(part, _SLIVER) for part in pairs))

    @staticmethod
    def hinted(before: np.ndarray, hint: np.ndarray) -> "Change":
        """Return the change from a mask (h, w) bool to a hint's, which may be drawn loosely: only large parts are lacking."""
        width = round(2 * OUTSIDE * max(hint.shape))
        lacking = scipy.ndimage.binary_opening(hint & ~before, np.ones((width, width)))
        return Change(lacking, np.zeros_like(hint))

    @staticmethod
    def clicked(signs: np.ndarray) -> "Change":
        """Return the change that clicks (h, w) int8 tell, as in `Corrections`."""
        return Change(signs > 0, signs < 0)


def corrected(labelling: Labelling, views: Mapping[int, View], changes: Mapping[int, Change]) -> Labelling:
    """Return the labelling that changed masks, by photo, ask for.

    Where silhouettes change, the network's evidence is forgotten: it was wrong in one photo, and may be in others.
    """
    hull, widest = labelling.hull, labelling.widest
    if any(change.added.any() for change in changes.values()):
        hull, widest = _with_room(hull), _with_room(widest)
    for photo, change in changes.items():
        if change.added.any():
            hull = _with_likely(hull, widest, views[photo].camera, change.added)
            missing = change.added & ~hull.silhouette(views[photo].camera)
            hull = _filled(hull, views[photo].camera, missing)
    for photo, change in changes.items():
        if change.removed.any():
            hull, widest = (_emptied(each, views[photo].camera, change.removed) for each in (hull, widest))
    if hull is labelling.hull:
        return labelling
    shapes = {photo: hull.silhouette(view.camera) for photo, view in views.items()}
    evidence = {
        photo: np.where(shape == labelling.shapes[photo], labelling.evidence[photo], np.float32(0))
        for photo, shape in shapes.items()
    }
    widest = replace(widest, occupancy=widest.occupancy | hull.occupancy)
    return Labelling(hull, widest, evidence, shapes)


def _emptied(hull: Hull, camera: Camera, region: np.ndarray) -> Hull:
    """Return voxels of which none shows in `region` (h, w) bool of a photo."""
    occupancy = hull.occupancy.copy()
    occupancy[occupancy] = ~_shown(hull.centers(occupancy), camera, region)
    return replace(hull, occupancy=occupancy)


def _with_likely(hull: Hull, widest: Hull, camera: Camera, region: np.ndarray) -> Hull:
    """Return voxels with those of the widest labelling that `region` (h, w) bool of a photo shows."""
    likely = widest.occupancy & ~hull.occupancy
    occupancy = hull.occupancy.copy()
    occupancy[likely] = _shown(hull.centers(likely), camera, region)
    return replace(hull, occupancy=occupancy)


def _shown(points: np.ndarray, camera: Camera, region: np.ndarray) -> np.ndarray:
    """Return which points (P, 3) `region` (h, w) bool of a photo shows, (P,) bool."""
    framed, rows, columns, _ = camera.framed(points)
    shown = np.zeros(len(points), bool)
    shown[framed] = region[rows, columns]
    return shown


def _filled(hull: Hull, camera: Camera, region: np.ndarray) -> Hull:
    """Return voxels with those that `region` (h, w) bool of a photo shows; where there are none, `hull` as it is."""
    if not region.any() or not hull.occupancy.any():
        return hull
    away = scipy.ndimage.distance_transform_edt(~hull.occupancy)
    rows, columns = np.nonzero(region)
    count = len(hull.occupancy)
    axes = camera.camera_to_world[:3, :3]
    steps = [
        (columns + 0.5 - camera.cx) / camera.fx,
        -(rows + 0.5 - camera.cy) / camera.fy,
        -np.ones(len(rows)),
    ]
    rays = np.stack(steps, axis=1) @ axes.T  # one unit of depth long
    center = -(hull.lo + hull.hi - 2 * camera.position) @ axes[:, 2] / 2
    reach = np.linalg.norm(hull.hi - hull.lo) / 2
    depths = np.linspace(max(center - reach, 1e-6), center + reach, round(_SAMPLES * count * np.sqrt(3)))
    apart = np.full((len(depths), len(rows)), np.inf, np.float32)  # voxels from the object
    for index, depth in enumerate(depths):
        cell = np.floor((camera.position + depth * rays - hull.lo) / hull.voxel).astype(int)
        within = ((cell >= 0) & (cell < count)).all(axis=1)
        apart[index, within] = away[tuple(cell[within].T)]
    near = apart <= apart.min(axis=0) + _THIN
    first, last = depths[near.argmax(axis=0)], depths[len(depths) - 1 - near[::-1].argmax(axis=0)]
    middle, half = (first + last) / 2, (last - first) / 2
    wide = depth_inside(region)[rows, columns] * middle / np.sqrt(camera.fx * camera.fy)
    at, deep = np.zeros(region.shape), np.zeros(region.shape)
    at[rows, columns] = middle
    deep[rows, columns] = np.maximum(np.maximum(half, wide), _THIN * hull.voxel.max())
    empty = ~hull.occupancy
    inside, *pixels, depth = camera.framed(hull.centers(empty))
    chosen = np.zeros(empty.sum(), bool)
    chosen[inside] = region[*pixels] & (np.abs(depth - at[*pixels]) <= deep[*pixels])
    occupancy = hull.occupancy.copy()
    occupancy[empty] = chosen
    return replace(hull, occupancy=occupancy)


def _with_room(hull: Hull) -> Hull:
    """Return a grid with empty voxels around it."""
    more = round(_ROOM * len(hull.occupancy))
    occupancy, score = (np.pad(grid, more) for grid in (hull.occupancy, hull.score))
    return Hull(occupancy, score, hull.lo - more * hull.voxel, hull.hi + more * hull.voxel)


def clicked_region(
    color: np.ndarray, evidence: np.ndarray, mask: np.ndarray, at: tuple[float, float], is_object: bool
) -> np.ndarray:
    """Return what belongs together with a place where the object is, or is not, and the mask wrong, (h, w) bool.

    color: (h, w, 3) uint8 sRGB. evidence: L (h, w) of the photo. mask: (h, w) bool. at: column and row as shares of the
    photo's size. The region is a minimum cut by the colours of what is inside and outside of the mask nearby, by the
    evidence, by the distance and by edges. Raises `InputError` where the mask is already as it is asked to be.
    """
    height, width = mask.shape
    x, y = min(int(at[0] * width), width - 1), min(int(at[1] * height), height - 1)
    if mask[y, x] == is_object:
        where = "inside of" if is_object else "outside of"
        raise InputError(f"That place is {where} the mask already; click on one that is not.")
    reach = round(_SPREAD * max(mask.shape))
    window = (
        slice(max(0, y - reach), min(height, y + reach + 1)),
        slice(max(0, x - reach), min(width, x + reach + 1)),
    )
    rows, columns = np.mgrid[window]
    distance = np.hypot(rows - y, columns - x)
    seed = distance <= max(1.5, _SEED * max(mask.shape))
    before, nearby = mask[window], np.ascontiguousarray(color[window])
    odds = _color_odds(nearby, np.where(seed, is_object, before), seed) + _EVIDENCE * evidence[window]
    of_kind = (odds if is_object else -odds) - _BY_DISTANCE * distance / reach
    of_kind[before == is_object] = CERTAIN  # no outline is needed beside what is of its kind
    cut = minimum_cut(np.where(seed, CERTAIN, of_kind), outline_cost(nearby), _STEPS)
    pieces, _ = scipy.ndimage.label((cut | seed) & (before != is_object))
    region = np.zeros(mask.shape, bool)
    region[window] = pieces == pieces[y - window[0].start, x - window[1].start]
    return region


def _color_odds(color: np.ndarray, inside: np.ndarray, seed: np.ndarray) -> np.ndarray:
    """Return ln(p(colour | inside) / p(colour | outside)) of each pixel, (h, w).

    color: (h, w, 3) uint8 sRGB; inside (h, w) bool; pixels of `seed` (h, w) bool count for more.
    """
    lab = opencv_library().cvtColor(color, opencv_library().COLOR_RGB2LAB)
    bins = tuple(np.moveaxis(lab // (256 // _BINS), -1, 0))
    weight = np.where(seed, _SEED_WEIGHT, 1.0)
    likely = []
    for part in (inside, ~inside):
        counts = np.zeros((_BINS,) * 3)
        np.add.at(counts, tuple(each[part] for each in bins), weight[part])
        smooth = scipy.ndimage.gaussian_filter(counts, _BLUR, mode="constant")
        likely.append((smooth + _RARE) / (smooth.sum() + _RARE * counts.size))
    return np.clip(np.log(likely[0] / likely[1])[bins], -_COLOR, _COLOR)
