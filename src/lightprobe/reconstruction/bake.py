"""From lattice and field to a textured mesh: cleaning, smoothing, decimation, unwrapping and baking."""

from collections.abc import Callable
from dataclasses import replace

import torch
from torch import Tensor

from lightprobe.core.config import DecomposeConfig
from lightprobe.core.errors import ConvergenceError
from lightprobe.geometry.atlas import unwrap
from lightprobe.geometry.mesh import Mesh, clean, crease_normals, decimate, smooth, uv_tangents
from lightprobe.geometry.texels import fill_texels, texel_points
from lightprobe.material.textures import Textures
from lightprobe.reconstruction.lattice_model import LatticeModel
from lightprobe.render.asset import Asset, textured_visibility, uv_handedness


def bake(
    model: LatticeModel, config: DecomposeConfig, device: torch.device, tell: Callable[[str], None]
) -> Asset:
    """Return the model's surface and materials as a textured mesh; `tell` hears of what went otherwise than
    usual.
    """
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
            f"the unwrapper did not finish in {config.unwrap_seconds:g} s: triangles on a grid, textures of {size}²"
        )
    mesh = mesh.to(device)
    mesh = replace(mesh, normal_faces=crease_normals(mesh.vertices, mesh.faces, config.crease_degrees))
    textures = bake_textures(model, mesh, size)
    seen = textured_visibility(mesh, textures.flat(), config.depth_map_side) if config.shadows else None
    return Asset(mesh, textures, seen)


@torch.no_grad()
def bake_textures(model: LatticeModel, mesh: Mesh, size: int) -> Textures:
    """Return the field's material on the texels of `mesh`; texels outside all charts repeat the nearest one
    inside.
    """
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
