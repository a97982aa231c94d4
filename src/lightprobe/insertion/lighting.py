"""The light that the thing stands in: the photo's map above the horizon, the ground below it, and the shadows
of both.

The map is that of the known object, in the photo's exposure. Below the horizon the photo itself shows what
there is, where it is opaque: the ground's radiance is its median colour around the object's foot, with the
object's own shadow undone. Of a cut-out photo the map's lower half stays.
"""

import math
from dataclasses import dataclass

import numpy as np
import scipy
import torch
from torch import Tensor

from lightprobe.geometry.mesh import vertex_normals
from lightprobe.geometry.textures import sample
from lightprobe.insertion.ground_light import Caster, GroundLight, camera_ground_light, plan_ground_light
from lightprobe.insertion.occlusion import GroundPlan, SurfacePoints, both, over_ground, past, simplified
from lightprobe.insertion.placement import Placed
from lightprobe.insertion.sky_patches import SkyPatches
from lightprobe.insertion.thing import Thing
from lightprobe.light import cubemap, prefilter
from lightprobe.light.environment import Environment
from lightprobe.light.prefilter import Prefilter
from lightprobe.render.asset import Asset, textured_visibility
from lightprobe.render.suns import Suns
from lightprobe.render.visibility import PointVisibility, VertexVisibility
from lightprobe.scene.camera import Camera

_RING = 2.5  # radii of the known object, within which the photo shows the ground that it stands on
_MARGIN = 0.02  # of the photo's longer side, around the mask, that may still show the object
_LEAST = 50  # pixels that tell the ground's colour
_PLAN = 96  # cells along the edge of the ground plan
_PLAN_CUTS = 6  # of the sky for it: 64 patches
_REACH = 4.0  # radii of both objects, that the ground plan reaches


@dataclass(frozen=True)
class Light:
    """A light above the horizon, what is below it, and how both light surfaces."""

    texels: Tensor  # (6, R, R, 3)
    operator: Prefilter
    levels: Tensor  # prefiltered
    suns: Suns

    @staticmethod
    def of(environment: Environment, ground: Tensor | None) -> "Light":
        """Return the light of a map whose lower half has the radiance `ground` (3,), or stays where that is
        None.
        """
        texels = environment.texels
        if ground is not None:
            below = cubemap.directions(environment.resolution, environment.device)[..., 2:] < 0
            texels = torch.where(below, ground, texels)
        operator = prefilter.cached(environment.resolution, environment.device)
        return Light(texels, operator, operator.apply(texels), Suns.of(texels))

    @property
    def blocks(self) -> Tensor:
        """The light averaged over 384 parts of the sphere, (384, 3)."""
        return self.levels[self.operator.first_block :]


@dataclass(frozen=True)
class Stage:
    """Both objects with all that is known of the light on them."""

    light: Light
    ground: GroundLight  # at the photo's pixels
    points: SurfacePoints  # of the thing
    thing_visibility: VertexVisibility
    known_before: VertexVisibility  # without the thing
    known_after: VertexVisibility
    thing_caster: Caster
    known_caster: Caster


@torch.no_grad()
def set_stage(
    asset: Asset,
    placed: Placed,
    environment: Environment,
    camera: Camera,
    color: np.ndarray,
    mask: np.ndarray,
    *,
    opaque: bool,
) -> Stage:
    """Return what lights both objects and the ground; all in the normalised frame, on the environment's
    device.

    color (H, W, 3): the linear photo; mask (H, W): coverage of the known object; opaque: whether it shows the
    ground.
    """
    thing, ground = placed.thing, placed.ground
    known = asset.mesh
    points = SurfacePoints.of(thing)
    solid = simplified(thing.vertices, thing.faces, thing_face_colors(thing))
    body = simplified(known.vertices, known.faces, _face_colors(asset))
    alone = asset.visibility or textured_visibility(known, asset.textures.flat())
    known_normals = vertex_normals(known.vertices, known.faces)
    own = past(*solid, points.points, points.normals)
    thing_sees = both(own, past(*body, points.points, points.normals), points.normals)
    known_sees = both(alone, past(*solid, known.vertices, known_normals), known_normals)

    ring = _ring(camera, mask, asset, ground) if opaque else np.zeros(0, np.int64)
    seen = (
        torch.from_numpy(color.reshape(-1, 3)[ring]).to(environment.device) if len(ring) >= _LEAST else None
    )
    patches = SkyPatches.of(environment)
    light = Light.of(environment, None if seen is None else seen.median(0).values)
    casters = (
        Caster(
            body[0], body[1], _caster_radiance(body, known.vertices, _arriving(alone, known_normals, light))
        ),
        Caster(
            solid[0],
            solid[1],
            _caster_radiance(solid, points.points, _arriving(thing_sees, points.normals, light)),
        ),
    )
    lit = camera_ground_light(patches, *casters, camera, ground)
    if seen is not None:  # the ground in the open
        share = lit.without.reshape(-1, 3)[torch.from_numpy(ring).to(seen.device)] / patches.total().clamp(
            min=1e-12
        )
        light = Light.of(environment, (seen / share.clamp(min=0.05)).median(0).values)
    before, after = _plans(environment, *casters, ground)
    return Stage(
        light,
        lit,
        points,
        over_ground(thing_sees, points.points, points.normals, after),
        over_ground(alone, known.vertices, known_normals, before),
        over_ground(known_sees, known.vertices, known_normals, after),
        casters[1],
        casters[0],
    )


def thing_face_colors(thing: Thing) -> Tensor:
    """Return the base colour (F, 3) of the middle of each of a thing's faces."""
    middle = [values[thing.faces.long()].mean(1) for values in (thing.uvs, thing.colors)]
    colors = thing.vertices.new_zeros(len(thing.faces), 3)
    for k, material in enumerate(thing.materials):
        rows = (thing.material == k).nonzero()[:, 0]
        footprint = middle[0].new_full((len(rows),), 1e-5)
        colors[rows] = material.sample(middle[0][rows], middle[1][rows], footprint).base_color
    return colors


def _face_colors(asset: Asset) -> Tensor:
    return sample(asset.textures.flat(), asset.mesh.uvs[asset.mesh.uv_faces.long()].mean(1))[
        :, :3
    ].contiguous()


def _arriving(visibility: VertexVisibility, normals: Tensor, light: Light) -> Tensor:
    """Return the mean radiance (N, 3) that arrives at points with normals (N, 3), by their cosine."""
    rows = torch.arange(len(normals), device=normals.device)[:, None]
    found = PointVisibility(visibility, rows, torch.ones_like(rows, dtype=normals.dtype)).light(
        light.blocks, normals
    )
    return found[:, :3] + visibility.occluder_color * (1 - found[:, 6:]) * found[:, 3:6]


def _caster_radiance(solid: tuple[Tensor, Tensor, Tensor], points: Tensor, arriving: Tensor) -> Tensor:
    """Return the radiance (F, 3) that leaves a caster's faces as from a matt surface.

    points (N, 3) of the surface at which `arriving` (N, 3) is known; a face has that of the point nearest its
    middle.
    """
    vertices, faces, colors = solid
    middles = vertices[faces.long()].mean(1).cpu().numpy()
    nearest = scipy.spatial.cKDTree(points.cpu().numpy()).query(middles)[1]
    return colors * arriving[torch.from_numpy(nearest).to(colors.device)]


def _ring(camera: Camera, mask: np.ndarray, asset: Asset, ground: float) -> np.ndarray:
    """Return the flat indices (N,) of pixels that see the ground around the known object, none of them the
    object.
    """
    height, width = mask.shape
    margin = max(1, round(_MARGIN * max(height, width)))
    free = scipy.ndimage.distance_transform_edt(mask < 0.02) > margin
    row, column = np.nonzero(free)
    local = np.stack(
        [(column + 0.5 - camera.cx) / camera.fx, -(row + 0.5 - camera.cy) / camera.fy, -np.ones(len(row))], 1
    )
    ray = local @ camera.camera_to_world[:3, :3].T
    with np.errstate(divide="ignore", invalid="ignore"):
        along = (ground - camera.position[2]) / ray[:, 2]
    point = camera.position[:2] + along[:, None] * ray[:, :2]
    body = asset.mesh.vertices[:, :2].cpu().numpy()
    middle = (body.min(0) + body.max(0)) / 2
    reach = _RING * np.linalg.norm(body - middle, axis=1).max()
    near = (along > 0) & np.isfinite(along) & (np.linalg.norm(point - middle, axis=1) < reach)
    return (row * width + column)[near]


def _plans(
    environment: Environment, known: Caster, thing: Caster, ground: float
) -> tuple[GroundPlan, GroundPlan]:
    """Return the plans of the ground's light around both objects, without and with the thing."""
    corner, cell = _plan_square(known.vertices, thing.vertices)
    patches = SkyPatches.of(environment, _PLAN_CUTS)
    light = plan_ground_light(patches, known, thing, ground, corner, cell, _PLAN)
    without, with_thing = (
        GroundPlan.of(light, patches.total(), corner, cell, ground, thing=there) for there in (False, True)
    )
    return without, with_thing


def _plan_square(*vertices: Tensor) -> tuple[Tensor, float]:
    """Return the corner (2,) and the size of a cell of a square of ground around all vertices (V, 3)."""
    flat = torch.cat([v[:, :2] for v in vertices])
    low, high = flat.amin(0), flat.amax(0)
    side = _REACH * float((high - low).amax()) / 2
    return (low + high) / 2 - side / 2, side / _PLAN


def exposure_ratio(rendered: Tensor, seen: Tensor) -> float:
    """Return the ratio of mean rendered (N, 3) and seen (N, 3) radiance of the known object."""
    return float(rendered.mean() / seen.mean().clamp(min=1e-9)) if len(seen) else math.nan
