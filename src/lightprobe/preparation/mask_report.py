"""What is said of a scene's masks: numbers for prepare.json, warnings, and the contact sheet."""

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import scipy

from lightprobe.preparation.labelled import Labelled, Masks
from lightprobe.preparation.writing import LOW_AGREEMENT, lost_cell, photo_cell, write_cells
from lightprobe.scene.consistency import overlap

_DOUBTFUL = 0.86  # mean agreement of photos about the object below which all masks are doubtful
_LOST_OF_HINT = 0.8  # IoU of the boxes around hint and mask below which a part of the object is lost


def mask_report(labelled: Labelled, found: Masks, corrected: Iterable[str]) -> dict[str, Any]:
    """Return the part of prepare.json that is about masks. corrected: names of photos whose masks a person changed."""
    names = labelled.names
    agreement = {names[i]: round(value, 4) for i, value in found.agreement.items()}
    boxes = {names[i]: round(value, 4) for i, value in hint_overlaps(labelled, found).items()}
    return {
        "mask_agreement_mean": float(np.mean(list(agreement.values()))),
        "mask_agreement": agreement,
        "hint_box_iou": boxes,
        "masks_corrected": sorted(corrected),
    }


def mask_warnings(report: Mapping[str, Any]) -> list[str]:
    """Return the sentences about masks that may be wrong. report: as from `mask_report`."""
    found, mean = [], report["mask_agreement_mean"]
    if mean == 0:  # no voxel is the object's
        found.append("The masks do not fit together in space; look at contact.png and give a --hint.")
    elif mean < _DOUBTFUL:
        found.append(
            f"The masks are doubtful: what single photos show of the object agrees with what all of them show at IoU "
            f"{mean:.2f} only. Look at contact.png; a --hint tells what the object is."
        )
    for name, value in report["hint_box_iou"].items():
        if value < _LOST_OF_HINT:
            found.append(
                f"In {name} the mask that was found does not reach as far as the hint, or farther: the "
                f"boxes around them have IoU {value:.2f}. A part may be wrong in all photos; look at contact.png."
            )
    low = [name for name, value in report["mask_agreement"].items() if value < LOW_AGREEMENT]
    if low and mean > 0:
        found.append(
            f"{len(low)} masks disagree with the others, such as that of {low[0]}; correct them with: lightprobe view SCENE."
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
    output: Path, labelled: Labelled, found: Masks, lost: Mapping[str, tuple[np.ndarray, str]]
) -> None:
    """Write contact.png: photos with the outlines of their masks, the doubtful ones first, at last those without camera.

    lost: by name, the colours (h, w, 3) uint8 of a photo without a camera, and why it has none.
    """
    doubtful_first = sorted(labelled.views, key=lambda i: found.agreement[i] >= LOW_AGREEMENT)
    cells = [
        photo_cell(labelled.names[i], labelled.views[i].color, found.masks[i], found.agreement[i])
        for i in doubtful_first
    ]
    cells += [lost_cell(name, color, why) for name, (color, why) in lost.items()]
    write_cells(output / "contact.png", cells)
