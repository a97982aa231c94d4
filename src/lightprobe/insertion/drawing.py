"""Pictures of the thing under the photo's light, and of what it changes on the known object.

The thing is drawn with 2 x 2 samples a pixel and smooth outlines (`render.silhouette`), in bands of rows, as
`render.picture` does it.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import torch
from torch import Tensor
from torch.nn import functional

from lightprobe.geometry.mesh import EdgeFaces, Mesh, edge_faces, face_normals, uv_tangents
from lightprobe.insertion.lighting import Stage
from lightprobe.insertion.materials import Sampled
from lightprobe.insertion.thing import Thing
from lightprobe.render.asset import Asset, asset_gbuffer, mapped_normals
from lightprobe.render.gbuffer import GBuffer
from lightprobe.render.picture import SAMPLES
from lightprobe.render.silhouette import coverage, outline_vertices, silhouette_crossings, spread_color
from lightprobe.render.split_sum import Shading
from lightprobe.render.suns import sharpened
from lightprobe.render.surface import Surface, View, face_camera, visible_surface
from lightprobe.render.visibility import PointVisibility
from lightprobe.scene.camera import Camera

_BAND = 2**20  # samples in a band of the picture
_RIM = 1  # rows of pixels around a band, for outlines between it and its neighbours
_KNOWN_SIDE = 640  # pixels of the longer side at which changes of the known object are found


@dataclass(frozen=True)
class Window:
    """The part of the photo that the thing can be seen in."""

    left: int
    top: int
    width: int
    height: int

    @property
    def slices(self) -> tuple[slice, slice]:
        """Rows and columns of the photo."""
        return slice(self.top, self.top + self.height), slice(self.left, self.left + self.width)

    def cut(self, camera: Camera) -> Camera:
        """Return the camera that takes this part."""
        return replace(
            camera, cx=camera.cx - self.left, cy=camera.cy - self.top, width=self.width, height=self.height
        )


def window_of(vertices: Tensor, camera: Camera) -> Window | None:
    """Return the part of a camera's picture that vertices (V, 3) can be seen in, None where none can."""
    screen = View.of(camera, vertices.device).project(vertices)
    if not bool((screen[:, 2] > 1e-3).all()):
        return None
    low, high = (screen[:, :2].amin(0).floor() - 1).tolist(), (screen[:, :2].amax(0).ceil() + 1).tolist()
    left, top = max(0, int(max(low[0], 0))), max(0, int(max(low[1], 0)))
    right, bottom = int(min(high[0], camera.width)), int(min(high[1], camera.height))
    return Window(left, top, right - left, bottom - top) if left < right and top < bottom else None


@dataclass(frozen=True)
class Drawn:
    """The thing alone, in its window."""

    radiance: Tensor  # (h, w, 3) linear, premultiplied
    cover: Tensor  # (h, w)
    depth: Tensor  # (h, w) along the view axis, where it is covered


@torch.no_grad()
def draw_thing(thing: Thing, stage: Stage, camera: Camera) -> Drawn:
    """Return the picture (H, W) that a normalised-frame camera, cut to the thing's window, takes of it."""
    device = thing.vertices.device
    mesh = Mesh(thing.vertices, thing.faces, thing.uvs[:, :2].contiguous(), thing.faces)
    edges = edge_faces(
        thing.faces, outline_vertices(View.of(camera, device).project(thing.vertices), thing.faces)
    )
    tangents = uv_tangents(mesh)
    bands = [_draw_band(thing, mesh, edges, tangents, stage, *band) for band in _bands(camera)]
    planes = torch.cat(bands, 1)
    cover = planes[3]
    return Drawn(planes[:3].permute(1, 2, 0), cover, planes[4] / planes[5].clamp(min=1e-6))


def _bands(camera: Camera) -> Iterator[tuple[Camera, slice]]:
    """Yield cameras of bands of rows with a rim, and which of their rows count."""
    step = max(1, _BAND // (SAMPLES**2 * camera.width))
    for top in range(0, camera.height, step):
        bottom = min(top + step, camera.height)
        first, last = max(0, top - _RIM), min(camera.height, bottom + _RIM)
        yield replace(camera, cy=camera.cy - first, height=last - first), slice(top - first, bottom - first)


def _draw_band(
    thing: Thing, mesh: Mesh, edges: EdgeFaces, tangents: Tensor, stage: Stage, camera: Camera, rows: slice
) -> Tensor:
    """Return radiance 3, coverage, depth times presence, and presence of the band's rows, (6, h, W)."""
    device = thing.vertices.device
    view = View.of(camera.resized(SAMPLES * camera.width, SAMPLES * camera.height), device)
    screen = view.project(thing.vertices)
    surface = visible_surface(thing.vertices, thing.faces, view, screen)
    count = view.height * view.width
    if len(surface.pixel) == 0:
        return torch.zeros(6, rows.stop - rows.start, camera.width, device=device)
    surface = _facing(surface, thing)
    gbuffer, material = _gbuffer(thing, mesh, tangents, stage, surface, view, screen)
    radiance = shaded(gbuffer, stage, mesh, [(stage.known_caster.vertices, stage.known_caster.faces)])
    radiance = radiance + material.emission
    crossings = silhouette_crossings(screen, thing.faces, edges, surface.pixel, view)
    cover = coverage(surface.pixel, crossings, count)
    colored = torch.cat([radiance, torch.ones_like(radiance[:, :1])], 1) * material.alpha[:, None]
    image = spread_color(colored, surface.pixel, crossings, cover)
    axis = view.rotation[:, 2]
    depth = torch.zeros(count, 2, device=device)
    depth[surface.pixel, 0] = (view.position - surface.position) @ axis
    depth[surface.pixel, 1] = 1
    planes = torch.cat([image, depth], 1).T.reshape(1, 6, view.height, view.width)
    return functional.avg_pool2d(planes, SAMPLES)[0][:, rows]


def _facing(surface: Surface, thing: Thing) -> Surface:
    """Return the surface with the other side of two-sided faces where that is the one that looks at the
    camera.
    """
    outward = face_normals(thing.vertices, thing.faces[surface.face])
    twin = thing.twin[surface.face]
    turned = ((outward * surface.view).sum(1) < 0) & (twin >= 0)
    swapped = surface.barycentric[:, [0, 2, 1]]
    return replace(
        surface,
        face=torch.where(turned, twin, surface.face),
        barycentric=torch.where(turned[:, None], swapped, surface.barycentric),
    )


def _gbuffer(
    thing: Thing, mesh: Mesh, tangents: Tensor, stage: Stage, surface: Surface, view: View, screen: Tensor
) -> tuple[GBuffer, Sampled]:
    material = _sampled(thing, surface, screen)
    mapped = _seen_from_behind(thing, surface.face, material.normal)
    normal = mapped_normals(surface, mesh, thing.normals, tangents, mapped)
    outward = face_normals(thing.vertices, thing.faces[surface.face])
    away = (outward * surface.view).sum(1, keepdim=True) < 0  # the inside of a one-sided face
    normal = face_camera(torch.where(away, -normal, normal), surface.view)
    index, weight = stage.points.taps(surface.face, surface.barycentric)
    visibility = PointVisibility(stage.thing_visibility, index, weight)
    gbuffer = GBuffer(
        view.height,
        view.width,
        surface.pixel,
        surface.face,
        surface.position,
        normal,
        surface.view,
        material.base_color,
        material.roughness,
        material.metallic,
        visibility,
    )
    return gbuffer, material


def _seen_from_behind(thing: Thing, face: Tensor, mapped: Tensor) -> Tensor:
    """Return the tangent-space normals (P, 3) of a normal map at visible points, those on the back of sheets
    mirrored.

    What is bent on the front is bent the other way on the back (glTF: the normal is reversed there as a
    whole). The copy of a face that is its back has the same tangents, and its normal alone reversed.
    """
    twin = thing.twin[face]
    back = (twin >= 0) & (twin < face)  # copies follow the faces that they are copies of
    return torch.where(back[:, None], mapped * mapped.new_tensor([-1.0, -1.0, 1.0]), mapped)


def _sampled(thing: Thing, surface: Surface, screen: Tensor) -> Sampled:
    """Return the material at the visible points; textures are looked up as coarsely as the samples lie."""
    uvs, colors = (surface.interpolate(values, thing.faces) for values in (thing.uvs, thing.colors))
    corners = thing.faces[surface.face].long()
    texture, shown = (_area(values[corners]) for values in (thing.uvs[:, :2], screen[:, :2]))
    footprint = texture / shown.clamp(min=1e-3)
    rows = [(thing.material[surface.face] == k).nonzero()[:, 0] for k in range(len(thing.materials))]
    parts = [
        material.sample(uvs[own], colors[own], footprint[own])
        for material, own in zip(thing.materials, rows, strict=True)
    ]
    order = torch.argsort(torch.cat(rows))
    return Sampled(*(torch.cat([getattr(p, name) for p in parts])[order] for name in vars(parts[0])))


def _area(corners: Tensor) -> Tensor:
    """Return the areas (N,) of triangles (N, 3, 2)."""
    (x1, y1), (x2, y2) = ((corners[:, k] - corners[:, 0]).unbind(1) for k in (1, 2))
    return 0.5 * (x1 * y2 - y1 * x2).abs()


def shaded(gbuffer: GBuffer, stage: Stage, mesh: Mesh, others: list[tuple[Tensor, Tensor]]) -> Tensor:
    """Return the radiance (P, 3) of a G-buffer with visibility; `others` cast suns' shadows besides its own
    mesh.
    """
    shading = Shading.of(gbuffer, stage.light.operator)
    radiance = shading.apply(stage.light.levels)
    if len(stage.light.suns.block):
        radiance = radiance + shading.factors[1] * sharpened(gbuffer, mesh, stage.light.suns, others)
    return radiance.clamp(min=0)


@dataclass(frozen=True)
class KnownChange:
    """What the thing does to the known object, at the pixels of a picture of it."""

    factor: Tensor  # (h, w, 3) of its radiance; meaningless where it is not covered
    depth: Tensor  # (h, w) along the view axis
    covered: Tensor  # (h, w) bool
    radiance: Tensor  # (h, w, 3) without the thing


@torch.no_grad()
def draw_known_change(asset: Asset, stage: Stage, camera: Camera) -> KnownChange:
    """Return the change at the pixels of the camera's picture, at most 640 along its longer side."""
    small = camera.within(_KNOWN_SIDE)
    device = stage.light.texels.device
    view = View.of(small, device)
    surface = visible_surface(asset.mesh.vertices, asset.mesh.faces, view)
    images = []
    casters = [(stage.thing_caster.vertices, stage.thing_caster.faces)]
    for visibility, others in ((stage.known_before, []), (stage.known_after, casters)):
        gbuffer = asset_gbuffer(replace(asset, visibility=visibility), surface, view)
        images.append(shaded(gbuffer, stage, asset.mesh, others))
    floor = 1e-3 * images[0].mean().clamp(min=1e-9)
    planes = torch.zeros(view.height * view.width, 8, device=device)
    planes[surface.pixel, :3] = (images[1] + floor) / (images[0] + floor)
    planes[surface.pixel, 3] = (view.position - surface.position) @ view.rotation[:, 2]
    planes[surface.pixel, 4] = 1
    planes[surface.pixel, 5:] = images[0]
    planes = planes.reshape(view.height, view.width, 8)
    return KnownChange(planes[..., :3], planes[..., 3], planes[..., 4] > 0, planes[..., 5:])
