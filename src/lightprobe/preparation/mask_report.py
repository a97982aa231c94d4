"""What is said of a scene's masks: numbers for prepare.json, warnings, and the contact sheet."""

from collections.abc import Collection, Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import scipy

from lightprobe.preparation.labelled import Labelled, Masks
from lightprobe.preparation.writing import lost_cell, photo_cell, write_cells
from lightprobe.scene.consistency import overlap

# Stability below which a mask is doubtful. Of 304 masks with right cameras 91 % of the right ones (IoU .9 with the truth) are
# above it, and of those above it 1 % are wrong: docs/decisions/bare-photos.md.
_STABLE = 0.9
_LOST_OF_HINT = 0.8  # IoU of the boxes around hint and mask below which a part of the object is lost


def mask_report(
    labelled: Labelled, found: Masks, corrected: Iterable[str], doubtful_cameras: Collection[str]
) -> dict[str, Any]:
    """Return the part of prepare.json that is about masks.

    corrected: names of photos whose masks a person changed. doubtful_cameras: names of photos; their masks are doubtful, too.
    """
    names = labelled.names
    stability = {names[i]: round(value, 4) for i, value in found.stability.items()}
    boxes = {names[i]: round(value, 4) for i, value in hint_overlaps(labelled, found).items()}
    return {
        "mask_stability": stability,
        "doubtful_masks": [
            name for name, value in stability.items() if value < _STABLE or name in doubtful_cameras
        ],
        "hint_box_iou": boxes,
        "masks_corrected": sorted(corrected),
    }


def mask_warnings(report: Mapping[str, Any]) -> list[str]:
    """Return the sentences about masks that may be wrong. report: as from `mask_report`."""
    found, stability, doubtful = [], report["mask_stability"], report["doubtful_masks"]
    if not any(stability.values()):  # no voxel is the object's
        found.append("The masks do not fit together in space; look at contact.png and give a --hint.")
    elif doubtful:
        few = 2 * len(doubtful) <= len(stability)
        by_hint = "look at contact.png; a --hint tells what the object is"
        remedy = "correct them with: lightprobe view SCENE" if few else by_hint
        found.append(
            f"Masks are doubtful in {len(doubtful)} of {len(stability)} photos, such as {doubtful[0]}: a part may be cut off "
            f"or added; {remedy}."
        )
    for name, value in report["hint_box_iou"].items():
        if value < _LOST_OF_HINT:
            found.append(
                f"In {name} the mask that was found does not reach as far as the hint, or farther: the "
                f"boxes around them have IoU {value:.2f}. A part may be wrong in all photos; look at contact.png."
            )
    return found


def hint_overlaps(labelled: Labelled, found: Masks) -> dict[int, float]:
    """Return by photo the IoU of the boxes around the mask that was found and the hint that was given for it.

    What all masks lose alike their hull loses, too, and agrees with them; the hint does not.
    """
    return {
        photo: overlap(_boxed(found.masks[photo]), _boxed(view.given))
        for photo, view in labelled.views.items()
        if view.given is not None and not view.fixed
    }


def _boxed(mask: np.ndarray) -> np.ndarray:
    """Return the upright box around a mask, (h, w) bool both."""
    picture = np.zeros(mask.shape, bool)
    for box in scipy.ndimage.find_objects(mask.astype(int)):
        picture[box] = True
    return picture


def write_sheet(
    output: Path,
    labelled: Labelled,
    found: Masks,
    doubtful: Collection[str],
    lost: Mapping[str, tuple[np.ndarray, str]],
) -> None:
    """Write contact.png: photos with the outlines of their masks, the doubtful ones first, at last those without camera.

    doubtful: names of photos whose masks are. lost: by name, the colours (h, w, 3) uint8 of a photo without a camera, and why
    it has none.
    """
    names = labelled.names
    cells = [
        photo_cell(
            names[i], labelled.views[i].color, found.masks[i], found.stability[i], names[i] in doubtful
        )
        for i in sorted(labelled.views, key=lambda i: names[i] not in doubtful)
    ]
    cells += [lost_cell(name, color, why) for name, (color, why) in lost.items()]
    write_cells(output / "contact.png", cells)
