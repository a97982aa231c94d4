"""A prepared scene of a box whose lid is missing and beside which a block is taken for the object, in all masks."""

from dataclasses import replace
from pathlib import Path

import numpy as np
from PIL import Image

from lightprobe.core.files import write_json
from lightprobe.preparation.cache import HIDDEN, Cache
from lightprobe.preparation.corrections import Corrections
from lightprobe.preparation.labelled import Labelled, kept_labelled, masks_of
from lightprobe.preparation.mask_files import write_masks
from lightprobe.preparation.mask_report import mask_report, mask_warnings
from lightprobe.preparation.voxel_labelling import Labelling
from lightprobe.preparation.writing import write_transforms
from lightprobe.scene.hull import Hull
from tests.preparation.tables import HALF, SIZE, world

LID = 0.2  # of the box: its upper part, which is missing
BLOCK = np.array([[0.5, -0.15, -HALF[2]], [0.7, 0.15, -HALF[2] + 0.2]])  # beside the box
VOXELS = 64


def labelled_scene(folder: Path, given: int | None = None) -> tuple[Labelled, dict[int, np.ndarray]]:
    """Write a scene of six photos, and return what is kept of it, and the true masks (h, w) bool by photo.

    given: a photo whose mask the user gave.
    """
    views, truth, _, _ = world(places=1, photos=6)
    if given is not None:
        views[given] = replace(views[given], given=truth[given], fixed=True)
    names = {photo: f"p_{photo}" for photo in views}
    cache = Cache(folder / HIDDEN)
    for photo, view in views.items():
        cache.keep(f"photo-{names[photo]}", "any", {"color": view.color})

    def make() -> Labelling:
        empty = Hull(
            np.zeros((VOXELS,) * 3, bool), np.zeros((VOXELS,) * 3, np.float32), -np.ones(3), np.ones(3)
        )
        centers = empty.centers(~empty.occupancy)
        box = (np.abs(centers) <= HALF).all(axis=1) & (centers[:, 2] < HALF[2] - LID)
        block = ((centers >= BLOCK[0]) & (centers <= BLOCK[1])).all(axis=1)
        hull = Hull((box | block).reshape(empty.occupancy.shape), empty.score, empty.lo, empty.hi)
        shapes = {photo: hull.silhouette(view.camera) for photo, view in views.items()}
        odds = {photo: np.where(shape, np.float32(3), np.float32(-3)) for photo, shape in shapes.items()}
        return Labelling(hull, odds, shapes)

    labelled = kept_labelled(cache, "k", names, views, make)
    for photo, view in views.items():
        (folder / "images").mkdir(exist_ok=True)
        Image.fromarray(view.color).save(folder / "images" / f"{names[photo]}.png")
    found = masks_of(labelled, Corrections(), cache)
    write_masks(folder, names, found, (), lambda photo: found.masks[photo].astype(np.float32))
    report = mask_report(labelled, found, ())
    words = ["The cameras may stand on their heads.", *mask_warnings(report)]
    write_json(
        folder / "prepare.json",
        {**report, "labelling": "k", "warnings": words, "without_camera": {"p_9": "blurred"}},
    )
    cameras = {names[photo]: view.camera for photo, view in views.items()}
    write_transforms(folder / "transforms.json", cameras, {name: f"{name}.png" for name in cameras}, {}, {})
    return labelled, truth


def shown_at(labelled: Labelled, photo: int, point: np.ndarray) -> tuple[float, float]:
    """Return where a photo shows a point (3,), in shares of its size."""
    x, y, _ = labelled.views[photo].camera.project(point[None])[0]
    return x / SIZE, y / SIZE
