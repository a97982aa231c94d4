"""What a preparation leaves: the scene's files, and prepare.json, which says how they came about."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import scipy

from lightprobe.core.errors import InputError
from lightprobe.core.files import checksum, named_file, read_json, remove, write_bytes, write_json
from lightprobe.core.stored import read_object
from lightprobe.imaging import gravity, resize_area
from lightprobe.preparation import upright, writing
from lightprobe.preparation.alignment import AGREEING
from lightprobe.preparation.cache import HIDDEN, key_of
from lightprobe.preparation.candidates import EXPLAINED
from lightprobe.preparation.features import opencv_library
from lightprobe.preparation.looking import Seen, reason_lost
from lightprobe.preparation.mapping import Matches, Solution, match_counts
from lightprobe.preparation.masks import PLACE, WRITTEN, Cutting, written_masks
from lightprobe.preparation.options import PrepareOptions, find_photo
from lightprobe.preparation.photos import SourcePhoto, copies, given_mask
from lightprobe.preparation.places import by_place
from lightprobe.preparation.upright import Up
from lightprobe.preparation.writing import LOW_AGREEMENT, lost_cell, photo_cell, straight
from lightprobe.scene.camera import Camera
from lightprobe.scene.consistency import overlap

_FEW_REGISTERED = 0.8  # share of the photos below which a warning is due
_DOUBTFUL_MASKS = 0.86  # mean agreement of photos about the object, likewise
_LOST_OF_HINT = 0.8  # IoU of the boxes around hint and mask below which a part of the object is lost
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
    if len(cutting.views) < _FEWEST:
        raise InputError(
            f"Only {len(cutting.views)} of {len(photos)} photos fit together; take more photos that overlap, sharp and "
            "with less than 20 degrees between neighbours."
        )
    solution, up, scale, rotation = _upright(photos, cutting, options)
    full = {i: writing.full_size(camera, photos[i]) for i, camera in solution.cameras().items()}
    remove(output / "transforms.json")  # what is not finished is no scene
    bends = solution.distortion()
    shots = {photos[i].name: (photos[i], full[i], bends[i]) for i in full}
    files = _write_images(output, shots)
    _write_masks(output, photos, cutting, full, bends)
    on_progress("scene", 1, 2)
    lost = _lost(photos, seen, matches, cutting)
    report = {**_report(photos, cutting, up, scale, lost), "key": key}
    _write_sheet(output / "contact.png", photos, seen, cutting, lost)
    write_json(output / "prepare.json", report)
    cameras = {photos[i].name: camera for i, camera in full.items()}
    groups = {photos[i].name: place for i, place in cutting.places.items()}
    supports = {
        place: plane.mapped(rotation, scale["scale_factor"]) for place, plane in cutting.planes.items()
    }
    writing.write_transforms(output / "transforms.json", cameras, files, groups, supports)
    on_progress("scene", 2, 2)
    return report


def finished(output: Path, key: str) -> dict[str, Any] | None:
    """Return what prepare.json holds if the scene is finished under `key` and no mask was changed since."""
    record, path = output / HIDDEN / WRITTEN, output / "prepare.json"
    if not all(file.is_file() for file in (record, path, output / "transforms.json")):
        return None
    report = read_json(path)
    if not isinstance(report, dict) or report.get("key") != key:
        return None
    masks = {name: named_file(output / "masks", name, ".png") for name in written_masks(output)}
    same = all(_as_written(file, output, name) for name, file in masks.items() if file.is_file())
    return report if same and all(file.is_file() for file in masks.values()) else None


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


def _write_images(output: Path, shots: Mapping[str, tuple[SourcePhoto, Camera, float]]) -> dict[str, str]:
    """Write the photos as pinholes show them, unless they lie there; return file names by the photos' names."""
    record, folder = output / HIDDEN / _IMAGES, output / "images"
    lenses = {name: (photo.checksum, _lens(camera), k) for name, (photo, camera, k) in shots.items()}
    key = key_of(lenses)
    if record.is_file():
        kept = read_object(record, "remove it and prepare the scene anew")
        names = kept.get("files")
        there = {str(name): str(file) for name, file in names.items()} if isinstance(names, dict) else {}
        same = kept.get("key") == key and sorted(there) == sorted(shots)
        if same and all(named_file(folder, file).is_file() for file in there.values()):
            return there
    remove(record)
    files = writing.write_images(shots, folder)
    write_json(record, {"key": key, "files": files})
    return files


def _lens(camera: Camera) -> tuple[float, ...]:
    return camera.fx, camera.fy, camera.cx, camera.cy


def _write_masks(
    output: Path,
    photos: Sequence[SourcePhoto],
    cutting: Cutting,
    cameras: Mapping[int, Camera],
    bends: Mapping[int, float],
) -> None:
    """Write the masks at full size, corrected ones as they are, and their checksums."""
    corrected, folder = output / HIDDEN / "corrected", output / "masks"
    names, before = [photos[index].name for index in cutting.masks], dict[str, list[str]]()
    for name in names:
        present = named_file(folder, name, ".png")
        if present.is_file() and _as_written(present, output, name):
            before[name] = [checksum(present)]
        elif present.is_file() and name in cutting.own:
            write_bytes(named_file(corrected, name, ".png"), present.read_bytes())
    own = {name: kept for name in cutting.own if (kept := named_file(corrected, name, ".png")).is_file()}
    # made one by one while they are written: at full size all of them would take more than anything else here
    masks = (
        (photos[index].name, _full_mask(photos[index], mask, cameras[index], bends[index]))
        for index, mask in cutting.masks.items()
        if photos[index].name not in own
    )

    def record(where: Path, others: Mapping[str, list[str]]) -> None:
        sums = {name: [checksum(named_file(where, name, ".png")), *others.get(name, [])] for name in names}
        write_json(output / HIDDEN / WRITTEN, sums)

    # If all ends while the new folder takes the old one's place, either is known not to be the user's work.
    writing.write_masks(masks, own, folder, lambda new: record(new, before))
    record(folder, {})


def _full_mask(photo: SourcePhoto, mask: np.ndarray, camera: Camera, k: float) -> np.ndarray:
    """Return a photo's mask (H, W) float32 at its full size: the user's own, or the small one enlarged."""
    given = given_mask(photo, (photo.height, photo.width))
    if given is not None:
        return straight(given, camera, k)
    return enlarged(mask.astype(np.float32), photo.height, photo.width)


def _as_written(path: Path, output: Path, name: str) -> bool:
    return checksum(path) in written_masks(output).get(name, ())


def enlarged(mask: np.ndarray, height: int, width: int) -> np.ndarray:
    """Return a mask (h, w) at another size, (H, W) float32, with smooth outlines where it grows."""
    if mask.shape[0] >= height:
        return resize_area(mask, height, width)
    cv2 = opencv_library()
    soft = cv2.GaussianBlur(mask.astype(np.float32), (0, 0), 0.7)  # as wide as a pixel: it rounds the steps
    large = cv2.resize(soft, (width, height), interpolation=cv2.INTER_CUBIC)
    return np.clip((large - 0.5) * height / mask.shape[0] + 0.5, 0, 1).astype(np.float32)


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

    return {photo.name: reason(i, photo) for i, photo in enumerate(photos) if i not in cutting.views}


def _report(
    photos: Sequence[SourcePhoto], cutting: Cutting, up: Up, scale: Mapping[str, Any], lost: Mapping[str, str]
) -> dict[str, Any]:
    agreement = {photos[i].name: round(value, 4) for i, value in cutting.agreement.items()}
    mean = float(np.mean(list(agreement.values())))
    kept = cutting.choice.kept
    return {
        "registered": len(cutting.views),
        "total": len(photos),
        "without_camera": dict(lost),
        "apart": [[photos[i].name for i in group] for group in kept.apart],
        "kept": kept.to_json(),
        "why": cutting.choice.why,
        "points_where_they_should_be": {photos[i].name: round(v, 3) for i, v in kept.share.items()},
        "places": {photos[i].name: place for i, place in cutting.places.items()},
        "doubtful_cameras": [photos[i].name for i in doubtful_cameras(cutting)],
        "trap": cutting.choice.trap,
        "tried": [candidate.to_json() for candidate in cutting.choice.tried],
        "reprojection_error_px": float(kept.solution.errors.mean()) if len(kept.solution.errors) else None,
        "mask_agreement_mean": mean,
        "mask_agreement": agreement,
        "hint_box_iou": {photos[i].name: round(value, 4) for i, value in hint_overlaps(cutting).items()},
        "up": up.source,
        **scale,
        "masks_corrected": sorted(cutting.own),
        "warnings": _warnings(photos, cutting, up, mean),
    }


def _warnings(photos: Sequence[SourcePhoto], cutting: Cutting, up: Up, mean: float) -> list[str]:
    """Return the sentences about what may be wrong."""
    found = [sentence for sentence in (cutting.choice.trap, up.doubt) if sentence]
    if len(cutting.views) < _FEW_REGISTERED * len(photos):
        found.append(
            f"Only {len(cutting.views)} of {len(photos)} photos have cameras; prepare.json says why others have none."
        )
    unsure = [photos[i].name for i in doubtful_cameras(cutting)]
    if unsure:
        found.append(
            f"{len(unsure)} cameras may be wrong: those of {', '.join(unsure[:4])}; their photos show few of the object's "
            "points where they should be."
        )
    explained = cutting.choice.kept.fit.explained
    if explained < EXPLAINED and cutting.choice.trap is None:
        found.append(
            f"All cameras are doubtful: they explain {explained:.0%} of the matches on the object only. Take photos less "
            "than 20 degrees apart, or with more of what stands still in each place."
        )
    for group in cutting.choice.kept.apart:
        lost = [photos[i].name for i in group if i not in cutting.views]
        if lost:
            found.append(
                f"{len(lost)} photos, such as {lost[0]}, fit together but not with those that have cameras: take "
                "photos between the two, or prepare these by themselves."
            )
    if mean == 0:  # no voxel is the object's
        found.append("The masks do not fit together in space; look at contact.png and give a --hint.")
    elif mean < _DOUBTFUL_MASKS:
        found.append(
            f"The masks are doubtful: what single photos show of the object agrees with what all of them show at IoU "
            f"{mean:.2f} only. Look at contact.png; a --hint tells what the object is."
        )
    for index, value in hint_overlaps(cutting).items():
        if value < _LOST_OF_HINT:
            found.append(
                f"In {photos[index].name} the mask that was found does not reach as far as the hint, or farther: the "
                f"boxes around them have IoU {value:.2f}. A part may be wrong in all photos; look at contact.png."
            )
    low = [photos[i].name for i, value in cutting.agreement.items() if value < LOW_AGREEMENT]
    if low and mean > 0:
        found.append(
            f"{len(low)} masks disagree with the others, such as that of {low[0]}; correct them in masks/."
        )
    return found


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


def hint_overlaps(cutting: Cutting) -> dict[int, float]:
    """Return by photo the IoU of the boxes around the mask that was found and the hint that was given for it.

    What all masks lose alike their hull loses, too, and agrees with them; the hint does not.
    """
    return {
        index: overlap(_boxed(cutting.masks[index]), _boxed(view.given))
        for index, view in cutting.views.items()
        if view.given is not None and not view.fixed
    }


def _boxed(mask: np.ndarray) -> np.ndarray:
    """Return the upright box around a mask, (h, w) bool both."""
    picture = np.zeros(mask.shape, bool)
    for box in scipy.ndimage.find_objects(mask.astype(int)):
        picture[box] = True
    return picture


def _write_sheet(
    path: Path, photos: Sequence[SourcePhoto], seen: Sequence[Seen], cutting: Cutting, lost: Mapping[str, str]
) -> None:
    doubtful_first = sorted(cutting.views, key=lambda i: cutting.agreement[i] >= LOW_AGREEMENT)
    cells = [
        photo_cell(photos[i].name, cutting.views[i].color, cutting.masks[i], cutting.agreement[i])
        for i in doubtful_first
    ]
    by_name = {photo.name: index for index, photo in enumerate(photos)}
    cells += [lost_cell(name, seen[by_name[name]].color, reason) for name, reason in lost.items()]
    writing.write_sheet(path, cells)
