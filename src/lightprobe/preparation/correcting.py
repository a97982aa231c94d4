"""A correction of one mask in a prepared scene, taken up by all of its masks within seconds."""

from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from lightprobe.core.errors import InputError
from lightprobe.core.files import disk_errors, named_file, write_json
from lightprobe.core.stored import read_object
from lightprobe.imaging import read_mask, write_mask
from lightprobe.preparation.cache import HIDDEN, Cache
from lightprobe.preparation.corrections import clicked_region
from lightprobe.preparation.labelled import Labelled, masks_of, read_labelled, signs_at
from lightprobe.preparation.mask_files import forget_corrections, keep_clicks, own_corrections, write_masks
from lightprobe.preparation.mask_report import mask_report, mask_warnings, write_sheet
from lightprobe.preparation.preparing import locked_scene
from lightprobe.preparation.undistortion import photo_mask, pinhole_place, replaced, small_mask

Tell = Callable[[str], None]

_REPORT, _CAMERAS = "prepare.json", "transforms.json"
_REMEDY = "prepare the scene anew"


def click_mask(scene: Path, name: str, at: tuple[float, float], is_object: bool, tell: Tell) -> None:
    """Correct a photo's mask by a click on what is the object, or is not, and all others by it.

    at: the place, in shares of the photo's width and height from its upper left corner. Raises as `correct_masks`,
    and `InputError` for a click on what is already as it is asked to be.
    """
    with _locked(scene):
        kept = _Kept.read(scene)
        photo, path = kept.photo(name), named_file(scene / "masks", name, ".png")
        view, evidence = kept.labelled.views[photo], kept.labelled.labelling.evidence[photo]
        fine = read_mask(path)
        small = small_mask(fine, view.camera)
        tell("finding what belongs together")
        region = clicked_region(view.color, evidence, small, pinhole_place(at, view.camera), is_object)
        corrections = own_corrections([name], scene)
        with disk_errors(scene):
            if name in corrections.painted:  # it stays as fine as it is where the click changes nothing
                write_mask(path, replaced(fine, small ^ region, region, view.camera))
            else:
                signs = signs_at(corrections.clicked.get(name, np.zeros(small.shape)), view.color)
                keep_clicks(scene, name, np.where(region, np.int8(1 if is_object else -1), signs))
        kept.correct(tell)


def correct_masks(scene: Path, tell: Tell) -> None:
    """Have all masks of a prepared scene take up those that a person changed in masks/.

    Raises `InputError` for a scene of an older version or with a damaged record, `ResourceError` when another process
    writes the scene.
    """
    with _locked(scene):
        _Kept.read(scene).correct(tell)


def forget_correction(scene: Path, name: str, tell: Tell) -> None:
    """Make a photo's mask as it would be had nobody changed it, and all others; raises as `correct_masks`."""
    with _locked(scene):
        kept = _Kept.read(scene)
        kept.photo(name)
        forget_corrections(scene, name)
        kept.correct(tell)


def _locked(scene: Path) -> AbstractContextManager[None]:
    """Keep others from writing a scene; raise `InputError` where there is none."""
    if not (scene / _REPORT).is_file():
        raise InputError(f"{scene} is no scene that prepare made, so its masks cannot be corrected.")
    return locked_scene(scene)


@dataclass(frozen=True)
class _Kept:
    """What a preparation kept, checked."""

    scene: Path
    labelled: Labelled
    report: dict[str, Any]
    sizes: dict[str, tuple[int, int]]  # height and width of each photo, by name

    @staticmethod
    def read(scene: Path) -> "_Kept":
        path = scene / _REPORT
        report = read_object(path, _REMEDY)
        labelled = read_labelled(Cache(scene / HIDDEN), str(report.get("labelling")))
        if labelled is None:
            raise InputError(
                f"{scene} was prepared by an older version, or what it kept is gone; give its prepare command once more."
            )
        numbers = []
        for key in ("mask_stability", "hint_box_iou"):
            numbers += [*report[key].values()] if isinstance(report.get(key), dict) else [None]
        told = all(
            isinstance(report.get(key), list) for key in ("warnings", "doubtful_masks", "doubtful_cameras")
        )
        told = told and isinstance(report.get("without_camera"), dict)
        if not told or not all(isinstance(number, int | float) for number in numbers):
            raise InputError(f"{path} is not as prepare wrote it; {_REMEDY}.")
        sizes = _sizes(scene)
        missing = set(labelled.names.values()) - set(sizes)
        if missing:
            raise InputError(f"{scene / _CAMERAS} lacks the photo {min(missing)}; {_REMEDY}.")
        return _Kept(scene, labelled, report, sizes)

    def photo(self, name: str) -> int:
        """Return the index of a photo; raise `InputError` where it has no camera."""
        for photo, found in self.labelled.names.items():
            if found == name:
                return photo
        raise InputError(f"The photo {name} has no camera, and so no mask.")

    def correct(self, tell: Tell) -> None:
        """Write all masks anew that come out otherwise, and what is said of them."""
        tell("cutting all photos")
        scene, report, names = self.scene, self.report, self.labelled.names
        cache, corrections = Cache(scene / HIDDEN), own_corrections(names.values(), scene)
        found = masks_of(self.labelled, corrections, cache)
        tell("writing masks")
        with disk_errors(scene):
            write_masks(
                scene, names, found, corrections.painted, lambda photo: self._full(photo, found.masks[photo])
            )
            masks = mask_report(self.labelled, found, corrections.names, report["doubtful_cameras"])
            before = mask_warnings(report)
            others = [text for text in report["warnings"] if text not in before]
            write_json(scene / _REPORT, {**report, **masks, "warnings": [*others, *mask_warnings(masks)]})
            colors = {name: cache.newest(f"photo-{name}", "color") for name in report["without_camera"]}
            lost = {
                name: (color, str(report["without_camera"][name]))
                for name, color in colors.items()
                if color is not None
            }
            write_sheet(scene, self.labelled, found, masks["doubtful_masks"], lost)

    def _full(self, photo: int, mask: np.ndarray) -> np.ndarray:
        """Return a mask (h, w) bool at its photo's size, (H, W) float32; of a given one, what is there stays as fine as it is."""
        name, view = self.labelled.names[photo], self.labelled.views[photo]
        path = named_file(self.scene / "masks", name, ".png")
        if view.fixed and view.given is not None and path.is_file():
            fine = read_mask(path)
            return replaced(fine, mask, mask != small_mask(fine, view.camera), view.camera)
        return photo_mask(mask, view.camera, *self.sizes[name])


def _sizes(scene: Path) -> dict[str, tuple[int, int]]:
    """Return the height and width of each photo, by name."""
    path = scene / _CAMERAS
    try:
        frames = read_object(path, _REMEDY)["frames"]
        return {Path(frame["mask_path"]).stem: (int(frame["h"]), int(frame["w"])) for frame in frames}
    except (KeyError, TypeError, ValueError, OverflowError) as error:
        raise InputError(f"{path} is not as prepare wrote it; {_REMEDY}.") from error
