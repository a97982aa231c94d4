"""Differential rendering: the photo, changed by what the thing adds to it and takes from it.

After Debevec (Rendering Synthetic Objects into Real Scenes, 1998). Ground and known object are in the photo
already; what the thing changes is rendered with and without it, and the photo is multiplied by the ratio of
both, per channel. The ratio needs no albedo: that of the ground is in the photo's own pixels, texture and
noise included.

Which of thing and known object is before the other is told by their depths. The photo's mask is the known
object's outline, rather than that of its mesh: where the mask reaches beyond the mesh, the nearest depth of
the mesh counts.
"""

from dataclasses import dataclass

import numpy as np
import scipy
import torch
from torch import Tensor
from torch.nn import functional

from lightprobe.imaging import LUMA, resize_area, srgb_decode, srgb_encode
from lightprobe.insertion.drawing import Drawn, KnownChange, Window, draw_known_change, draw_thing, window_of
from lightprobe.insertion.grain import Grain
from lightprobe.insertion.layers import Insertion
from lightprobe.insertion.lighting import exposure_ratio, set_stage
from lightprobe.insertion.placement import Placed, Wish, place
from lightprobe.insertion.thing import Thing
from lightprobe.light.environment import Environment
from lightprobe.models import Decomposition
from lightprobe.scene.camera import Camera

_LARGEST_FACTOR = 4.0  # that a photo's pixel is multiplied by
_SOLID = 0.5  # coverage from which a pixel of the mask is the object's own
_TOUCHED = 0.01  # coverage by the thing from which the ground's factor at a pixel's centre may be that under the thing
_EDGE = 1.5  # pixels from one that is not touched within which the thing covers a pixel in part
_WRONG_EXPOSURE = 2.0  # ratio of rendered and seen known object from which a warning says so


@dataclass(frozen=True)
class PhotoView:
    """A photo with its camera and the known object's mask."""

    color: np.ndarray  # (H, W, 3) float32 linear, straight, background included
    mask: np.ndarray  # (H, W) float32, coverage of the known object
    camera: Camera  # input frame
    opaque: bool = True  # False: it shows nothing around the object, and the mask is its alpha channel


@torch.no_grad()
def insert(
    decomposition: Decomposition,
    environment: Environment,
    photo: PhotoView,
    thing: Thing,
    wish: Wish,
    *,
    seed: int = 0,
) -> Insertion:
    """Return the photo with the thing beside the known object, lit by `environment` in the photo's exposure.

    Computed on the environment's device; `seed` draws the grain. Raises `ConfigError` for a place or height
    that cannot be meant.
    """
    device = environment.device
    asset = decomposition.asset.to(device)
    camera = photo.camera.normalised(decomposition.similarity)
    known = asset.mesh.vertices.cpu()
    placed = place(thing, known, decomposition.similarity, camera, photo.mask, wish)
    placed = Placed(placed.thing.to(device), placed.ground, placed.at, placed.scale, placed.warnings)
    stage = set_stage(asset, placed, environment, camera, photo.color, photo.mask, opaque=photo.opaque)
    change = draw_known_change(asset, stage, camera)
    window, warnings = window_of(placed.thing.vertices, camera), [*thing.warnings, *placed.warnings]
    shadow = _shadow(stage.ground.factor(), change, photo.mask)
    beauty, mask = np.zeros_like(photo.color), np.zeros_like(photo.mask)
    if window is None:
        warnings.append(
            "The thing is not seen in this photo, or reaches behind the camera; give another --at or --scale."
        )
    else:
        drawn = draw_thing(placed.thing, stage, window.cut(camera))
        beauty[window.slices], mask[window.slices] = _behind(drawn, change, photo.mask, window)
        shadow[window.slices] = _edge_from_beside(shadow[window.slices], mask[window.slices] < _TOUCHED)
    warnings += _exposure_warnings(change, photo)
    color, alpha = _composed(photo, beauty, shadow, mask, seed)
    return Insertion(color, alpha, beauty, shadow, mask, placed.at, placed.scale, tuple(warnings))


def _shadow(ground: Tensor, change: KnownChange, mask: np.ndarray) -> np.ndarray:
    """Return what the photo is multiplied by, (H, W, 3): the ground's factor, and the object's where the mask
    is.
    """
    own = _resized(_spread(change.factor.cpu().numpy(), change.covered.cpu().numpy()), mask.shape)
    cover = mask[..., None]
    factor = (1 - cover) * ground.cpu().numpy() + cover * own
    return factor.clip(0, _LARGEST_FACTOR).astype(np.float32)


def _spread(values: np.ndarray, covered: np.ndarray) -> np.ndarray:
    """Return values (h, w) or (h, w, C) with those that are not covered (h, w) taken from the nearest that
    are.
    """
    if not covered.any():
        return np.ones_like(values)
    row, column = scipy.ndimage.distance_transform_edt(~covered, return_distances=False, return_indices=True)
    return values[row, column]


def _edge_from_beside(factor: np.ndarray, beside: np.ndarray) -> np.ndarray:
    """Return the factor (H, W, 3) with that at the thing's edge taken from the nearest pixel `beside` it (H,
    W) bool.

    Further in it stays: there one may look through a thing onto the ground below it.
    """
    edge = ~beside & (scipy.ndimage.distance_transform_edt(~beside) < _EDGE)
    return np.where(edge[..., None], _spread(factor, beside), factor)


def _resized(values: np.ndarray, shape: tuple[int, ...]) -> np.ndarray:
    """Return (h, w, C) bilinearly at a photo's size (H, W)."""
    planes = torch.from_numpy(np.ascontiguousarray(values)).permute(2, 0, 1)[None]
    return (
        functional.interpolate(planes, shape[:2], mode="bilinear", align_corners=False)[0]
        .permute(1, 2, 0)
        .numpy()
    )


def _behind(
    drawn: Drawn, change: KnownChange, mask: np.ndarray, window: Window
) -> tuple[np.ndarray, np.ndarray]:
    """Return radiance (h, w, 3) and coverage (h, w) of the thing in its window without what stands before it."""
    covered = change.covered.cpu().numpy()
    depth = _resized(_spread(change.depth.cpu().numpy(), covered)[..., None], mask.shape)[window.slices][
        ..., 0
    ]
    own = drawn.depth.cpu().numpy()
    solid = drawn.cover.cpu().numpy() >= _SOLID
    hidden = _spread(own, solid) > depth if solid.any() else own > depth
    left = 1 - mask[window.slices] * (hidden & bool(covered.any()))
    return drawn.radiance.cpu().numpy() * left[..., None], drawn.cover.cpu().numpy() * left


def _composed(
    photo: PhotoView, beauty: np.ndarray, shadow: np.ndarray, mask: np.ndarray, seed: int
) -> tuple[np.ndarray, np.ndarray | None]:
    """Return the picture (H, W, 3), linear and straight, and its alpha (H, W) if the photo is cut out."""
    shown = srgb_encode(photo.color.clip(0, 1))
    grain = Grain.of(shown, photo.mask > 0.99 if not photo.opaque else np.ones(mask.shape, bool))
    if photo.opaque:
        picture = photo.color * shadow * (1 - mask[..., None]) + beauty
        return _grained(picture, grain, mask, seed), None
    # Shadows on nothing are black of some opacity, so that they darken whatever the picture is laid over.
    own = photo.mask[..., None]
    dark = (1 - (shadow @ np.asarray(LUMA, np.float32)).clip(0, 1)) * (1 - photo.mask)
    under = photo.color * own * shadow
    alpha = (photo.mask + dark) * (1 - mask) + mask
    picture = (under * (1 - mask[..., None]) + beauty) / np.maximum(alpha, 1e-6)[..., None]
    return _grained(picture, grain, mask, seed), alpha.clip(0, 1)


def _grained(picture: np.ndarray, grain: Grain, mask: np.ndarray, seed: int) -> np.ndarray:
    """Return the linear picture (H, W, 3) with the photo's grain where the thing is; brighter than white
    stays so.
    """
    shown = srgb_encode(picture.clip(0, 1))
    return (picture + srgb_decode(grain.add(shown, mask, seed).clip(0, 1)) - srgb_decode(shown)).astype(
        np.float32
    )


def _exposure_warnings(change: KnownChange, photo: PhotoView) -> list[str]:
    """Return a sentence when the light does not make the known object about as bright as the photo shows it."""
    covered = change.covered.cpu().numpy()
    small = resize_area(photo.color * photo.mask[..., None], *covered.shape)
    rows = torch.from_numpy(covered & (resize_area(photo.mask, *covered.shape) > _SOLID))
    ratio = exposure_ratio(change.radiance.cpu()[rows], torch.from_numpy(small)[rows])
    if 1 / _WRONG_EXPOSURE <= ratio <= _WRONG_EXPOSURE or np.isnan(ratio):
        return []
    return [
        f"Under this light the known object would be {ratio:.2g} times as bright as in the photo, and the thing is "
        "drawn in that light; is the map in the photo's exposure, as lightprobe predict writes it?"
    ]
