"""A correction of one mask in a prepared scene, taken up by all of its masks within seconds."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from lightprobe.core.errors import InputError
from lightprobe.core.files import disk_errors, named_file, write_json
from lightprobe.core.stored import read_object
from lightprobe.imaging import read_mask, resize_area, write_mask
from lightprobe.preparation.cache import HIDDEN, Cache
from lightprobe.preparation.corrections import clicked_region
from lightprobe.preparation.labelled import Labelled, enlarged, masks_of, read_labelled
from lightprobe.preparation.mask_files import forget_corrections, keep_clicks, own_corrections, write_masks
from lightprobe.preparation.mask_report import mask_report, mask_warnings, write_sheet
from lightprobe.preparation.preparing import locked_scene

Tell = Callable[[str], None]

_REPORT, _CAMERAS = "prepare.json", "transforms.json"
_REMEDY = "prepare the scene anew"
# What is read of the report, beside the key of what was kept.
_READ = {
    "mask_agreement_mean": float,
    "mask_agreement": dict,
    "hint_box_iou": dict,
    "warnings": list,
    "without_camera": dict,
}


def click_mask(scene: Path, name: str, at: tuple[float, float], is_object: bool, tell: Tell) -> None:
    """Correct a photo's mask by a click on what is the object, or is not, and all others by it.

    at: the place, in shares of the photo's width and height from its upper left corner. Raises as `correct_masks`,
    and `InputError` for a click on what is already as it is asked to be.
    """
    with locked_scene(scene):
        labelled, report = _kept(scene)
        photo, path = _photo(labelled, name), named_file(scene / "masks", name, ".png")
        color, evidence = labelled.views[photo].color, labelled.labelling.evidence[photo]
        fine = read_mask(path)
        small = resize_area(fine, *color.shape[:2]) >= 0.5
        tell("finding what belongs together")
        region = clicked_region(color, evidence, small, at, is_object)
        corrections = own_corrections([name], scene)
        with disk_errors(scene):
            if name in corrections.painted:
                # What a person painted stays as fine as it is where the click changes nothing.
                changed = enlarged(region, *fine.shape) > 0
                write_mask(path, np.where(changed, enlarged(small ^ region, *fine.shape), fine))
            else:
                signs = corrections.clicked.get(name, np.zeros(small.shape, np.int8))
                keep_clicks(scene, name, np.where(region, np.int8(1 if is_object else -1), signs))
        _correct(scene, labelled, report, tell)


def correct_masks(scene: Path, tell: Tell) -> None:
    """Have all masks of a prepared scene take up those that a person changed in masks/.

    Raises `InputError` for a scene of an older version or with a damaged record, `ResourceError` when another process
    writes the scene.
    """
    with locked_scene(scene):
        _correct(scene, *_kept(scene), tell)


def forget_correction(scene: Path, name: str, tell: Tell) -> None:
    """Make a photo's mask as it would be had nobody changed it, and all others; raises as `correct_masks`."""
    with locked_scene(scene):
        labelled, report = _kept(scene)
        _photo(labelled, name)
        forget_corrections(scene, name)
        _correct(scene, labelled, report, tell)


def _kept(scene: Path) -> tuple[Labelled, dict[str, Any]]:
    """Return what a preparation kept, and its report."""
    path = scene / _REPORT
    report = read_object(path, _REMEDY)
    labelled = read_labelled(Cache(scene / HIDDEN), str(report.get("labelling")))
    if labelled is None:
        raise InputError(
            f"{scene} was prepared by an older version, or what it kept is gone; give its prepare command once more."
        )
    for key, kind in _READ.items():
        if not isinstance(report.get(key), kind):
            raise InputError(f"{path} is not as prepare wrote it; {_REMEDY}.")
    return labelled, report


def _photo(labelled: Labelled, name: str) -> int:
    for photo, found in labelled.names.items():
        if found == name:
            return photo
    raise InputError(f"The photo {name} has no camera, and so no mask.")


def _correct(scene: Path, labelled: Labelled, report: Mapping[str, Any], tell: Tell) -> None:
    """Write all masks anew that come out otherwise, and what is said of them."""
    tell("cutting all photos")
    names, cache = labelled.names, Cache(scene / HIDDEN)
    corrections, sizes = own_corrections(names.values(), scene), _sizes(scene)
    found = masks_of(labelled, corrections, cache)
    tell("writing masks")

    def full(photo: int) -> np.ndarray:
        return enlarged(found.masks[photo], *sizes[names[photo]])

    with disk_errors(scene):
        write_masks(scene, names, found, corrections.painted, full)
        masks = mask_report(labelled, found, corrections.names)
        before = mask_warnings(report)
        others = [text for text in report["warnings"] if text not in before]
        write_json(scene / _REPORT, {**report, **masks, "warnings": [*others, *mask_warnings(masks)]})
        colors = {name: cache.newest(f"photo-{name}", "color") for name in report["without_camera"]}
        lost = {
            name: (color, report["without_camera"][name])
            for name, color in colors.items()
            if color is not None
        }
        write_sheet(scene, labelled, found, lost)


def _sizes(scene: Path) -> dict[str, tuple[int, int]]:
    """Return the height and width of each photo, by name."""
    path = scene / _CAMERAS
    try:
        frames = read_object(path, _REMEDY)["frames"]
        return {Path(frame["mask_path"]).stem: (int(frame["h"]), int(frame["w"])) for frame in frames}
    except (KeyError, TypeError, ValueError) as error:
        raise InputError(f"{path} is not as prepare wrote it; {_REMEDY}.") from error
