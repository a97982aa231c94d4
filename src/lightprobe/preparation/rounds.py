"""Masks in rounds: first cuts by what is known of the object, then cuts around the hull of all masks."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from lightprobe.core.files import checksum, named_file
from lightprobe.core.stored import read_object
from lightprobe.imaging import read_mask, resize_area
from lightprobe.preparation.cache import HIDDEN
from lightprobe.preparation.candidates import Choice
from lightprobe.preparation.cutting import masks_of, rembg_mask
from lightprobe.preparation.looking import Seen
from lightprobe.preparation.mapping import Solution
from lightprobe.preparation.masks import (
    AGREEMENTS,
    FEWEST,
    MARGINS,
    Cutout,
    View,
    carve,
    cut_all,
    object_points,
    silhouette_of,
)
from lightprobe.preparation.near_hull import cut_near_hull, point_marks
from lightprobe.preparation.openings import openings
from lightprobe.preparation.options import Masker, PrepareOptions
from lightprobe.preparation.photos import SourcePhoto
from lightprobe.preparation.places import by_place, same_place
from lightprobe.preparation.support_plane import (
    SupportPlane,
    above_planes,
    common_plane,
    find_planes,
    shared_points,
)
from lightprobe.preparation.voxel_labelling import label_voxels
from lightprobe.preparation.writing import straight
from lightprobe.scene.camera import Camera, Similarity

Masks = Mapping[int, np.ndarray]  # (h, w) bool by photo
OnProgress = Callable[[str, int, int], None]
PLACE = 3  # photos that make a place: fewer may be what the others' light or table hides
WRITTEN = "written.json"  # in the hidden folder: checksums of the masks as they were written


@dataclass(frozen=True)
class Cutting:
    """Cameras and masks of a scene's photos, by the photos' index."""

    choice: Choice
    views: dict[int, View]
    cutout: Cutout
    labels: np.ndarray  # (P,) int8 of the solution's points: 1 on the object
    own: frozenset[str] = frozenset()  # names of the photos whose mask the user corrected
    places: Mapping[int, int] = field(default_factory=dict)  # by photo, of an object that was carried about
    planes: Mapping[int, SupportPlane] = field(default_factory=dict)  # that the object stands on, by place

    @property
    def masks(self) -> dict[int, np.ndarray]:
        """Small masks (h, w) bool as through a pinhole."""
        return self.cutout.masks


def cut_rounds(
    photos: Sequence[SourcePhoto],
    seen: Sequence[Seen],
    choice: Choice,
    known: Mapping[int, np.ndarray],
    fixed: set[int],
    own: Mapping[str, np.ndarray],
    options: PrepareOptions,
    on_progress: OnProgress,
) -> Cutting:
    """Return the masks of all photos that have a camera.

    What several places share is the object, and voxels are labelled by it; of one place, photo by photo is cut.
    known: masks (H, W) bool of photos as they were taken; those of `fixed` photos stay as they are. own:
    masks (H, W) bool, by name, that the user corrected in the scene. Errors as in `object_points`.
    """
    solution = choice.kept.solution
    bends = solution.distortion()
    views = {
        index: _view(photos[index], seen[index], camera, bends[index], known.get(index), index in fixed, own)
        for index, camera in solution.cameras().items()
    }
    if all(view.fixed for view in views.values()):
        cutout = carve(views, {index: view.given for index, view in views.items() if view.given is not None})
        return Cutting(choice, views, cutout, np.ones(len(solution.points), np.int8), frozenset(own))
    labels = object_points(solution, views, choice.moving)
    places = {} if choice.moving else _places(solution, [each.grey for each in seen], labels == 1)
    if places and options.masker is not Masker.REMBG:
        return _label(choice, views, places, labels, own, on_progress)
    if options.masker is Masker.REMBG:
        given = {i: view.given for i, view in views.items() if view.fixed and view.given is not None}
        masks = {i: given[i] if i in given else rembg_mask(view.color) for i, view in views.items()}
    else:
        masks = cut_all(views, solution, labels)
    cutout, opened = carve(views, masks, AGREEMENTS[0]), dict[int, np.ndarray]()
    free = {index: view for index, view in views.items() if not view.fixed}
    marks = {index: point_marks(view, solution, labels, index) for index, view in free.items()}

    def cut_again(shapes: Masks, masks: Masks, margin: float, photo: int) -> np.ndarray:
        opening, mark = opened.get(photo), marks.get(photo)
        return cut_near_hull(views[photo], shapes[photo], masks[photo], margin, opening, mark)

    for done, (margin, agreement) in enumerate(zip(MARGINS, AGREEMENTS[1:], strict=True)):
        if cutout.hull is None:
            break
        shapes = {index: silhouette_of(cutout, view) for index, view in views.items()}
        if done > 0:  # what a hull of first cuts holds too much of is no opening yet
            found = openings(solution, views, labels, cutout, shapes, margin)
            # An opened hull has less before the points that told of it.
            opened |= {index: opening | opened.get(index, False) for index, opening in found.items()}
        masks = masks_of(partial(cut_again, shapes, cutout.masks, margin), views)
        cutout = carve(views, masks, agreement)
        on_progress("masks", done + 1, len(MARGINS))
    return Cutting(choice, views, cutout, labels, frozenset(own))


def _places(solution: Solution, pictures: Sequence[np.ndarray], on_object: np.ndarray) -> dict[int, int]:
    """Return the place of each photo where the object (P,) bool was carried from place to place, else nothing."""
    plane = common_plane(solution, on_object)
    if plane is None:
        return {}
    places = same_place(solution, pictures, plane, on_object)
    several = [photos for photos in by_place(places).values() if len(photos) >= PLACE]
    return places if len(several) > 1 else {}


def _label(
    choice: Choice,
    views: dict[int, View],
    places: Mapping[int, int],
    labels: np.ndarray,
    own: Mapping[str, np.ndarray],
    on_progress: OnProgress,
) -> Cutting:
    """Return the masks of photos from several `places`, by photo; `labels` (P,) of points, as far as known."""
    solution = choice.kept.solution
    shared = (labels == 1) & shared_points(solution, places)
    chosen = shared if shared.sum() >= FEWEST else labels == 1  # places whose photos do not match share none
    planes = find_planes(solution, places, chosen)
    common = common_plane(solution, chosen)
    if common is not None:
        # In it the photos of a place look alike, which a few points of their own tell less surely.
        planes |= {place: common for place, photos in by_place(places).items() if len(photos) >= PLACE}
    labels = above_planes(solution, np.where(chosen, 1, np.minimum(labels, 0)).astype(np.int8), planes)
    found = label_voxels(
        views, places, solution, labels == 1, planes, lambda done, total: on_progress("masks", done, total)
    )
    hull = found.hull
    if not hull.occupancy.any():
        return Cutting(choice, views, Cutout(found.masks, {}, None, None), labels, frozenset(own), places)
    points = hull.centers(hull.occupancy)
    center = (points.min(axis=0) + points.max(axis=0)) / 2
    radius = np.linalg.norm(points - center, axis=1).max() + hull.voxel.max()
    similarity = Similarity(center, float(radius))
    hull = replace(hull, lo=similarity.apply(hull.lo), hi=similarity.apply(hull.hi))
    cutout = Cutout(found.masks, found.agreement, similarity, hull)
    return Cutting(choice, views, cutout, labels, frozenset(own), places, planes)


def _view(
    photo: SourcePhoto,
    each: Seen,
    camera: Camera,
    k: float,
    known: np.ndarray | None,
    fixed: bool,
    own: Mapping[str, np.ndarray],
) -> View:
    """Return one photo as through a pinhole, with what is known of its mask."""
    height, width = each.color.shape[:2]
    small = camera.resized(width, height)
    color = straight(each.color, small, k)
    if photo.name in own:
        return View(small, color, resize_area(own[photo.name].astype(np.float32), height, width) >= 0.5, True)
    if known is None:
        return View(small, color, None, False)
    is_small = known.shape == (height, width)
    mask = known if is_small else resize_area(known.astype(np.float32), height, width) >= 0.5
    return View(small, color, straight(mask.astype(np.float32), small, k) >= 0.5, fixed)


def written_masks(output: Path) -> dict[str, list[Any]]:
    """Return the checksums of a scene's masks as they were written, by name, none where none were.

    The newest comes first; an older one is there for a run that ended while masks took each other's place.
    Raises `InputError` for a record that is damaged.
    """
    record = output / HIDDEN / WRITTEN
    found = read_object(record, "remove it and prepare the scene anew") if record.is_file() else {}
    return {name: value if isinstance(value, list) else [value] for name, value in found.items()}


def own_masks(photos: Sequence[SourcePhoto], output: Path) -> dict[str, np.ndarray]:
    """Return the masks (H, W) bool, by name, that were changed in the scene since they were written there."""
    if not (output / HIDDEN / WRITTEN).is_file():
        return {}
    written, corrected = written_masks(output), output / HIDDEN / "corrected"
    found = {}
    for photo in photos:
        path, kept = (named_file(folder, photo.name, ".png") for folder in (output / "masks", corrected))
        if path.is_file() and checksum(path) not in written.get(photo.name, ()):
            found[photo.name] = read_mask(path) >= 0.5
        elif kept.is_file():
            found[photo.name] = read_mask(kept) >= 0.5
    return found
