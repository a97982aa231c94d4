"""The light on a horizontal ground with and without the virtual object: one shadow for each patch of the sky.

The sky is a few hundred patches of about equal irradiance, by median cut (Debevec, A Median Cut Algorithm for
Light Probe Sampling, 2005): the equirectangular map above the horizon is halved again and again where both
halves weigh the same. The weight of a texel is its irradiance on the ground plus a share of a uniform sky's,
so that dark parts of the sky are not left to one direction. A patch that a lamp or the sun makes strong is
spread over directions within it, which gives its shadow a penumbra.

    E_k = sum over the patch of L (d.z) dw,   a_k = sum of (d.z) dw,   sum of a_k = pi

A point x of the ground has the irradiance

    E(x) = sum over patches k of  E_k where k is free,  a_k B where a surface of radiance B blocks it

The shadow of a triangle on a plane is a triangle, also as a camera sees it: all triangles are slid along the
patch's direction onto the ground and rasterised, the lower before the higher, so that a pixel knows the first
surface on its way to the sky.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor
from torch.nn import functional

from lightprobe.imaging import LUMA
from lightprobe.kernels import rasterize
from lightprobe.light import equirect
from lightprobe.light.environment import Environment
from lightprobe.render.surface import View
from lightprobe.scene.camera import Camera

CUTS = 8  # times the map is halved: 256 patches
_UNIFORM = 0.3  # weight of the uniform sky
_STRONG = 0.012  # share of the irradiance from which a patch is spread
_MOST = 24  # directions of one patch
_GOLDEN = math.pi * (3 - math.sqrt(5))
_COARSE, _FINE = 512, 1600  # pixels of the longer side for soft light and for suns
_FINER = 2.0  # times the photo's resolution, at most
_DIM = 1e-6  # share of the irradiance below which a patch is left out
_BEHIND = -1.0  # depth of what the rasteriser leaves out

# ground points (N, 3) -> pixels (N, 2), whether they are seen
Projection = Callable[[Tensor], tuple[Tensor, Tensor]]


@dataclass(frozen=True)
class SkyPatches:
    """K patches of the sky."""

    direction: Tensor  # (K, 3) unit, z > 0
    irradiance: Tensor  # (K, 3) on the ground
    angle: Tensor  # (K,) projected solid angle
    strong: Tensor  # (K,) bool: its shadow has edges to be drawn finely

    @staticmethod
    def of(environment: Environment, cuts: int = CUTS) -> "SkyPatches":
        """Return the patches of a light, at most about 2^cuts, on its device."""
        image = environment.panorama().astype(np.float64)
        rows = image.shape[0] // 2
        direction = equirect.directions(image.shape[0])[:rows].numpy().astype(np.float64)
        solid = equirect.solid_angles(image.shape[0])[:rows].numpy().astype(np.float64)
        angle = direction[..., 2] * solid
        power = image[:rows] * angle[..., None]
        bright = power @ np.asarray(LUMA)
        weight = bright / max(bright.sum(), 1e-30) + _UNIFORM * angle / angle.sum()
        patches = [
            patch
            for window in _windows(weight, cuts)
            for patch in _directions(window, direction, power, angle, weight, solid, float(bright.sum()))
        ]
        columns = [torch.tensor(np.array(part)).to(environment.device) for part in zip(*patches, strict=True)]
        return SkyPatches(columns[0].float(), columns[1].float(), columns[2].float(), columns[3])

    def total(self) -> Tensor:
        """Return the irradiance (3,) of ground that sees the whole sky."""
        return self.irradiance.sum(0)

    def select(self, rows: Tensor) -> "SkyPatches":
        """Return the patches where `rows` (K,) bool holds."""
        return SkyPatches(self.direction[rows], self.irradiance[rows], self.angle[rows], self.strong[rows])


_Window = tuple[slice, slice]


def _windows(weight: np.ndarray, cuts: int) -> list[_Window]:
    """Return 2^cuts rectangles of a map (H, W) of about equal weight; single texels are not cut further."""
    height, width = weight.shape
    windows: list[_Window] = [(slice(0, height), slice(0, width))]
    for _ in range(cuts):
        windows = [part for window in windows for part in _halves(window, weight)]
    return windows


def _halves(window: _Window, weight: np.ndarray) -> list[_Window]:
    rows, columns = window
    tall, wide = rows.stop - rows.start, columns.stop - columns.start
    if tall * wide <= 1:
        return [window]
    theta = math.pi * (0.5 * (rows.start + rows.stop)) / (2 * weight.shape[0])
    part = weight[window]
    if tall > 1 and (wide == 1 or tall >= wide * math.sin(theta)):
        cut = rows.start + _median(part.sum(1))
        return [(slice(rows.start, cut), columns), (slice(cut, rows.stop), columns)]
    cut = columns.start + _median(part.sum(0))
    return [(rows, slice(columns.start, cut)), (rows, slice(cut, columns.stop))]


def _median(weight: np.ndarray) -> int:
    """Return how many of the first entries weigh about as much as the rest; at least one on either side."""
    total = np.cumsum(weight)
    return int(np.argmin(np.abs(total[:-1] - 0.5 * total[-1]))) + 1


def _directions(
    window: _Window,
    direction: np.ndarray,
    power: np.ndarray,
    angle: np.ndarray,
    weight: np.ndarray,
    solid: np.ndarray,
    whole: float,
) -> list[tuple[np.ndarray, np.ndarray, float, bool]]:
    """Return direction, irradiance, projected angle and strength of a patch, several of a strong one."""
    energy, projected = power[window].sum((0, 1)), float(angle[window].sum())
    middle = (direction[window] * weight[window][..., None]).sum((0, 1))
    middle /= max(float(np.linalg.norm(middle)), 1e-12)
    share = float(energy @ np.asarray(LUMA)) / max(whole, 1e-30)
    if share < _STRONG:
        return [(middle, energy, projected, False)]
    count = min(_MOST, math.ceil(share / _STRONG) + 3)
    radius = math.sqrt(float(solid[window].sum()) / math.pi)
    across = np.cross(middle, [1.0, 0, 0] if abs(middle[0]) < 0.6 else [0, 1.0, 0])
    across /= np.linalg.norm(across)
    around = np.cross(middle, across)
    found = []
    for k in range(count):
        out, turn = radius * math.sqrt((k + 0.5) / count), _GOLDEN * k
        spread = middle + out * (math.cos(turn) * across + math.sin(turn) * around)
        spread[2] = max(spread[2], 1e-3)
        found.append((spread / np.linalg.norm(spread), energy / count, projected / count, True))
    return found


@dataclass(frozen=True)
class Caster:
    """A mesh on the ground that casts shadows."""

    vertices: Tensor  # (V, 3)
    faces: Tensor  # (F, 3)
    radiance: Tensor  # (F, 3) mean radiance that leaves each face


@dataclass(frozen=True)
class GroundLight:
    """Irradiance on the ground at the pixels of a picture."""

    without: Tensor  # (H, W, 3), the known object there
    added: Tensor  # (H, W, 3), what the virtual object changes of it

    def factor(self) -> Tensor:
        """Return what the virtual object multiplies the ground's radiance by, (H, W, 3)."""
        floor = 1e-4 * self.without.amax().clamp(min=1e-12)
        return ((self.without + self.added).clamp(min=0) + floor) / (self.without + floor)


@torch.no_grad()
def camera_ground_light(
    patches: SkyPatches, known: Caster, virtual: Caster, camera: Camera, ground: float
) -> GroundLight:
    """Return the light on the ground at the pixels (H, W) of a normalised-frame camera."""
    longest = max(camera.width, camera.height)
    sizes = {False: min(1.0, _COARSE / longest), True: min(_FINER, _FINE / longest)}
    without = patches.total().expand(camera.height, camera.width, 3).clone()
    added = torch.zeros_like(without)
    for strong, scale in sizes.items():
        chosen = patches.select(patches.strong == strong)
        view = camera.scaled(scale)
        lost = _lost(chosen, known, virtual, _seen_by(view, without.device), view.height, view.width, ground)
        for image, part in zip((without, added), lost, strict=True):
            planes, size = part.permute(2, 0, 1)[None], (camera.height, camera.width)
            if planes.shape[2:] != size:
                planes = functional.interpolate(
                    planes, size, mode="bilinear", align_corners=False, antialias=True
                )
            image += planes[0].permute(1, 2, 0)
    return GroundLight(without.clamp(min=0), added)


@torch.no_grad()
def plan_ground_light(
    patches: SkyPatches, known: Caster, virtual: Caster, ground: float, corner: Tensor, cell: float, side: int
) -> GroundLight:
    """Return the light on a square of ground, (side, side): columns along x, rows along y from `corner` (2,)."""

    def project(points: Tensor) -> tuple[Tensor, Tensor]:
        return (points[:, :2] - corner) / cell, torch.ones_like(points[:, 0], dtype=torch.bool)

    without, added = _lost(patches, known, virtual, project, side, side, ground)
    return GroundLight((without + patches.total()).clamp(min=0), added)


def _seen_by(camera: Camera, device: torch.device) -> Projection:
    view = View.of(camera, device)

    def project(points: Tensor) -> tuple[Tensor, Tensor]:
        screen = view.project(points)
        return screen[:, :2], screen[:, 2] > 1e-3

    return project


def _lost(
    patches: SkyPatches,
    known: Caster,
    virtual: Caster,
    project: Projection,
    height: int,
    width: int,
    ground: float,
) -> tuple[Tensor, Tensor]:
    """Return what the known object takes of the irradiance, and what the virtual one changes besides, (H, W,
    3).
    """
    without = known.vertices.new_zeros(height, width, 3)
    added = torch.zeros_like(without)
    least = _DIM * float(patches.irradiance.sum()) if len(patches.angle) else 0.0
    columns = zip(patches.direction, patches.irradiance, patches.angle, strict=True)
    for direction, irradiance, angle in columns:
        if float(irradiance.sum()) < least:
            continue
        shadows = (_shadow(each, direction, project, height, width, ground) for each in (known, virtual))
        first, second = shadows
        if first is not None:
            without[first.window] += first.change(irradiance, angle)
        if second is not None:
            added[second.window] += second.change_beyond(first, irradiance, angle)
    return without, added


@dataclass(frozen=True)
class _Shadow:
    """The shadow that one direction throws, in a window of the picture."""

    caster: Caster
    face: Tensor  # (h, w), -1 where there is none
    nearness: Tensor  # (h, w), the larger, the lower the surface above
    window: tuple[slice, slice]

    def change(self, irradiance: Tensor, angle: Tensor) -> Tensor:
        """Return what the shadow changes of the irradiance, (h, w, 3)."""
        hit = (self.face >= 0)[..., None]
        bounced = self.caster.radiance[self.face.clamp(min=0).long()]
        return torch.where(hit, angle * bounced - irradiance, 0.0)

    def change_beyond(self, other: "_Shadow | None", irradiance: Tensor, angle: Tensor) -> Tensor:
        """Return what this shadow changes where `other` is thrown already, (h, w, 3)."""
        change = self.change(irradiance, angle)
        if other is None:
            return change
        pairs = list(zip(self.window, other.window, strict=True))
        shared = [(max(a.start, b.start), min(a.stop, b.stop)) for a, b in pairs]
        if any(start >= stop for start, stop in shared):
            return change
        mine, theirs = (
            tuple(slice(i - s.start, k - s.start) for (i, k), s in zip(shared, window, strict=True))
            for window in (self.window, other.window)
        )
        both = ((self.face[mine] >= 0) & (other.face[theirs] >= 0))[..., None]
        before = other.change(irradiance, angle)[theirs]
        nearer = (self.nearness[mine] > other.nearness[theirs])[..., None]
        change[mine] = torch.where(both, torch.where(nearer, change[mine] - before, 0.0), change[mine])
        return change


def _shadow(
    caster: Caster, direction: Tensor, project: Projection, height: int, width: int, ground: float
) -> _Shadow | None:
    """Return the shadow of a caster, None where none falls into the picture."""
    above = (caster.vertices[:, 2] - ground).clamp(min=0)
    foot = caster.vertices[:, :2] - above[:, None] * (direction[:2] / direction[2])
    place, seen = project(torch.cat([foot, torch.full_like(above, ground)[:, None]], 1))
    if not bool(seen.any()):
        return None
    low, high = place[seen].amin(0).floor().tolist(), place[seen].amax(0).ceil().tolist()
    left, top = max(0, int(max(low[0], 0))), max(0, int(max(low[1], 0)))
    right, bottom = int(min(high[0], width)), int(min(high[1], height))
    if left >= right or top >= bottom:
        return None
    depth = torch.where(seen, 1 + above, _BEHIND)
    screen = torch.cat([place - place.new_tensor([left, top]), depth[:, None]], 1)
    found = rasterize(screen.contiguous(), caster.faces, bottom - top, right - left)
    return _Shadow(caster, found.face, found.inverse_depth, (slice(top, bottom), slice(left, right)))
