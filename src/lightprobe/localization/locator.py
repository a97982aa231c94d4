"""One photo of a known object in; the camera that took it, the object's mask and a verdict on both out."""

import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np
import torch

from lightprobe.core.device import full_precision
from lightprobe.core.errors import InputError
from lightprobe.core.run import RunFolder
from lightprobe.imaging import (
    focal_ratio,
    image_size,
    read_mask,
    read_photo,
    shrink_area,
    turned_size,
    worked_size,
)
from lightprobe.localization.foreground import hidden_share, magnified
from lightprobe.localization.known_object import KnownObject
from lightprobe.localization.level import Levels
from lightprobe.localization.located import Located
from lightprobe.localization.pose_search import Candidate, PoseFinder
from lightprobe.localization.silhouette import inside_share, silhouette
from lightprobe.localization.verdict import PoseStatus, PoseVerdict, rival_scores
from lightprobe.localization.views import KnownViews
from lightprobe.models import Decomposition
from lightprobe.scene import load_scene
from lightprobe.scene.camera import Camera, Similarity
from lightprobe.scene.consistency import look_inverted, overlap
from lightprobe.scene.masks import mask_turn
from lightprobe.scene.record import read_record

_BLACK, _WHITE = (
    1e-4,
    0.99,
)  # greatest linear value, and share of clipped values, of a photo that shows nothing
_NARROWEST = 8  # pixels of the shorter side, of what is located
_SIDE = 1024  # pixels of the longer side at which a photo is located


class Locator:
    """Locates photos of one object; holds its asset and views, so that several photos load them once."""

    def __init__(self, decomposition: Decomposition, views: KnownViews, device: torch.device | None = None):
        """Move the asset to `device` (default: the CPU)."""
        where = full_precision(device or torch.device("cpu"))
        self._decomposition = replace(decomposition, asset=decomposition.asset.to(where))
        self._known = KnownObject(self._decomposition.asset)
        self._finder = PoseFinder(self._known, views)

    @staticmethod
    def load(run: Path | str, device: torch.device | None = None) -> "Locator":
        """Return the locator of a run folder whose Phase I has finished.

        A run that has no views yet gets them from its scene's photos. Raises `InputError` when these are gone
        or the run has no object, `ConfigError` without OpenCV.
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
        with _one_torch_thread():
            return self._locate(Path(image), None if mask is None else Path(mask), focal)

    def _locate(self, image: Path, mask: Path | None, focal: float | None) -> Located:
        begin = time.perf_counter()
        color, given, clipped = _read(image, mask)
        for is_so, word in ((color.max() <= _BLACK, "black"), (clipped.mean() >= _WHITE, "white")):
            if is_so:
                raise InputError(f"{image} is {word} all over.")
        width, height = image_size(image)
        if focal is None:
            ratio = focal_ratio(image)
            focal = None if ratio is None else ratio * max(width, height)
        seen = color if given is None else color * given[..., None]
        small = shrink_area(seen, _SIDE)
        if min(small.shape[:2]) < _NARROWEST:
            raise InputError(
                f"{image} has {width} x {height} pixels, too narrow a strip to find the object in."
            )
        levels, scale = Levels(small), max(small.shape[:2]) / max(width, height)
        found = self._finder.find(levels, None if focal is None else focal * scale)
        if not found:
            raise InputError(
                f"{image}: nothing in this photo looks like the object; give its camera with --camera."
            )
        best = found[0]
        camera = best.camera.resized(width, height)
        if given is not None and self._is_inverted(given, camera):
            raise InputError(f"{mask or image} looks inverted; the object must be white or opaque.")
        verdict = self._verdict(found, camera, self._finder.leeway(levels, best.camera))
        if verdict.status is PoseStatus.REFUSED:
            raise InputError(f"{image}: {' '.join(verdict.sentences)}")
        restored = _restored(camera, self._decomposition.similarity)
        if given is None:
            cover = silhouette(self._decomposition.asset, camera.resized(color.shape[1], color.shape[0]))
            given = cover * (1 - magnified(hidden_share(self._known, levels, best.camera), cover.shape))
        return Located(restored, given, verdict, color, clipped, time.perf_counter() - begin)

    def _is_inverted(self, mask: np.ndarray, camera: Camera) -> bool:
        """Tell whether a mask (H, W) that fills the photo's rim leaves out the object where `camera` sees it."""
        if not look_inverted([mask]):
            return False
        shape = silhouette(self._decomposition.asset, camera.resized(mask.shape[1], mask.shape[0])) >= 0.5
        return overlap(mask < 0.5, shape) > overlap(mask >= 0.5, shape)

    def _verdict(self, found: list[Candidate], camera: Camera, leeway: float) -> PoseVerdict:
        best, scores = found[0], [candidate.fit.score for candidate in found]
        inside = inside_share(self._decomposition.asset, camera)
        return PoseVerdict(
            best.fit.score,
            best.fit.explained,
            best.fit.edges,
            inside,
            best.inliers,
            rival_scores(scores),
            leeway,
        )


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
    """Return camera and mask of one photo of a run's object; of several photos `Locator.load` loads the run
    once.

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
    """Return linear colour (H, W, 3), the object's coverage (H, W), None where it is not known, and what is
    clipped.

    The last is (H, W, 3) bool. They are reduced to the pixels that are worked on at once.
    """
    width, height = image_size(image)
    turn = 1 if mask is None else mask_turn(mask, image, (width, height))
    found = (width, height) if mask is None else turned_size(image_size(mask, orient=False), turn)
    if found != (width, height):
        raise InputError(
            f"{mask} has {found[0]} x {found[1]} pixels, but its photo has {width} x {height}; a mask needs the size "
            "of its photo."
        )
    size = worked_size(image, (height, width))
    color, alpha, clipped = read_photo(image, size=size)
    if mask is not None:
        alpha = read_mask(mask, turn=turn, size=size)
    if alpha is None or float(alpha.min()) > 0.99:
        return color, None, clipped
    if float(alpha.max()) < 0.5:
        raise InputError(f"{mask or image} shows no object in its mask; the object must be white or opaque.")
    return color, alpha, clipped


def _restored(camera: Camera, similarity: Similarity) -> Camera:
    """Return a normalised-frame camera in the input frame."""
    pose = camera.camera_to_world.copy()
    pose[:3, 3] = similarity.invert(camera.position)
    return replace(camera, camera_to_world=pose)
