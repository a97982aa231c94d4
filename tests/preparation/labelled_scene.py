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
from lightprobe.preparation.undistortion import photo_mask, through_lens
from lightprobe.preparation.voxel_labelling import Labelling, View
from lightprobe.preparation.writing import write_transforms
from lightprobe.scene.camera import Camera
from lightprobe.scene.hull import Hull
from lightprobe.scene.lens import Lens
from tests.preparation.tables import HALF, SIZE, world

LID = 0.2  # of the box: its upper part, which is missing
BLOCK = np.array([[0.5, -0.15, -HALF[2]], [0.7, 0.15, -HALF[2] + 0.2]])  # beside the box
VOXELS = 64
ZOOM = 0.9  # of the pinholes' pictures of photos through a lens


def labelled_scene(
    folder: Path, given: int | None = None, k: float = 0.0
) -> tuple[Labelled, dict[int, np.ndarray]]:
    """Write a scene of six photos, and return what is kept of it, and the true masks (h, w) bool by photo.

    given: a photo whose mask the user gave. k: of the lens of all photos; the masks are those of the pinholes' pictures.
    """
    views, truth, _, _ = world(places=1, photos=6)
    if k:
        lens = Lens((k,), zoom=ZOOM)
        views = {
            photo: replace(view, camera=replace(view.camera, lens=lens)) for photo, view in views.items()
        }
    if given is not None:
        views[given] = replace(views[given], given=truth[given], fixed=True)
    names = {photo: f"p_{photo}" for photo in views}
    cache = Cache(folder / HIDDEN)
    for photo, view in views.items():
        cache.keep(f"photo-{names[photo]}", "any", {"color": photo_color(view)})

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
        return Labelling(hull, hull, odds, shapes)

    labelled = kept_labelled(cache, "k", names, views, make)
    for photo, view in views.items():
        (folder / "images").mkdir(exist_ok=True)
        Image.fromarray(photo_color(view)).save(folder / "images" / f"{names[photo]}.png")
    found = masks_of(labelled, Corrections(), cache)
    write_masks(folder, names, found, (), lambda photo: written_mask(labelled, photo, found.masks[photo]))
    report = mask_report(labelled, found, (), ())
    words = ["The cameras may stand on their heads.", *mask_warnings(report)]
    write_json(
        folder / "prepare.json",
        {
            **report,
            "labelling": "k",
            "doubtful_cameras": [],
            "warnings": words,
            "without_camera": {"p_9": "blurred"},
        },
    )
    cameras = {names[photo]: own_camera(view.camera, k) for photo, view in views.items()}
    write_transforms(folder / "transforms.json", cameras, {name: f"{name}.png" for name in cameras}, {}, {})
    return labelled, truth


def own_camera(camera: Camera, k: float) -> Camera:
    """Return the camera of a photo as its lens took it, of that of its pinhole's picture."""
    zoom = 1.0 if camera.lens is None else ZOOM
    return through_lens(replace(camera, fx=camera.fx / zoom, fy=camera.fy / zoom, lens=None), k)


def photo_color(view: View) -> np.ndarray:
    """Return a photo (h, w, 3) uint8 as its lens took it, of its pinhole's picture: the nearest pixels."""
    camera = view.camera
    if camera.lens is None:
        return view.color
    rows, columns = np.mgrid[:SIZE, :SIZE] + 0.5
    x, y = (columns - camera.cx) / camera.fx, (rows - camera.cy) / camera.fy
    plane = camera.lens.undistort(np.stack([x, y], -1) * ZOOM)
    at = plane * (camera.fx, camera.fy) + (camera.cx, camera.cy)
    column, row = np.moveaxis(np.clip(at, 0, SIZE - 1).astype(int), -1, 0)
    return view.color[row, column]


def written_mask(labelled: Labelled, photo: int, mask: np.ndarray) -> np.ndarray:
    """Return a mask (h, w) bool of a pinhole's picture in its photo's pixels, (h, w) float32."""
    return photo_mask(mask, labelled.views[photo].camera, SIZE, SIZE)


def shown_at(labelled: Labelled, photo: int, point: np.ndarray) -> tuple[float, float]:
    """Return where a photo shows a point (3,), in shares of its size."""
    camera = labelled.views[photo].camera
    x, y, _ = camera.project(point[None])[0]
    if camera.lens is not None:
        plane = np.array([(x - camera.cx) / camera.fx, (y - camera.cy) / camera.fy])
        x, y = camera.lens.distort(plane) * (camera.fx / ZOOM) + (camera.cx, camera.cy)
    return x / SIZE, y / SIZE
