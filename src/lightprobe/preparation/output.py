"""What a preparation leaves: the scene's files, and prepare.json, which says how they came about."""

import itertools
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from lightprobe.core.errors import InputError
from lightprobe.core.files import named_file, read_json, remove, write_json
from lightprobe.core.stored import read_object
from lightprobe.imaging import gravity
from lightprobe.preparation import upright, writing
from lightprobe.preparation.alignment import AGREEING
from lightprobe.preparation.cache import HIDDEN, Cache, key_of
from lightprobe.preparation.candidates import EXPLAINED
from lightprobe.preparation.labelled import is_kept
from lightprobe.preparation.looking import Seen, reason_lost
from lightprobe.preparation.mapping import Matches, Solution, match_counts
from lightprobe.preparation.mask_files import (
    are_written,
    as_written,
    corrected_names,
    write_masks,
    written_masks,
)
from lightprobe.preparation.mask_report import mask_report, mask_warnings, write_sheet
from lightprobe.preparation.masks import PLACE, Cutting
from lightprobe.preparation.options import PrepareOptions, find_photo
from lightprobe.preparation.photos import SourcePhoto, copies, given_mask
from lightprobe.preparation.places import by_place
from lightprobe.preparation.undistortion import photo_mask, replaced, through_lens
from lightprobe.preparation.upright import Up

_FEW_REGISTERED = 0.8  # share of the photos below which a warning is due
_FEWEST = 3  # photos with cameras that make a scene
# Of the share of points that photos usually show where they should: below, a camera is doubtful; below the second, that
# of a photo which is of no place.
_UNSURE, _UNSURE_ALONE = 0.5, 0.75
_IMAGES = "images.json"  # in the hidden folder: what the images were made of


def write_scene(
    output: Path,
    photos: Sequence[SourcePhoto],
    seen: Sequence[Seen],
    matches: Matches,
    cutting: Cutting,
    options: PrepareOptions,
    key: str,
    on_progress: Callable[[str, int, int], None],
) -> dict[str, Any]:
    """Write the scene's files, at last transforms.json; return prepare.json's content.

    matches (M, 2) by pair. Raises `InputError` where too few photos have cameras.
    """
    if len(cutting.labelled.views) < _FEWEST:
        raise InputError(
            f"Only {len(cutting.labelled.views)} of {len(photos)} photos fit together; take more photos that overlap, sharp and "
            "with less than 20 degrees between neighbours."
        )
    solution, up, scale, rotation = _upright(photos, cutting, options)
    bends = solution.distortion()
    full = {i: writing.full_size(camera, photos[i]) for i, camera in solution.cameras().items()}
    remove(output / "transforms.json")  # what is not finished is no scene

    def counted(what: str) -> Callable[[], None]:
        count = itertools.count(1)
        return lambda: on_progress(f"scene: {what}", next(count), len(full))

    files = _copy_photos(output, {photos[i].name: photos[i] for i in full}, counted("photos"))

    def full_mask(i: int) -> np.ndarray:
        photo, view, mask = photos[i], cutting.labelled.views[i], cutting.found.masks[i]
        fine = given_mask(photo, (photo.height, photo.width))
        if fine is None:
            return photo_mask(mask, view.camera, photo.height, photo.width)
        changed = mask != view.given  # by clicks
        return replaced(fine, mask, changed, view.camera) if changed.any() else fine

    painted = cutting.corrections.painted
    write_masks(output, cutting.labelled.names, cutting.found, painted, full_mask, counted("masks"))
    lost = _lost(photos, seen, matches, cutting)
    report = {**_report(photos, cutting, up, scale, lost), "key": key}
    colors = {photo.name: each.color for photo, each in zip(photos, seen, strict=True) if photo.name in lost}
    without = {name: (colors[name], why) for name, why in lost.items()}
    write_sheet(output, cutting.labelled, cutting.found, report["doubtful_masks"], without)
    write_json(output / "prepare.json", report)
    cameras = {photos[i].name: through_lens(camera, bends[i]) for i, camera in full.items()}
    groups = {photos[i].name: place for i, place in cutting.places.items()}
    supports = {
        place: plane.mapped(rotation, scale["scale_factor"]) for place, plane in cutting.planes.items()
    }
    writing.write_transforms(output / "transforms.json", cameras, files, groups, supports)
    return report


def finished(output: Path, key: str) -> dict[str, Any] | None:
    """Return what prepare.json holds if the scene is finished under `key` and no mask was changed since."""
    path = output / "prepare.json"
    if not (are_written(output) and path.is_file() and (output / "transforms.json").is_file()):
        return None
    report = read_json(path)
    if not isinstance(report, dict) or report.get("key") != key:
        return None
    masks = {name: named_file(output / "masks", name, ".png") for name in written_masks(output)}
    same = all(as_written(file, output, name) for name, file in masks.items() if file.is_file())
    if not same or not all(file.is_file() for file in masks.values()):
        return None
    if not is_kept(Cache(output / HIDDEN), str(report.get("labelling"))):
        return None  # corrections start from it
    corrected = [name for name in corrected_names(output) if name in masks]
    return report if report.get("masks_corrected") == corrected else None


def _upright(
    photos: Sequence[SourcePhoto], cutting: Cutting, options: PrepareOptions
) -> tuple[Solution, Up, dict, np.ndarray]:
    """Return the solution with z up and in the user's unit, what was up, words on the scale, and the rotation."""
    solution = cutting.choice.kept.solution
    up = _find_up(photos, solution, options)
    points = cutting.hull.centers(cutting.hull.occupancy)
    factor, words = 1.0, "arbitrary: no photo tells how large things are; give --height"
    if options.height is not None:
        extent = upright.extent_along(points, up.direction)
        if extent <= 0:
            raise InputError("--height cannot be used: the object's own height was not found in the photos.")
        factor, words = options.height / extent, f"the object is {options.height:g} high"
    rotation = upright.rotation_to_z(up.direction, solution.pose)
    return solution.mapped(rotation, factor), up, {"scale": words, "scale_factor": factor}, rotation


def _find_up(photos: Sequence[SourcePhoto], solution: Solution, options: PrepareOptions) -> Up:
    """Return which way is up, as told, from the photos' files or from the cameras."""
    if options.up_photo is None and options.up is None:
        told = [gravity(photos[int(index)].path) for index in solution.photo]
        return upright.up_of_gravity(solution.pose, told) or upright.up_of_level_cameras(solution.pose)
    index = find_photo(photos, options.up_photo, "--up-photo") if options.up_photo else int(solution.photo[0])
    rows = np.flatnonzero(solution.photo == index)
    if not len(rows):
        raise InputError(
            f"--up-photo {photos[index].path.name} has no camera; name a photo that was registered."
        )
    pose, name = solution.pose[rows[0]], photos[index].path.name
    if options.up is None:
        return Up(pose[:3, 1] / np.linalg.norm(pose[:3, 1]), f"the vertical axis of {name}")
    return Up(pose[:3, :3] @ upright.parse_up(options.up), f"--up {options.up} in the axes of {name}")


def _copy_photos(
    output: Path, photos: Mapping[str, SourcePhoto], copied: Callable[[], None]
) -> dict[str, str]:
    """Copy the photos into the scene, unless they lie there; return file names by the photos' names."""
    record, folder = output / HIDDEN / _IMAGES, output / "images"
    key = key_of({name: photo.checksum for name, photo in photos.items()})
    if record.is_file():
        kept = read_object(record, "remove it and prepare the scene anew")
        names = kept.get("files")
        there = {str(name): str(file) for name, file in names.items()} if isinstance(names, dict) else {}
        same = kept.get("key") == key and sorted(there) == sorted(photos)
        if same and all(named_file(folder, file).is_file() for file in there.values()):
            for _ in there:
                copied()
            return there
    remove(record)
    files = writing.copy_photos(photos, folder, copied)
    write_json(record, {"key": key, "files": files})
    return files


def _lost(
    photos: Sequence[SourcePhoto], seen: Sequence[Seen], matches: Matches, cutting: Cutting
) -> dict[str, str]:
    """Return why each photo without a camera has none."""
    counts, again = match_counts(matches), copies(photos)
    middle = float(np.median([each.sharpness for each in seen]))
    apart = {i: group for group in reversed(cutting.choice.kept.apart) for i in group}

    def reason(index: int, photo: SourcePhoto) -> str:
        together = [photos[i].name for i in apart.get(index, ()) if i != index]
        return reason_lost(photo, seen[index], counts.get(index, 0), middle, again.get(photo.name), together)

    return {photo.name: reason(i, photo) for i, photo in enumerate(photos) if i not in cutting.labelled.views}


def _report(
    photos: Sequence[SourcePhoto], cutting: Cutting, up: Up, scale: Mapping[str, Any], lost: Mapping[str, str]
) -> dict[str, Any]:
    kept = cutting.choice.kept
    unsure = cutting.labelled.views if _all_doubtful(cutting) else doubtful_cameras(cutting)
    doubtful = [photos[i].name for i in unsure]
    masks = mask_report(cutting.labelled, cutting.found, cutting.corrections.names, doubtful)
    return {
        "registered": len(cutting.labelled.views),
        "total": len(photos),
        "without_camera": dict(lost),
        "apart": [[photos[i].name for i in group] for group in kept.apart],
        "kept": kept.to_json(),
        "why": cutting.choice.why,
        "points_where_they_should_be": {photos[i].name: round(v, 3) for i, v in kept.share.items()},
        "places": {photos[i].name: place for i, place in cutting.places.items()},
        "doubtful_cameras": doubtful,
        "trap": cutting.choice.trap,
        "tried": [candidate.to_json() for candidate in cutting.choice.tried],
        "reprojection_error_px": float(kept.solution.errors.mean()) if len(kept.solution.errors) else None,
        "labelling": cutting.key,
        **masks,
        "up": up.source,
        **scale,
        "warnings": [*_warnings(photos, cutting, up), *mask_warnings(masks)],
    }


def _warnings(photos: Sequence[SourcePhoto], cutting: Cutting, up: Up) -> list[str]:
    """Return the sentences about cameras that may be wrong."""
    found = [sentence for sentence in (cutting.choice.trap, up.doubt) if sentence]
    if len(cutting.labelled.views) < _FEW_REGISTERED * len(photos):
        found.append(
            f"Only {len(cutting.labelled.views)} of {len(photos)} photos have cameras; prepare.json says why others have none."
        )
    unsure = [photos[i].name for i in doubtful_cameras(cutting)]
    if unsure:
        found.append(
            f"{len(unsure)} cameras may be wrong: those of {', '.join(unsure[:4])}; their photos show few of the object's "
            "points where they should be."
        )
    if _all_doubtful(cutting):
        found.append(
            f"All cameras are doubtful: they explain {cutting.choice.kept.fit.explained:.0%} of the matches on the object only. Take photos less "
            "than 20 degrees apart, or with more of what stands still in each place."
        )
    for group in cutting.choice.kept.apart:
        lost = [photos[i].name for i in group if i not in cutting.labelled.views]
        if lost:
            found.append(
                f"{len(lost)} photos, such as {lost[0]}, fit together but not with those that have cameras: take "
                "photos between the two, or prepare these by themselves."
            )
    return found


def _all_doubtful(cutting: Cutting) -> bool:
    return cutting.choice.kept.fit.explained < EXPLAINED and cutting.choice.trap is None


def doubtful_cameras(cutting: Cutting) -> list[int]:
    """Return the photos whose cameras may be wrong, the surest first.

    They show points of half of the photos beside them, at most, where they should, or far fewer points than others
    do, or few and nothing around the object that looks as it does in the photos of some place.
    """
    kept = cutting.choice.kept
    usual = float(np.median(list(kept.share.values()))) if kept.share else 0.0
    crowd = {place: len(photos) for place, photos in by_place(cutting.places).items()}
    alone = {photo for photo, place in cutting.places.items() if crowd[place] < PLACE}
    found = [
        photo
        for photo, share in kept.share.items()
        if kept.agreement[photo] <= AGREEING
        or share < _UNSURE * usual
        or (photo in alone and share < _UNSURE_ALONE * usual)
    ]
    return sorted(found, key=lambda photo: kept.share[photo])
