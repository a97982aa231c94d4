"""The light on the virtual object: the photo's map above the horizon, the ground below it, and their shadows.

The map is the known object's, in the photo's exposure. Below the horizon an opaque photo shows the ground
itself: its radiance is the median colour around the object's foot, with the object's own shadow undone. Of a
cut-out photo the map's lower half stays.
"""

from dataclasses import dataclass

import numpy as np
import scipy
import torch
from torch import Tensor

from lightprobe.geometry.mesh import vertex_normals
from lightprobe.geometry.textures import sample
from lightprobe.insertion.ground_light import (
    Caster,
    GroundLight,
    SkyPatches,
    camera_ground_light,
    plan_ground_light,
)
from lightprobe.insertion.occlusion import GroundPlan, SurfacePoints, both, over_ground, past, simplified
from lightprobe.insertion.placement import PlacedObject
from lightprobe.insertion.virtual_object import VirtualObject
from lightprobe.light import cubemap, prefilter
from lightprobe.light.environment import Environment
from lightprobe.light.photometry import luma
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
        """Return the light of a map with the radiance `ground` (3,), unless it is None, below the horizon."""
        texels = environment.texels
        if ground is not None:
            below = cubemap.directions(environment.resolution, environment.device)[..., 2:] < 0
            texels = torch.where(below, ground, texels)
        operator = prefilter.cached(environment.resolution, environment.device)
        return Light(texels, operator, operator.apply(texels), Suns.of(texels))


@dataclass(frozen=True)
class SceneLighting:
    """Both objects with all that is known of the light on them."""

    light: Light
    ground: GroundLight  # at the photo's pixels
    points: SurfacePoints  # of the virtual object
    virtual_visibility: VertexVisibility
    known_before: VertexVisibility  # without the virtual object
    known_after: VertexVisibility
    virtual_caster: Caster
    known_caster: Caster


@torch.no_grad()
def light_scene(
    asset: Asset,
    placed: PlacedObject,
    environment: Environment,
    camera: Camera,
    photo: np.ndarray,
    mask: np.ndarray,
    *,
    opaque: bool,
) -> SceneLighting:
    """Return what lights both objects and the ground, in the normalised frame, on the environment's device.

    photo (H, W, 3): linear; mask (H, W): coverage of the known object; opaque: whether the photo shows the
    ground.
    """
    virtual, known, ground = placed.virtual, asset.mesh, placed.ground
    points = SurfacePoints.of(virtual)
    solid = simplified(virtual.vertices, virtual.faces, _virtual_face_colors(virtual))
    middles = sample(asset.textures.flat(), known.uvs[known.uv_faces.long()].mean(1))
    known_solid = simplified(known.vertices, known.faces, middles[:, :3].contiguous())
    known_places = known.vertices, vertex_normals(known.vertices, known.faces)
    virtual_places = points.points, points.normals
    alone = asset.visibility or textured_visibility(known, asset.textures.flat())
    own = past(*solid, *virtual_places)
    virtual_sees = both(own, past(*known_solid, *virtual_places), virtual_places[1])
    known_sees = both(alone, past(*solid, *known_places), known_places[1])

    ring = _ring(camera, mask, asset, ground) if opaque else np.zeros(0, np.int64)
    seen = None
    if len(ring) >= _LEAST:
        seen = torch.from_numpy(photo.reshape(-1, 3)[ring]).to(environment.device)
    patches = SkyPatches.of(environment)
    light = Light.of(environment, None if seen is None else seen.median(0).values)
    known_caster = _caster(known_solid, *known_places, alone, light)
    casters = known_caster, _caster(solid, *virtual_places, virtual_sees, light)
    lit = camera_ground_light(patches, *casters, camera, ground)
    if seen is not None:  # the ground in the open
        irradiance = lit.without.reshape(-1, 3)[torch.from_numpy(ring).to(seen.device)]
        share = irradiance / patches.total().clamp(min=1e-12)
        light = Light.of(environment, (seen / share.clamp(min=0.05)).median(0).values)
    before, after = _plans(environment, *casters, ground)
    return SceneLighting(
        light,
        lit,
        points,
        over_ground(virtual_sees, *virtual_places, after),
        over_ground(alone, *known_places, before),
        over_ground(known_sees, *known_places, after),
        casters[1],
        casters[0],
    )


def _virtual_face_colors(virtual: VirtualObject) -> Tensor:
    """Return the base colour (F, 3) of the middle of each face."""
    uvs, painted = (values[virtual.faces.long()].mean(1) for values in (virtual.uvs, virtual.colors))
    colors = virtual.vertices.new_zeros(len(virtual.faces), 3)
    for k, material in enumerate(virtual.materials):
        rows = (virtual.material == k).nonzero()[:, 0]
        footprint = uvs.new_full((len(rows),), 1e-5)
        colors[rows] = material.sample(uvs[rows], painted[rows], footprint).base_color
    return colors


def _caster(
    solid: tuple[Tensor, Tensor, Tensor],
    points: Tensor,
    normals: Tensor,
    visibility: VertexVisibility,
    light: Light,
) -> Caster:
    """Return a mesh as a caster, with the radiance of a matt surface in the light at the points nearest its
    faces.

    solid: vertices, faces and face colours; visibility: of the points (N, 3) with normals (N, 3).
    """
    vertices, faces, colors = solid
    rows = torch.arange(len(normals), device=normals.device)[:, None]
    seen = PointVisibility(visibility, rows, torch.ones_like(rows, dtype=normals.dtype))
    found = seen.light(light.levels[light.operator.first_block :], normals)
    arriving = found[:, :3] + visibility.occluder_color * (1 - found[:, 6:]) * found[:, 3:6]
    middles = vertices[faces.long()].mean(1).cpu().numpy()
    nearest = scipy.spatial.cKDTree(points.cpu().numpy()).query(middles)[1]
    return Caster(vertices, faces, colors * arriving[torch.from_numpy(nearest).to(colors.device)])


def _ring(camera: Camera, mask: np.ndarray, asset: Asset, ground: float) -> np.ndarray:
    """Return the flat indices (N,) of pixels that see the ground around the known object, and not the object."""
    height, width = mask.shape
    margin = max(1, round(_MARGIN * max(height, width)))
    row, column = np.nonzero(scipy.ndimage.distance_transform_edt(mask < 0.02) > margin)
    x, y = (column + 0.5 - camera.cx) / camera.fx, -(row + 0.5 - camera.cy) / camera.fy
    ray = np.stack([x, y, -np.ones(len(row))], 1) @ camera.camera_to_world[:3, :3].T
    with np.errstate(divide="ignore", invalid="ignore"):
        along = (ground - camera.position[2]) / ray[:, 2]
    point = camera.position[:2] + along[:, None] * ray[:, :2]
    known = asset.mesh.vertices[:, :2].cpu().numpy()
    middle = (known.min(0) + known.max(0)) / 2
    reach = _RING * np.linalg.norm(known - middle, axis=1).max()
    near = (along > 0) & np.isfinite(along) & (np.linalg.norm(point - middle, axis=1) < reach)
    return (row * width + column)[near]


def _plans(
    environment: Environment, known: Caster, virtual: Caster, ground: float
) -> tuple[GroundPlan, GroundPlan]:
    """Return plans of the light on a square of ground around both objects, without and with the virtual one."""
    flat = torch.cat([caster.vertices[:, :2] for caster in (known, virtual)])
    low, high = flat.amin(0), flat.amax(0)
    side = _REACH * float((high - low).amax()) / 2
    corner, cell = (low + high) / 2 - side / 2, side / _PLAN
    patches = SkyPatches.of(environment, _PLAN_CUTS)
    light = plan_ground_light(patches, known, virtual, ground, corner, cell, _PLAN)
    open_ground = luma(patches.total()).clamp(min=1e-12)
    without, with_virtual = (
        GroundPlan(corner, cell, ground, (luma(irradiance) / open_ground).clamp(0, 1))
        for irradiance in (light.without, light.without + light.added)
    )
    return without, with_virtual
