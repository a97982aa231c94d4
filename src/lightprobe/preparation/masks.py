"""Masks of all photos that have a camera, and where and on what the object stood in each place."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import scipy

from lightprobe.core.errors import InputError
from lightprobe.preparation.cache import Cache
from lightprobe.preparation.candidates import Choice
from lightprobe.preparation.corrections import Corrections
from lightprobe.preparation.labelled import (
    Labelled,
    Masks,
    kept_labelled,
    masks_of,
)
from lightprobe.preparation.looking import Seen
from lightprobe.preparation.mapping import Solution
from lightprobe.preparation.photos import SourcePhoto
from lightprobe.preparation.places import by_place, same_place
from lightprobe.preparation.salient_object import kept_log_odds
from lightprobe.preparation.support_plane import common_plane
from lightprobe.preparation.undistortion import pinhole_camera, small_mask, undistorted
from lightprobe.preparation.voxel_labelling import Labelling, Look, View, away, label_voxels, photo_evidence
from lightprobe.scene.camera import Camera
from lightprobe.scene.hull import Hull
from lightprobe.scene.support import SupportPlane

OnProgress = Callable[[str, int, int], None]
PLACE = 3  # photos that make a place: fewer may be what the others' light or table hides
_REACH = 1.35  # radii of the object's points within which it may reach
_FEWEST = 12  # points from which the object's place is known
_SHARP = 2.0  # pixels of mean error up to which a point is trusted
_NEAR = 0.012  # of the longer side: a point this near to a given mask may lie on the object's rim


@dataclass(frozen=True)
class Cutting:
    """Cameras and masks of a scene's photos, by the photos' index."""

    choice: Choice
    labelled: Labelled  # photos that have a camera
    found: Masks
    hull: (
        Hull  # the object's voxels above the plane it stands on, in the solution's frame, before corrections
    )
    key: str = ""  # of the labelled voxels that are kept
    corrections: Corrections = field(default_factory=Corrections)
    places: Mapping[int, int] = field(default_factory=dict)  # by photo, of an object that was carried about
    planes: Mapping[int, SupportPlane] = field(default_factory=dict)  # that the object stands on, by place


def cut_masks(
    photos: Sequence[SourcePhoto],
    seen: Sequence[Seen],
    choice: Choice,
    known: Mapping[int, np.ndarray],
    fixed: set[int],
    corrections: Corrections,
    cache: Cache,
    key: str,
    on_progress: OnProgress,
) -> Cutting:
    """Return the masks of all photos that have a camera.

    known: masks (H, W) bool of photos as they were taken; those of `fixed` photos stay as they are. key: of photos,
    cameras and hints. Raises `InputError` where no point of the object is found or a lens folds its picture over, `ConfigError` where photos without a
    mask are left and the network that finds objects is not installed.
    """
    solution = choice.kept.solution
    bends = solution.distortion()
    views = {
        index: _view(
            seen[index],
            pinhole_camera(camera, bends[index], photos[index].name),
            known.get(index),
            index in fixed,
        )
        for index, camera in solution.cameras().items()
    }

    def label() -> Labelling:
        look = _kept_look(photos, cache)
        evidence = photo_evidence(views, look)
        points = solution.points[object_points(solution, views, evidence)]
        return label_voxels(views, evidence, points, lambda *at: on_progress("masks", *at), look)

    names = {index: photos[index].name for index in views}
    labelled = kept_labelled(cache, key, names, views, label)
    found = labelled.labelling
    masks = masks_of(labelled, corrections, cache)
    places: dict[int, int] = {}
    planes: dict[int, SupportPlane] = {}
    on_object = _inside(found.hull, solution.points)
    plane, hull = None if choice.moving else common_plane(solution, on_object), found.hull
    if plane is not None:
        # Nobody looks from below: beneath the plane nothing tells that voxels are empty.
        above = plane.height(hull.centers(hull.occupancy)) > 0
        occupancy = hull.occupancy.copy()
        occupancy[hull.occupancy] = above
        hull = replace(hull, occupancy=occupancy)
        each = same_place(solution, [photo.grey for photo in seen], plane, on_object)
        large = [place for place, mine in by_place(each).items() if len(mine) >= PLACE]
        if len(large) > 1:
            places, planes = each, dict.fromkeys(large, plane)
    return Cutting(choice, labelled, masks, hull, key, corrections, places, planes)


def _kept_look(photos: Sequence[SourcePhoto], cache: Cache) -> Look:
    """Return a `Look` whose answers are kept: after a correction most photos are looked at as before."""
    return lambda photo, color, box: kept_log_odds(cache, photos[photo].name, color, box)


def object_points(
    solution: Solution, views: Mapping[int, View], evidence: Mapping[int, np.ndarray]
) -> np.ndarray:
    """Return which points lie on the object, (P,) bool, by what the photos that saw them show there.

    evidence: as from `photo_evidence`. Points that show outside of a given mask are off the object. Raises
    `InputError` where too few points are left.
    """
    total, outside = np.zeros(len(solution.points)), np.zeros(len(solution.points), bool)
    for photo, view in views.items():
        shown, rows, columns, _ = view.camera.framed(solution.points)
        if view.given is not None:
            outside[shown] |= away(view.given)[rows, columns] > _NEAR * max(view.given.shape)
        values = np.zeros(len(solution.points))
        values[shown] = evidence[photo][rows, columns]
        mine = solution.seen[solution.seen_by == photo]
        total[mine] += values[mine]
    chosen = (solution.errors <= _SHARP) & (total > 0) & ~outside
    if chosen.sum() < _FEWEST:
        raise InputError(
            "No points of the object were found: give a mask or a box of it in one photo that shows it well, "
            "with --hint PHOTO=MASK.png or --hint PHOTO=x0,y0,x1,y1."
        )
    distance = np.linalg.norm(solution.points - np.median(solution.points[chosen], axis=0), axis=1)
    return chosen & (distance < _REACH * np.quantile(distance[chosen], 0.9))


def _inside(hull: Hull, points: np.ndarray) -> np.ndarray:
    """Return which points (P, 3) lie in occupied voxels or beside them, (P,) bool."""
    near = scipy.ndimage.binary_dilation(hull.occupancy, np.ones((3, 3, 3)))
    cell = np.floor((points - hull.lo) / hull.voxel).astype(int)
    within = ((cell >= 0) & (cell < len(near))).all(axis=1)
    found = np.zeros(len(points), bool)
    found[within] = near[tuple(cell[within].T)]
    return found


def _view(each: Seen, camera: Camera, known: np.ndarray | None, fixed: bool) -> View:
    """Return one photo as its pinhole `camera` shows it, with what is known of its mask."""
    height, width = each.color.shape[:2]
    small = camera.resized(width, height)
    given = None if known is None else small_mask(known, small)
    return View(small, undistorted(each.color, small), given, fixed and given is not None)
