"""From lattice and field to a textured mesh: filling, cleaning, smoothing, decimation, unwrapping and baking."""

from collections.abc import Callable, Sequence
from dataclasses import replace

import torch
from torch import Tensor

from lightprobe.core.config import DecomposeConfig, SdfMode
from lightprobe.core.errors import ConvergenceError
from lightprobe.geometry.atlas import unwrap
from lightprobe.geometry.mesh import Mesh, clean, crease_normals, decimate, smooth, uv_tangents
from lightprobe.geometry.texels import fill_texels, texel_points
from lightprobe.geometry.textures import Textures
from lightprobe.reconstruction.lattice_model import LatticeModel
from lightprobe.render.asset import Asset, textured_visibility, uv_handedness
from lightprobe.render.surface import View, visible_surface

_BESIDE = 1.0  # lattice cells behind the visible surface that count as seen: pixels are coarser than edges
_MARGIN = 2  # edges of the lattice around what is seen that stay as they are


@torch.no_grad()
def fill_unseen(model: LatticeModel, views: Sequence[View]) -> None:
    """Make solid what the model's surface hides from all of the views.

    Inside the solid no photo holds the distances, and the first pass leaves caves there. Closed ones are
    dropped with their surface (`geometry.mesh.clean`); those with a way out, through what photos do not see
    either, would take triangles and texels from what they do see: more than half of both where an opening of
    the object is closed in its masks. What lies out of the picture in all views, and what a network of
    distances says, stays as it is.
    """
    if model.config.sdf is SdfMode.MLP:
        return
    distance, edges = model.distances(), model.lattice.edges
    outside = distance >= 0
    kept = outside & ~_hidden(model, views)
    open_edges = edges[outside[edges].all(1)]
    for _ in range(_MARGIN):
        kept[open_edges[kept[open_edges].any(1)].reshape(-1)] = True
    filled = outside & ~kept
    if bool(filled.any()):
        model.reshape(torch.where(filled, distance.new_tensor(-model.lattice.cell), distance))


def _hidden(model: LatticeModel, views: Sequence[View]) -> Tensor:
    """Return which of the lattice's L vertices, (L,) bool, the surface hides in all views that frame them."""
    vertices, faces = model.present()
    points = model.positions()
    shown, framed = torch.zeros((2, len(points)), dtype=torch.bool, device=points.device)
    for view in views:
        surface = visible_surface(vertices, faces, view)
        nearest = points.new_full((view.height * view.width,), torch.inf)
        nearest[surface.pixel] = view.project(surface.position)[:, 2]
        x, y, depth = view.project(points).unbind(1)
        inside = (depth > 0) & (x >= 0) & (y >= 0) & (x < view.width) & (y < view.height)
        pixel = (y[inside].long() * view.width + x[inside].long()).clamp(max=len(nearest) - 1)
        framed |= inside
        shown[inside] |= depth[inside] < nearest[pixel] + _BESIDE * model.lattice.cell
    return framed & ~shown


def bake(
    model: LatticeModel, config: DecomposeConfig, device: torch.device, tell: Callable[[str], None]
) -> Asset:
    """Return the model's surface and materials as a textured mesh; `tell` hears of an unwrapper that gave up."""
    vertices, faces = clean(*model.extract())
    if len(faces) == 0:
        raise ConvergenceError(
            "The reconstructed surface is only small pieces; check masks and cameras with `inspect`."
        )
    if config.surface_smoothing > 0:
        vertices = smooth(vertices, faces, config.surface_smoothing)
    vertices, faces = clean(*decimate(vertices, faces, config.max_faces))
    mesh, size = unwrap(vertices, faces, config.texture_size, config.unwrap_seconds)
    if size > config.texture_size:
        tell(
            f"the unwrapper did not finish in {config.unwrap_seconds:g} s: "
            f"triangles on a grid, textures of {size}²"
        )
    mesh = mesh.to(device)
    mesh = replace(mesh, normal_faces=crease_normals(mesh.vertices, mesh.faces, config.crease_degrees))
    textures = bake_textures(model, mesh, size)
    seen = textured_visibility(mesh, textures.flat(), config.depth_map_side) if config.shadows else None
    return Asset(mesh, textures, seen)


@torch.no_grad()
def bake_textures(model: LatticeModel, mesh: Mesh, size: int) -> Textures:
    """Return the field's material on the texels of `mesh`; those outside all charts repeat the nearest."""
    face, barycentric, texel = texel_points(mesh, size)
    corners = mesh.faces[face].long()
    position = (mesh.vertices[corners] * barycentric[..., None]).sum(1)
    channels = torch.cat([model.material(chunk) for chunk in position.split(65536)])
    normals = (mesh.normals()[mesh.normal_index[face].long()] * barycentric[..., None]).sum(1)
    tangents = (uv_tangents(mesh)[mesh.uv_faces[face].long()] * barycentric[..., None]).sum(1)
    channels[:, 5:] = _to_tangent_space(channels[:, 5:], normals, tangents, uv_handedness(mesh)[face])
    flat = torch.zeros(size * size, channels.shape[1], device=channels.device)
    flat[texel] = channels
    return Textures.from_flat(fill_texels(flat, texel, size))


def _to_tangent_space(offset: Tensor, normals: Tensor, tangents: Tensor, handedness: Tensor) -> Tensor:
    """Return the tangent-space unit normals (K, 3) of world-axes normal offsets."""
    n = torch.nn.functional.normalize(normals, dim=1)
    t = torch.nn.functional.normalize(tangents - (tangents * n).sum(1, keepdim=True) * n, dim=1)
    b = torch.linalg.cross(n, t) * handedness[:, None]
    bent = torch.nn.functional.normalize(n + offset, dim=1)
    return torch.stack([(bent * axis).sum(1) for axis in (t, b, n)], 1)
