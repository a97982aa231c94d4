"""Differential rendering: the photo, changed by what the virtual object adds to it and takes from it.

    picture = photo x shadow x (1 - mask) + beauty

in linear light, before grain. `shadow` is what the virtual object multiplies the light of ground and known
object by: below 1 where it takes light away, above where it throws some. `beauty` is premultiplied with
`mask`.

After Debevec (Rendering Synthetic Objects into Real Scenes, 1998). Ground and known object are in the photo
already; they are rendered with and without the virtual object, and the photo is multiplied by the ratio of
both, per channel. The ratio needs no albedo: the photo's own pixels have the ground's, texture and noise
included.

The depths of virtual and known object tell which is in front. The known object's outline is the photo's mask:
where it reaches beyond the mesh, the nearest depth of the mesh counts.
"""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import scipy
import torch
from torch import Tensor
from torch.nn import functional

from lightprobe.core.files import filled_folder
from lightprobe.imaging import LUMA, resize_area, srgb_decode, srgb_encode, write_exr, write_png
from lightprobe.insertion.drawing import (
    Drawn,
    KnownChange,
    Window,
    draw_known_change,
    draw_virtual,
    window_of,
)
from lightprobe.insertion.grain import Grain
from lightprobe.insertion.lighting import light_scene
from lightprobe.insertion.placement import Placement, place
from lightprobe.insertion.virtual_object import VirtualObject
from lightprobe.light.environment import Environment
from lightprobe.models import Decomposition
from lightprobe.scene.camera import Camera

_LARGEST_FACTOR = 4.0  # that a photo's pixel is multiplied by
_SOLID = 0.5  # coverage from which a pixel of the mask is the object's own
_TOUCHED = 0.01  # coverage by the virtual object from which the ground's factor may be meant for under it
_EDGE = 1.5  # pixels from one that is not touched within which the virtual object covers a pixel in part
_WRONG_EXPOSURE = 2.0  # ratio of rendered and seen known object from which a warning says so


@dataclass(frozen=True)
class LayerFiles:
    """Where picture and layers go."""

    picture: Path  # .png
    beauty: Path  # .exr, RGBA
    shadow: Path  # .exr, RGB
    mask: Path  # .exr, one channel

    @staticmethod
    def of(picture: Path) -> "LayerFiles":
        """Return the files named after a picture: NAME.beauty.exr and so on beside it."""
        layers = (picture.with_name(f"{picture.stem}.{name}.exr") for name in ("beauty", "shadow", "mask"))
        return LayerFiles(picture, *layers)


@dataclass(frozen=True)
class Insertion:
    """A photo with a virtual object in it; (H, W) are the photo's."""

    color: np.ndarray  # (H, W, 3) float32 linear, straight, with grain
    alpha: np.ndarray | None  # (H, W) of a cut-out photo, with the virtual object's shadow; None: opaque
    beauty: np.ndarray  # (H, W, 3) float32 linear, premultiplied
    shadow: np.ndarray  # (H, W, 3) float32
    mask: np.ndarray  # (H, W) float32, coverage of the virtual object where nothing stands before it
    at: tuple[float, float]  # pixel of the virtual object's foot
    scale: float  # its height relative to the known object's
    warnings: tuple[str, ...]

    def write(self, files: LayerFiles) -> None:
        """Write the layers and the picture: all of them appear, or none; one folder holds them."""
        with filled_folder(files.picture.parent) as folder:
            write_exr(folder / files.beauty.name, np.dstack([self.beauty, self.mask]))
            write_exr(folder / files.shadow.name, self.shadow)
            write_exr(folder / files.mask.name, self.mask)
            write_png(folder / files.picture.name, self.color, self.alpha)


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
    virtual: VirtualObject,
    placement: Placement,
    *,
    seed: int = 0,
) -> Insertion:
    """Return the photo with the virtual object beside the known one, lit by `environment` in the photo's
    exposure.

    Computed on the environment's device; `seed` draws the grain. Raises `ConfigError` for a place or height
    that cannot be meant.
    """
    device = environment.device
    asset = decomposition.asset.to(device)
    camera = photo.camera.normalised(decomposition.similarity)
    known = asset.mesh.vertices.cpu()
    placed = place(virtual, known, decomposition.similarity, camera, photo.mask, placement)
    placed = replace(placed, virtual=placed.virtual.to(device))
    lighting = light_scene(asset, placed, environment, camera, photo.color, photo.mask, opaque=photo.opaque)
    change = draw_known_change(asset, lighting, camera)
    window, warnings = window_of(placed.virtual.vertices, camera), [*virtual.warnings, *placed.warnings]
    shadow = _shadow(lighting.ground.factor(), change, photo.mask)
    beauty, mask = np.zeros_like(photo.color), np.zeros_like(photo.mask)
    if window is None:
        warnings.append(
            "The virtual object is out of sight or behind the camera; give another --at or --scale."
        )
    else:
        drawn = draw_virtual(placed.virtual, lighting, camera, window)
        beauty[window], mask[window] = _behind(drawn, change, photo.mask, window)
        shadow[window] = _edge_from_beside(shadow[window], mask[window] < _TOUCHED)
    warnings += _exposure_warnings(change, photo)
    color, alpha = _composed(photo, beauty, shadow, mask, seed)
    return Insertion(color, alpha, beauty, shadow, mask, placed.at, placed.scale, tuple(warnings))


def _shadow(ground: Tensor, change: KnownChange, mask: np.ndarray) -> np.ndarray:
    """Return the photo's factor (H, W, 3): the ground's, and the known object's within the mask."""
    own = _resized(_spread(change.factor.cpu().numpy(), change.covered.cpu().numpy()), mask.shape)
    cover = mask[..., None]
    factor = (1 - cover) * ground.cpu().numpy() + cover * own
    return factor.clip(0, _LARGEST_FACTOR).astype(np.float32)


def _spread(values: np.ndarray, covered: np.ndarray) -> np.ndarray:
    """Return values (h, w) or (h, w, C), where not `covered` (h, w) the nearest that are."""
    if not covered.any():
        return np.ones_like(values)
    row, column = scipy.ndimage.distance_transform_edt(~covered, return_distances=False, return_indices=True)
    return values[row, column]


def _edge_from_beside(factor: np.ndarray, beside: np.ndarray) -> np.ndarray:
    """Return the factor (H, W, 3), at the virtual object's edge from the nearest pixel `beside` it (H, W)
    bool.

    Further in the factor stays: there one may look through a virtual object onto the ground below it.
    """
    edge = ~beside & (scipy.ndimage.distance_transform_edt(~beside) < _EDGE)
    return np.where(edge[..., None], _spread(factor, beside), factor)


def _resized(values: np.ndarray, shape: tuple[int, ...]) -> np.ndarray:
    """Return (h, w, C) bilinearly at a photo's size (H, W)."""
    planes = torch.from_numpy(np.ascontiguousarray(values)).permute(2, 0, 1)[None]
    large = functional.interpolate(planes, shape[:2], mode="bilinear", align_corners=False)
    return large[0].permute(1, 2, 0).numpy()


def _behind(
    drawn: Drawn, change: KnownChange, mask: np.ndarray, window: Window
) -> tuple[np.ndarray, np.ndarray]:
    """Return radiance (h, w, 3) and coverage (h, w) of the virtual object where nothing stands before it."""
    covered = change.covered.cpu().numpy()
    spread = _spread(change.depth.cpu().numpy(), covered)[..., None]
    depth = _resized(spread, mask.shape)[window][..., 0]
    own = drawn.depth.cpu().numpy()
    solid = drawn.cover.cpu().numpy() >= _SOLID
    hidden = _spread(own, solid) > depth if solid.any() else own > depth
    left = 1 - mask[window] * (hidden & bool(covered.any()))
    return drawn.radiance.cpu().numpy() * left[..., None], drawn.cover.cpu().numpy() * left


def _composed(
    photo: PhotoView, beauty: np.ndarray, shadow: np.ndarray, mask: np.ndarray, seed: int
) -> tuple[np.ndarray, np.ndarray | None]:
    """Return the picture (H, W, 3), linear and straight, and its alpha (H, W) if the photo is cut out."""
    displayed = srgb_encode(photo.color.clip(0, 1))
    grain = Grain.of(displayed, photo.mask > 0.99 if not photo.opaque else np.ones(mask.shape, bool))
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
    """Return the linear picture (H, W, 3) with the photo's grain on the virtual object."""
    displayed = srgb_encode(picture.clip(0, 1))
    grained = srgb_decode(grain.add(displayed, mask, seed).clip(0, 1))
    return (picture + grained - srgb_decode(displayed)).astype(np.float32)


def _exposure_warnings(change: KnownChange, photo: PhotoView) -> list[str]:
    """Return a sentence when the known object is not about as bright under the light as in the photo."""
    covered = change.covered.cpu().numpy()
    small = resize_area(photo.color * photo.mask[..., None], *covered.shape)
    rows = covered & (resize_area(photo.mask, *covered.shape) > _SOLID)
    if not rows.any():
        return []
    ratio = float(change.radiance.cpu().numpy()[rows].mean() / max(small[rows].mean(), 1e-9))
    if 1 / _WRONG_EXPOSURE <= ratio <= _WRONG_EXPOSURE:
        return []
    return [
        f"Under this light the known object would be {ratio:.2g} times as bright as in the photo, and the virtual "
        "object is drawn in that light; is the map in the photo's exposure, as lightprobe predict writes it?"
    ]
