"""The object's voxels and what photos show of it, kept so that a correction of masks starts from them."""

import json
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass

import numpy as np

from lightprobe.core.threads import in_threads
from lightprobe.imaging import resize_area
from lightprobe.preparation.cache import Cache, array_key, key_of
from lightprobe.preparation.corrections import Change, Corrections, corrected
from lightprobe.preparation.outlines import outlined_mask, stability
from lightprobe.preparation.salient_object import odds_of_bytes, odds_to_bytes
from lightprobe.preparation.undistortion import small_mask, undistorted
from lightprobe.preparation.voxel_labelling import Labelling, View, is_box
from lightprobe.scene.camera import Camera
from lightprobe.scene.hull import Hull

_STEP = "labels"


@dataclass(frozen=True)
class Labelled:
    """Photos that have a camera, by their index, and the object's voxels in them."""

    names: Mapping[int, str]
    views: Mapping[int, View]
    labelling: Labelling


@dataclass(frozen=True)
class Masks:
    """Masks of photos, by their index."""

    masks: dict[int, np.ndarray]  # (h, w) bool, small, as through a pinhole
    stability: dict[int, float]  # as in `outlines.stability`
    keys: dict[int, str]  # of all that each mask, in its photo's pixels, depends on


def kept_labelled(
    cache: Cache,
    key: str,
    names: Mapping[int, str],
    views: Mapping[int, View],
    make: Callable[[], Labelling],
) -> Labelled:
    """Return photos with the labelling that is kept under `key`, or that `make` makes."""

    def arrays() -> dict[str, np.ndarray]:
        made = make()
        found = {"occupancy": made.hull.occupancy, "lo": made.hull.lo, "hi": made.hull.hi}
        found["widest"] = made.widest.occupancy
        found["photos"] = np.array(list(views), np.int64)
        found["names"] = np.array([names[photo] for photo in views])
        found["cameras"] = np.array([json.dumps(view.camera.to_json()) for view in views.values()])
        found["fixed"] = np.array([view.fixed for view in views.values()])
        for photo, view in views.items():
            found[f"shape-{photo}"] = made.shapes[photo]
            found[f"odds-{photo}"] = odds_to_bytes(made.evidence[photo])
            if view.given is not None:
                found[f"given-{photo}"] = view.given
        return found

    return Labelled(names, views, _labelling(cache.arrays(_STEP, key, arrays)))


def is_kept(cache: Cache, key: str) -> bool:
    """Tell whether something is kept under `key`."""
    found = cache.newest(_STEP, "key")
    return found is not None and str(found) == key


def read_labelled(cache: Cache, key: str) -> Labelled | None:
    """Return what `kept_labelled` kept under `key`; None where it, or a photo's small picture, is not there."""
    kept = cache.find(_STEP, key)
    if kept is None:
        return None
    photos = [int(photo) for photo in kept["photos"]]
    names = {photo: str(name) for photo, name in zip(photos, kept["names"], strict=True)}
    views = {}
    for row, photo in enumerate(photos):
        color = cache.newest(f"photo-{names[photo]}", "color")
        height, width = kept[f"odds-{photo}"].shape
        if color is None or color.shape[:2] != (height, width):
            return None
        camera = Camera.from_json(json.loads(str(kept["cameras"][row])), source=str(cache.folder))
        color = undistorted(color, camera)
        views[photo] = View(camera, color, kept.get(f"given-{photo}"), bool(kept["fixed"][row]))
    return Labelled(names, views, _labelling(kept))


def _labelling(kept: Mapping[str, np.ndarray]) -> Labelling:
    hull, widest = (
        Hull(kept[name], kept[name].astype(np.float32), kept["lo"], kept["hi"])
        for name in ("occupancy", "widest")
    )
    odds = {int(photo): odds_of_bytes(kept[f"odds-{photo}"]) for photo in kept["photos"]}
    return Labelling(hull, widest, odds, {photo: kept[f"shape-{photo}"] for photo in odds})


def masks_of(labelled: Labelled, corrections: Corrections, cache: Cache) -> Masks:
    """Return the masks of all photos, which take up what a person corrected in some.

    Masks that come out as before are kept.
    """
    views = labelled.views
    painted = {i: small_mask(told, views[i].camera) for i, told in _told(labelled, corrections.painted)}
    clicked = {i: signs_at(told, views[i].color) for i, told in _told(labelled, corrections.clicked)}
    hints = {i: view.given for i, view in views.items() if view.given is not None and not view.fixed}
    hinted = {i: mask for i, mask in hints.items() if i not in painted and not is_box(mask)}
    first = _outlines(labelled, labelled.labelling, {*painted, *hinted}, cache, "uncorrected")
    changes = {photo: Change.hinted(first[photo].mask, mask) for photo, mask in hinted.items()}
    changes |= {photo: Change.painted(first[photo].mask, mask) for photo, mask in painted.items()}
    for photo, signs in clicked.items():
        if photo not in painted:
            change = Change.clicked(signs)
            changes[photo] = change | changes[photo] if photo in changes else change
    labelling = corrected(labelled.labelling, views, changes)
    found = _outlines(labelled, labelling, views, cache, "mask")
    for photo in {*painted, *clicked}:
        change = changes[photo]
        own = painted[photo] if photo in painted else (found[photo].mask | change.added) & ~change.removed
        found[photo] = _Outline(own, found[photo].stability, key_of(array_key(own)))
    return Masks(
        {photo: each.mask for photo, each in found.items()},
        {photo: each.stability for photo, each in found.items()},
        {photo: key_of(each.key, views[photo].camera.to_json().get("lens")) for photo, each in found.items()},
    )


@dataclass(frozen=True)
class _Outline:
    mask: np.ndarray  # (h, w) bool
    stability: float
    key: str


def _outlines(
    labelled: Labelled, labelling: Labelling, photos: Collection[int], cache: Cache, step: str
) -> dict[int, _Outline]:
    """Return the masks of some photos, kept under the step's name."""

    def work(photo: int) -> _Outline:
        view, evidence, shape = labelled.views[photo], labelling.evidence[photo], labelling.shapes[photo]
        widest = labelling.widest.silhouette(view.camera)

        def make() -> dict[str, np.ndarray]:
            return {"mask": outlined_mask(view, evidence, shape)}

        if view.fixed and view.given is not None:
            return _Outline(view.given, stability(view.given, shape, widest), key_of(array_key(view.given)))
        key = key_of(
            *(None if each is None else array_key(each) for each in (view.color, evidence, shape, view.given))
        )
        mask = cache.arrays(f"{step}-{labelled.names[photo]}", key, make)["mask"]
        return _Outline(mask, stability(mask, shape, widest), key)

    return dict(zip(photos, in_threads(work, photos), strict=True))


def _told(labelled: Labelled, told: Mapping[str, np.ndarray]) -> list[tuple[int, np.ndarray]]:
    """Return pictures (H, W), by the photo's name, with its index."""
    return [(photo, told[name]) for photo, name in labelled.names.items() if name in told]


def signs_at(told: np.ndarray, color: np.ndarray) -> np.ndarray:
    """Return what clicks told, (H, W) of a pinhole's picture, at the size of a small picture (h, w, 3): -1, 0 or 1, (h, w) int8."""
    small = resize_area(told.astype(np.float32), *color.shape[:2])
    return np.where(small >= 0.5, 1, np.where(small < -0.5, -1, 0)).astype(np.int8)
