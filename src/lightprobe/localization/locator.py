"""One photo of a known object in; the camera that took it, the object's mask and a verdict on both out."""

import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import scipy
import torch
from PIL import Image

from lightprobe import imaging
from lightprobe.core.device import full_precision
from lightprobe.core.errors import InputError
from lightprobe.core.files import atomic_path, write_json
from lightprobe.core.run import RunFolder
from lightprobe.localization.appearance import PhotoPyramid
from lightprobe.localization.foreground import hidden_share, magnified
from lightprobe.localization.known_object import KnownObject
from lightprobe.localization.pose_search import PoseFinder
from lightprobe.localization.verdict import PoseStatus, PoseVerdict, rival_scores
from lightprobe.localization.views import KnownViews
from lightprobe.models import Decomposition
from lightprobe.scene import load_scene
from lightprobe.scene.camera import Camera
from lightprobe.scene.consistency import looks_inverted, overlap
from lightprobe.scene.masks import mask_turn
from lightprobe.scene.overlay import HULL_COLOR
from lightprobe.scene.photo import Pixels
from lightprobe.scene.record import read_record

_OVERLAY_SIDE = 1024  # pixels of the overlay's longer side, at most
_BLACK, _WHITE = 1e-4, 0.99  # greatest linear value, and share of clipped values, of a photo of nothing
_NARROWEST = 8  # pixels of the shorter side, of what is located
_SIDE = 1024  # pixels of the longer side at which a photo is located


@dataclass(frozen=True)
class Located:
    """A photo of the object with the camera that took it."""

    camera: Camera  # input frame, pixels of the photo
    mask: np.ndarray  # (H, W) float32 in [0, 1], coverage of the object; a large photo's is reduced
    verdict: PoseVerdict
    color: np.ndarray  # (H, W, 3) float32 the photo, linear, background included, reduced as the mask is
    clipped: np.ndarray  # (H, W, 3) bool: the photo's white hides how bright it was, background included
    seconds: float

    @property
    def pixels(self) -> Pixels:
        """The photo as `Predictor.predict` takes it with `pixel_camera`: linear, black beside the mask."""
        inside = self.mask[..., None] > 0
        return Pixels(self.color * inside, self.mask, self.clipped & inside)

    @property
    def pixel_camera(self) -> Camera:
        """The camera of `pixels`, which are reduced where the photo is large."""
        return self.camera.resized(self.mask.shape[1], self.mask.shape[0])

    def to_json(self) -> dict[str, Any]:
        """Return the camera as the JSON that `--camera` reads, with the verdict beside it; no pixels."""
        return {**self.camera.to_json(), "verdict": self.verdict.to_json()}

    def save_camera(self, path: Path) -> None:
        """Write `to_json`."""
        write_json(Path(path), self.to_json())

    def save_mask(self, path: Path) -> None:
        """Write the mask at the photo's size as PNG, white object on black."""
        imaging.write_mask(Path(path), self.mask, (self.camera.height, self.camera.width))

    def save_overlay(self, path: Path) -> None:
        """Write the photo with the outline of the mask over it, as PNG of at most 1024 pixels."""
        write_overlay(Path(path), self.color, self.mask)


def write_overlay(path: Path, color: np.ndarray, mask: np.ndarray) -> None:
    """Write a linear photo (H, W, 3) with the outline of a mask (H, W) as PNG of at most 1024 pixels."""
    picture = imaging.srgb_encode(np.clip(imaging.shrink_area(color, _OVERLAY_SIDE), 0, 1))
    shown = np.rint(255 * picture).astype(np.uint8)
    inside = imaging.shrink_area(mask, _OVERLAY_SIDE) >= 0.5
    outline = scipy.ndimage.binary_dilation(inside) & ~inside
    if max(inside.shape) >= _OVERLAY_SIDE // 2:
        outline = scipy.ndimage.binary_dilation(outline)  # as thick as in small pictures
    shown[outline] = HULL_COLOR
    with atomic_path(path) as temporary:
        Image.fromarray(shown).save(temporary, format="PNG")


class Locator:
    """Locates photos of one object; holds its asset and views, so that several photos load them once."""

    def __init__(self, decomposition: Decomposition, views: KnownViews, device: torch.device | None = None):
        """Move the asset to `device` (default: the CPU)."""
        where = full_precision(device or torch.device("cpu"))
        self._similarity = decomposition.similarity
        self._known = KnownObject(decomposition.asset.to(where))
        self._finder = PoseFinder(self._known, views)

    @staticmethod
    def load(run: Path | str, device: torch.device | None = None) -> "Locator":
        """Return the locator of a run folder whose Phase I has finished.

        A run that has no views yet gets them from its scene's photos. Raises `InputError` when these are gone
        or the run has no object, `ConfigError` without the extra `photos`.
        """
        folder = RunFolder.open(Path(run))
        decomposition = Decomposition.load(folder, device or torch.device("cpu"), calibrated=False)
        return Locator(decomposition, stored_views(folder, decomposition), device)

    @torch.no_grad()
    def locate(
        self, image: Path | str, *, mask: Path | str | None = None, focal: float | None = None
    ) -> Located:
        """Return camera and mask of one photo.

        mask: white object on black, if known; it is kept as it is. A photo with transparent parts brings its
        own. focal: focal length in pixels; by default the EXIF's, or it is found with the pose. Raises
        `InputError` when the photo cannot be read or the object is not found in it.
        """
        image, mask = Path(image), None if mask is None else Path(mask)
        begin = time.perf_counter()
        color, given, clipped = _read(image, mask)
        for is_so, word in ((color.max() <= _BLACK, "black"), (clipped.mean() >= _WHITE, "white")):
            if is_so:
                raise InputError(f"{image} is {word} all over.")
        width, height = imaging.image_size(image)
        if focal is None:
            ratio = imaging.focal_ratio(image)
            focal = None if ratio is None else self._finder.calibrated(ratio) * max(width, height)
        seen = color if given is None else color * given[..., None]
        small = imaging.shrink_area(seen, _SIDE)
        if min(small.shape[:2]) < _NARROWEST:
            raise InputError(
                f"{image} has {width} x {height} pixels, too narrow a strip to find the object in."
            )
        pyramid, scale = PhotoPyramid(small), max(small.shape[:2]) / max(width, height)
        matches = self._finder.matches(pyramid)
        with _one_torch_thread():
            found = self._finder.find(pyramid, matches, None if focal is None else focal * scale)
        if not found:
            raise InputError(
                f"{image}: nothing in this photo looks like the object; give its camera with --camera."
            )
        best = found[0]
        camera = best.camera.resized(width, height)
        if given is not None and self._is_inverted(given, camera):
            raise InputError(f"{mask or image} looks inverted; the object must be white or opaque.")
        uncertainty = self._finder.pose_uncertainty(pyramid, best.camera)
        verdict = PoseVerdict(
            best.fit.score,
            best.fit.explained,
            best.fit.edges,
            best.fit.agreed,
            self._known.inside_share(camera),
            rival_scores([pose.fit.score for pose in found]),
            uncertainty,
        )
        if verdict.status is PoseStatus.REFUSED:
            raise InputError(f"{image}: {' '.join(verdict.sentences)}")
        if given is None:
            cover = self._known.silhouette(camera.resized(color.shape[1], color.shape[0]))
            hidden = hidden_share(self._known, pyramid, best.camera)
            given = cover * (1 - magnified(hidden, cover.shape)) if hidden.any() else cover
        pose = camera.camera_to_world.copy()
        pose[:3, 3] = self._similarity.invert(camera.position)  # in the input frame
        camera = replace(camera, camera_to_world=pose)
        return Located(camera, given, verdict, color, clipped, time.perf_counter() - begin)

    def _is_inverted(self, mask: np.ndarray, camera: Camera) -> bool:
        """Tell whether a mask (H, W) that fills the photo's rim leaves out the object."""
        if not looks_inverted(mask):
            return False
        shape = self._known.silhouette(camera.resized(mask.shape[1], mask.shape[0])) >= 0.5
        return overlap(mask < 0.5, shape) > overlap(mask >= 0.5, shape)


@contextmanager
def _one_torch_thread() -> Iterator[None]:
    """Let PyTorch use one thread meanwhile.

    Poses are refined in many short steps, between which PyTorch's threads wait by spinning, and take the
    cores from those of OpenCV and of the compiled loops: on two cores one thread is twice as fast.
    """
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(before)


def locate(run: Path | str, image: Path | str, *, mask: Path | str | None = None) -> Located:
    """Return camera and mask of one photo of a run's object; for several photos use `Locator.load` once.

    Raises `InputError` when the run or the photo cannot be used or the object is not found in it.
    """
    return Locator.load(run).locate(image, mask=mask)


def stored_views(run: RunFolder, decomposition: Decomposition) -> KnownViews:
    """Return the views that a run keeps, made from its scene's photos and kept where it has none yet.

    Raises `InputError` when there are none and the photos are gone.
    """
    if run.views_file.is_file():
        return KnownViews.load(run.views_file)
    root = read_record(run).root
    if not root.is_dir():
        raise InputError(
            f"{run.path} does not know yet how its object looks in photos, and its photos are no longer in {root}; "
            "bring them back there, or give the photo's camera with --camera."
        )
    views = KnownViews.of(decomposition, load_scene(root))
    with run.writing():
        views.save(run.views_file)
    return views


def _read(image: Path, mask: Path | None) -> tuple[np.ndarray, np.ndarray | None, np.ndarray]:
    """Return linear colour (H, W, 3), coverage (H, W) or None, and what is clipped (H, W, 3) bool."""
    width, height = imaging.image_size(image)
    turn = 1 if mask is None else mask_turn(mask, image, (width, height))
    found = (
        (width, height) if mask is None else imaging.turned_size(imaging.image_size(mask, orient=False), turn)
    )
    if found != (width, height):
        raise InputError(
            f"{mask} has {found[0]} x {found[1]} pixels, but its photo has {width} x {height}; a mask needs the size "
            "of its photo."
        )
    size = imaging.worked_size(image, (height, width))
    color, alpha, clipped = imaging.read_photo(image, size=size)
    if mask is not None:
        alpha = imaging.read_mask(mask, turn=turn, size=size)
    if alpha is None or float(alpha.min()) > 0.99:
        return color, None, clipped
    if float(alpha.max()) < 0.5:
        raise InputError(f"{mask or image} shows no object in its mask; the object must be white or opaque.")
    return color, alpha, clipped
