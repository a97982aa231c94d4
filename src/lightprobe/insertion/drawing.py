"""Pictures of the virtual object under the photo's light, and of what it changes on the known object.

The virtual object is drawn with 2 x 2 samples a pixel and smooth outlines (`render.silhouette`), in bands of
rows, as in `render.picture`.
"""

from dataclasses import dataclass, replace

import torch
from torch import Tensor
from torch.nn import functional

from lightprobe.geometry.mesh import EdgeFaces, Mesh, edge_faces, face_normals, uv_tangents
from lightprobe.insertion.lighting import SceneLighting
from lightprobe.insertion.materials import Sampled
from lightprobe.insertion.virtual_object import VirtualObject
from lightprobe.render.asset import Asset, asset_gbuffer, gbuffer_of, mapped_normals
from lightprobe.render.gbuffer import GBuffer
from lightprobe.render.picture import SAMPLES, row_bands
from lightprobe.render.silhouette import coverage, outline_vertices, silhouette_crossings, spread_color
from lightprobe.render.split_sum import Shading
from lightprobe.render.suns import sharpened
from lightprobe.render.surface import Surface, View, face_camera, visible_surface
from lightprobe.render.visibility import PointVisibility
from lightprobe.scene.camera import Camera

_KNOWN_SIDE = 640  # pixels of the longer side at which changes of the known object are found


Window = tuple[slice, slice]  # rows and columns of the photo


def window_of(vertices: Tensor, camera: Camera) -> Window | None:
    """Return the part of a camera's picture that vertices (V, 3) can be seen in, None where none can."""
    screen = View.of(camera, vertices.device).project(vertices)
    if not bool((screen[:, 2] > 1e-3).all()):
        return None
    low, high = (screen[:, :2].amin(0).floor() - 1).tolist(), (screen[:, :2].amax(0).ceil() + 1).tolist()
    left, top = max(0, int(max(low[0], 0))), max(0, int(max(low[1], 0)))
    right, bottom = int(min(high[0], camera.width)), int(min(high[1], camera.height))
    return (slice(top, bottom), slice(left, right)) if left < right and top < bottom else None


@dataclass(frozen=True)
class Drawn:
    """The virtual object alone, in its window."""

    radiance: Tensor  # (h, w, 3) linear, premultiplied
    cover: Tensor  # (h, w)
    depth: Tensor  # (h, w) along the view axis, where it is covered


@torch.no_grad()
def draw_virtual(virtual: VirtualObject, lighting: SceneLighting, camera: Camera, window: Window) -> Drawn:
    """Return the part of a normalised-frame camera's picture that the virtual object can be seen in."""
    rows, columns = window
    cx, cy = camera.cx - columns.start, camera.cy - rows.start
    camera = replace(camera, cx=cx, cy=cy, width=columns.stop - columns.start, height=rows.stop - rows.start)
    mesh = Mesh(virtual.vertices, virtual.faces, virtual.uvs[:, :2].contiguous(), virtual.faces)
    screen = View.of(camera, virtual.vertices.device).project(virtual.vertices)
    edges = edge_faces(virtual.faces, outline_vertices(screen, virtual.faces))
    drawing = _Drawing(virtual, mesh, edges, uv_tangents(mesh), lighting)
    planes = torch.cat([drawing.band(band)[:, inner] for _, band, inner in row_bands(camera)], 1)
    return Drawn(planes[:3].permute(1, 2, 0), planes[3], planes[4] / planes[5].clamp(min=1e-6))


@dataclass(frozen=True)
class _Drawing:
    """The virtual object, with all that does not depend on the band of rows that is drawn."""

    virtual: VirtualObject
    mesh: Mesh
    edges: EdgeFaces
    tangents: Tensor
    lighting: SceneLighting

    def band(self, camera: Camera) -> Tensor:
        """Return radiance 3, coverage, depth times presence, and presence of the camera's picture, (6, h, W)."""
        virtual = self.virtual
        camera = camera.resized(SAMPLES * camera.width, SAMPLES * camera.height)
        view = View.of(camera, virtual.vertices.device)
        screen = view.project(virtual.vertices)
        surface = visible_surface(virtual.vertices, virtual.faces, view, screen)
        if len(surface.pixel) == 0:
            return screen.new_zeros(6, view.height // SAMPLES, view.width // SAMPLES)
        surface = _facing(surface, virtual)
        gbuffer, material = self._gbuffer(surface, view, screen)
        known = self.lighting.known_caster
        radiance = shaded(gbuffer, self.lighting, self.mesh, [(known.vertices, known.faces)])
        radiance = radiance + material.emission
        crossings = silhouette_crossings(screen, virtual.faces, self.edges, surface.pixel, view)
        cover = coverage(surface.pixel, crossings, view.height * view.width)
        colored = torch.cat([radiance, torch.ones_like(radiance[:, :1])], 1) * material.alpha[:, None]
        image = spread_color(colored, surface.pixel, crossings, cover)
        depth = screen.new_zeros(len(cover), 2)
        depth[surface.pixel, 0] = (view.position - surface.position) @ view.rotation[:, 2]
        depth[surface.pixel, 1] = 1
        planes = torch.cat([image, depth], 1).T.reshape(1, 6, view.height, view.width)
        return functional.avg_pool2d(planes, SAMPLES)[0]

    def _gbuffer(self, surface: Surface, view: View, screen: Tensor) -> tuple[GBuffer, Sampled]:
        virtual, material = self.virtual, _sampled(self.virtual, surface, screen)
        mapped = _seen_from_behind(virtual, surface.face, material.normal)
        normal = mapped_normals(surface, self.mesh, virtual.normals, self.tangents, mapped)
        outward = face_normals(virtual.vertices, virtual.faces[surface.face])
        away = (outward * surface.view).sum(1, keepdim=True) < 0  # the inside of a one-sided face
        normal = face_camera(torch.where(away, -normal, normal), surface.view)
        taps = self.lighting.points.taps(surface.face, surface.barycentric)
        visibility = PointVisibility(self.lighting.virtual_visibility, *taps)
        look = torch.cat([material.base_color, material.roughness[:, None], material.metallic[:, None]], 1)
        return gbuffer_of(surface, view, normal, look, visibility), material


def _facing(surface: Surface, virtual: VirtualObject) -> Surface:
    """Return the surface with the other side of two-sided faces where it looks at the camera."""
    outward = face_normals(virtual.vertices, virtual.faces[surface.face])
    twin = virtual.twin[surface.face]
    turned = ((outward * surface.view).sum(1) < 0) & (twin >= 0)
    swapped = surface.barycentric[:, [0, 2, 1]]
    face = torch.where(turned, twin, surface.face)
    return replace(surface, face=face, barycentric=torch.where(turned[:, None], swapped, surface.barycentric))


def _seen_from_behind(virtual: VirtualObject, face: Tensor, mapped: Tensor) -> Tensor:
    """Return the tangent-space normals (P, 3) of a normal map at visible points, on the back of sheets
    mirrored.

    glTF reverses the normal on the back as a whole; the copy of a face that is its back has the same
    tangents, and its normal alone reversed.
    """
    twin = virtual.twin[face]
    back = (twin >= 0) & (twin < face)  # copies follow the faces that they are copies of
    return torch.where(back[:, None], mapped * mapped.new_tensor([-1.0, -1.0, 1.0]), mapped)


def _sampled(virtual: VirtualObject, surface: Surface, screen: Tensor) -> Sampled:
    """Return the material at the visible points; textures are looked up as coarsely as the samples lie."""
    uvs, colors = (surface.interpolate(values, virtual.faces) for values in (virtual.uvs, virtual.colors))
    corners = virtual.faces[surface.face].long()
    texture, shown = (_area(values[corners]) for values in (virtual.uvs[:, :2], screen[:, :2]))
    footprint = texture / shown.clamp(min=1e-3)
    rows = [(virtual.material[surface.face] == k).nonzero()[:, 0] for k in range(len(virtual.materials))]
    pairs = zip(virtual.materials, rows, strict=True)
    parts = [material.sample(uvs[own], colors[own], footprint[own]) for material, own in pairs]
    order = torch.argsort(torch.cat(rows))
    return Sampled(*(torch.cat([getattr(p, name) for p in parts])[order] for name in vars(parts[0])))


def _area(corners: Tensor) -> Tensor:
    """Return the areas (N,) of triangles (N, 3, 2)."""
    (x1, y1), (x2, y2) = ((corners[:, k] - corners[:, 0]).unbind(1) for k in (1, 2))
    return 0.5 * (x1 * y2 - y1 * x2).abs()


def shaded(
    gbuffer: GBuffer, lighting: SceneLighting, mesh: Mesh, others: list[tuple[Tensor, Tensor]]
) -> Tensor:
    """Return the radiance (P, 3) of a G-buffer with visibility; its mesh and `others` cast suns' shadows."""
    shading = Shading.of(gbuffer, lighting.light.operator)
    radiance = shading.apply(lighting.light.levels)
    if len(lighting.light.suns.block):
        radiance = radiance + shading.factors[1] * sharpened(gbuffer, mesh, lighting.light.suns, others)
    return radiance.clamp(min=0)


@dataclass(frozen=True)
class KnownChange:
    """What the virtual object does to the known object, at the pixels of a picture of it."""

    factor: Tensor  # (h, w, 3) of its radiance; meaningless where it is not covered
    depth: Tensor  # (h, w) along the view axis
    covered: Tensor  # (h, w) bool
    radiance: Tensor  # (h, w, 3) without the virtual object


@torch.no_grad()
def draw_known_change(asset: Asset, lighting: SceneLighting, camera: Camera) -> KnownChange:
    """Return the change at the pixels of the camera's picture, at most 640 along its longer side."""
    small = camera.within(_KNOWN_SIDE)
    device = lighting.light.texels.device
    view = View.of(small, device)
    surface = visible_surface(asset.mesh.vertices, asset.mesh.faces, view)
    images = []
    casters = [(lighting.virtual_caster.vertices, lighting.virtual_caster.faces)]
    for visibility, others in ((lighting.known_before, []), (lighting.known_after, casters)):
        gbuffer = asset_gbuffer(replace(asset, visibility=visibility), surface, view)
        images.append(shaded(gbuffer, lighting, asset.mesh, others))
    floor = 1e-3 * images[0].mean().clamp(min=1e-9)
    planes = torch.zeros(view.height * view.width, 8, device=device)
    planes[surface.pixel, :3] = (images[1] + floor) / (images[0] + floor)
    planes[surface.pixel, 3] = (view.position - surface.position) @ view.rotation[:, 2]
    planes[surface.pixel, 4] = 1
    planes[surface.pixel, 5:] = images[0]
    planes = planes.reshape(view.height, view.width, 8)
    return KnownChange(planes[..., :3], planes[..., 3], planes[..., 4] > 0, planes[..., 5:])
