"""Do masks and cameras agree? The visual hull's silhouettes against the masks.

Overlap is intersection over union (IoU) of silhouette and mask in pixels: 1 is agreement.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from lightprobe.core.errors import InputError
from lightprobe.imaging import shrink_area
from lightprobe.scene.camera import Camera, Similarity
from lightprobe.scene.hull import Hull, visual_hull
from lightprobe.scene.normalise import first_guess

_SIDE = 128  # pixels along the longer side of a view's mask
_VOXELS = 0.6  # along an edge of a trial's hull, for each pixel of the masks' longer side
_ROOM = 1.3  # of the searched cube around the first guess of the object's size
_SEEN_BY = 0.2  # share of the photos that must see a voxel: what few see lies far behind the object
_RIM = 0.9  # share of a photo's border that an inverted mask fills
_HOLE = 0.01  # share of a photo that an inverted mask leaves out


@dataclass(frozen=True)
class View:
    """A photo's camera and mask, of the same size."""

    name: str
    camera: Camera  # input frame, without a lens
    mask: np.ndarray  # (h, w) float32 in [0, 1], coverage of the object
    orientation: int = 1  # EXIF's, 1 where the file tells none

    @staticmethod
    def of(name: str, camera: Camera, alpha: np.ndarray, orientation: int) -> "View":
        """Return the view of an input-frame camera and its mask `alpha` (H, W), of at most 128 pixels a side."""
        return View(name, replace(camera, lens=None), alpha, orientation).within(_SIDE)

    def within(self, side: int) -> "View":
        """Return the view with sides of at most `side` pixels."""
        mask = shrink_area(self.mask, side)
        return replace(self, mask=mask, camera=self.camera.resized(mask.shape[1], mask.shape[0]))

    def agreement(self, hull: Hull) -> float:
        """Return the IoU of the mask and a hull in the input frame."""
        return overlap(self.mask >= 0.5, hull.silhouette(self.camera))


def trial_hull(views: Sequence[View], share: float | None = None) -> Hull | None:
    """Return a coarse hull of `views` in their frame, or None where their masks share no point of space.

    share: of the masks that must agree; by default as `visual_hull` has it. The hull ends at the walls of the
    volume that the masks point to, so that photos from one side have one, too.
    """
    cameras, masks = [view.camera for view in views], [view.mask for view in views]
    try:
        center, radius = first_guess(cameras, masks)
    except InputError:
        return None
    low, high = center - _ROOM * radius, center + _ROOM * radius
    fine = int(_VOXELS * max(max(mask.shape) for mask in masks))
    for voxels in (fine // 2, fine):
        hull = visual_hull(cameras, masks, voxels, lo=low, hi=high, seen_by=_SEEN_BY)
        if share is not None:
            hull = replace(hull, occupancy=hull.score >= np.float32(share))
        if not hull.occupancy.any():
            return None
        points = hull.centers(hull.occupancy)
        low, high = points.min(axis=0) - 2 * hull.voxel, points.max(axis=0) + 2 * hull.voxel
    return hull


def agreements(views: Sequence[View], hull: Hull | None) -> np.ndarray:
    """Return the IoU of each of N views and the hull, (N,) float64; 0 without a hull."""
    return np.array([0.0 if hull is None else view.agreement(hull) for view in views])


def fitted_hull(
    cameras: Sequence[Camera],
    alphas: Sequence[np.ndarray],
    similarity: Similarity,
    resolution: int,
    *,
    agreement: float | None = None,
) -> Hull:
    """Return the hull, in the normalised frame, of input-frame `cameras` on a grid that fits it closely.

    alphas: a mask (H, W) for each camera.
    """
    normalised = [camera.normalised(similarity) for camera in cameras]
    rough = visual_hull(normalised, alphas, resolution // 2, agreement=agreement)
    if not rough.occupancy.any():
        return rough
    points = rough.centers(rough.occupancy)
    low, high = points.min(axis=0) - 2 * rough.voxel, points.max(axis=0) + 2 * rough.voxel
    return visual_hull(normalised, alphas, resolution, lo=low, hi=high, agreement=agreement)


def silhouette(hull: Hull, camera: Camera, similarity: Similarity, shape: tuple[int, ...]) -> np.ndarray:
    """Return the hull's (height, width) bool picture of size `shape` for an input-frame `camera`."""
    return hull.silhouette(camera.normalised(similarity).resized(shape[1], shape[0]))


def overlap(mask: np.ndarray, picture: np.ndarray) -> float:
    """Return the IoU of two bool pictures (H, W); 1 when both are empty."""
    union = int((mask | picture).sum())
    return float((mask & picture).sum() / union) if union else 1.0


def rim(mask: np.ndarray) -> float:
    """Return the share of a photo's border that its mask (H, W) fills."""
    border = np.concatenate([mask[0], mask[-1], mask[1:-1, 0], mask[1:-1, -1]])
    return float((border >= 0.5).mean())


def looks_inverted(mask: np.ndarray) -> bool:
    """Tell whether a mask (H, W) fills the rim of its photo and leaves out something inside it.

    The hull cannot tell: the space around an object is as consistent as the object.
    """
    return rim(mask) > _RIM and float((mask < 0.5).mean()) > _HOLE
