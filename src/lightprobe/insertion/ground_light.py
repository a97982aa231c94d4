"""The light on the ground with and without the thing: shadows thrown along every patch of the sky.

A point x of the ground has the irradiance

    E(x) = sum over patches k of  E_k where k is free,  a_k B where a surface of radiance B blocks it

with the notation of `sky_patches`. The shadow of a triangle on a plane is a triangle, also as a camera sees
it: all triangles are slid along the patch's direction onto the ground and rasterised, the lower before the
higher, so that a pixel knows the first surface on its way to the sky.
"""

from collections.abc import Callable
from dataclasses import dataclass

import torch
from torch import Tensor
from torch.nn import functional

from lightprobe.insertion.sky_patches import SkyPatches
from lightprobe.kernels import rasterize
from lightprobe.render.surface import View
from lightprobe.scene.camera import Camera

_COARSE, _FINE = 512, 1600  # pixels of the longer side for soft light and for suns
_FINER = 2.0  # times the photo's resolution, at most
_DIM = 1e-6  # share of the irradiance below which a patch is left out
_BEHIND = -1.0  # depth of what the rasteriser leaves out

Projection = Callable[
    [Tensor], tuple[Tensor, Tensor]
]  # ground points (N, 3) -> pixels (N, 2), whether they are seen


@dataclass(frozen=True)
class Caster:
    """What stands on the ground and casts shadows."""

    vertices: Tensor  # (V, 3)
    faces: Tensor  # (F, 3)
    radiance: Tensor  # (F, 3) mean radiance that leaves each face


@dataclass(frozen=True)
class GroundLight:
    """Irradiance on the ground at the pixels of a picture."""

    without: Tensor  # (H, W, 3), the known object there
    added: Tensor  # (H, W, 3), what the thing changes of it

    def factor(self) -> Tensor:
        """Return what the thing multiplies the ground's radiance by, (H, W, 3)."""
        floor = 1e-4 * self.without.amax().clamp(min=1e-12)
        return ((self.without + self.added).clamp(min=0) + floor) / (self.without + floor)


@torch.no_grad()
def camera_ground_light(
    patches: SkyPatches, known: Caster, thing: Caster, camera: Camera, ground: float
) -> GroundLight:
    """Return the light on the ground at the pixels (H, W) of a normalised-frame camera."""
    longest = max(camera.width, camera.height)
    sizes = {False: min(1.0, _COARSE / longest), True: min(_FINER, _FINE / longest)}
    without = patches.total().expand(camera.height, camera.width, 3).clone()
    added = torch.zeros_like(without)
    for strong, scale in sizes.items():
        chosen = patches.select(patches.strong == strong)
        view = camera.scaled(scale)
        lost = _lost(chosen, known, thing, _seen_by(view, without.device), view.height, view.width, ground)
        for image, part in zip((without, added), lost, strict=True):
            planes = part.permute(2, 0, 1)[None]
            size = (camera.height, camera.width)
            if planes.shape[2:] != size:
                planes = functional.interpolate(
                    planes, size, mode="bilinear", align_corners=False, antialias=True
                )
            image += planes[0].permute(1, 2, 0)
    return GroundLight(without.clamp(min=0), added)


@torch.no_grad()
def plan_ground_light(
    patches: SkyPatches, known: Caster, thing: Caster, ground: float, corner: Tensor, cell: float, side: int
) -> GroundLight:
    """Return the light on a square of ground, (side, side): columns along x and rows along y from `corner`
    (2,).
    """

    def project(points: Tensor) -> tuple[Tensor, Tensor]:
        return (points[:, :2] - corner) / cell, torch.ones(
            len(points), dtype=torch.bool, device=points.device
        )

    without, added = _lost(patches, known, thing, project, side, side, ground)
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
    thing: Caster,
    project: Projection,
    height: int,
    width: int,
    ground: float,
) -> tuple[Tensor, Tensor]:
    """Return what the known object takes of the irradiance, and what the thing changes beyond it, (H, W, 3)
    each.
    """
    without = known.vertices.new_zeros(height, width, 3)
    added = torch.zeros_like(without)
    least = _DIM * float(patches.irradiance.sum()) if len(patches.angle) else 0.0
    columns = zip(patches.direction, patches.irradiance, patches.angle, strict=True)
    for direction, irradiance, angle in columns:
        if float(irradiance.sum()) < least:
            continue
        shadows = [_shadow(caster, direction, project, height, width, ground) for caster in (known, thing)]
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
        rows, columns = (
            slice(max(a.start, b.start), min(a.stop, b.stop))
            for a, b in zip(self.window, other.window, strict=True)
        )
        if rows.start >= rows.stop or columns.start >= columns.stop:
            return change
        mine, theirs = (
            (
                slice(rows.start - w[0].start, rows.stop - w[0].start),
                slice(columns.start - w[1].start, columns.stop - w[1].start),
            )
            for w in (self.window, other.window)
        )
        both = (self.face[mine] >= 0) & (other.face[theirs] >= 0)
        before = other.change(irradiance, angle)[theirs]
        nearer = (self.nearness[mine] > other.nearness[theirs])[..., None]
        change[mine] = torch.where(
            both[..., None], torch.where(nearer, change[mine] - before, 0.0), change[mine]
        )
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
