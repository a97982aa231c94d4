"""From lattice and field to a textured mesh: cleaning, decimation, unwrapping and baking."""

import numpy as np
import torch
from scipy import ndimage
from torch import Tensor

from lightprobe.core.config import DecomposeConfig
from lightprobe.core.errors import ConvergenceError
from lightprobe.decompose.lattice_model import LatticeModel
from lightprobe.geometry.atlas import unwrap
from lightprobe.geometry.mesh import Mesh, clean, decimate, uv_tangents, vertex_normals
from lightprobe.kernels import rasterize
from lightprobe.material.textures import Textures
from lightprobe.render.asset import Asset, uv_handedness
from lightprobe.render.openness import openness_table


def bake(model: LatticeModel, config: DecomposeConfig, device: torch.device) -> Asset:
    """Return the model's surface and materials as a textured mesh."""
    vertices, faces = clean(*model.extract())
    if len(faces) == 0:
        raise ConvergenceError("The reconstructed surface is only crumbs; check masks and cameras with `inspect`.")
    vertices, faces = clean(*decimate(vertices, faces, config.max_faces))
    mesh = unwrap(vertices, faces, config.texture_size, config.unwrap_seconds).to(device)
    openness = openness_table(mesh.vertices, mesh.faces) if config.shadows else None
    return Asset(mesh, bake_textures(model, mesh, config.texture_size), openness)


@torch.no_grad()
def bake_textures(model: LatticeModel, mesh: Mesh, size: int) -> Textures:
    """Return the field's material on the texels of `mesh`; texels outside all charts repeat the nearest one inside."""
    face, barycentric, texel = _texel_points(mesh, size)
    corners = mesh.faces[face].long()
    position = (mesh.vertices[corners] * barycentric[..., None]).sum(1)
    channels = torch.cat([model.field(chunk) for chunk in position.split(65536)])
    normals = (vertex_normals(mesh.vertices, mesh.faces)[corners] * barycentric[..., None]).sum(1)
    tangents = (uv_tangents(mesh)[mesh.uv_faces[face].long()] * barycentric[..., None]).sum(1)
    channels[:, 5:] = _to_tangent_space(channels[:, 5:], normals, tangents, uv_handedness(mesh)[face])
    flat = torch.zeros(size * size, channels.shape[1], device=channels.device)
    flat[texel] = channels
    return Textures.from_flat(_fill(flat, texel, size))


def _texel_points(mesh: Mesh, size: int) -> tuple[Tensor, Tensor, Tensor]:
    """Return face (K,), barycentric (K, 3) and flat index (K,) of the texels whose centre a chart covers."""
    screen = torch.cat([mesh.uvs * size, torch.ones_like(mesh.uvs[:, :1])], 1)
    face = rasterize(screen, mesh.uv_faces, size, size).face.reshape(-1)
    texel = (face >= 0).nonzero()[:, 0]
    face = face[texel].long()
    center = torch.stack([texel % size + 0.5, torch.div(texel, size, rounding_mode="floor") + 0.5], 1)
    a, b, c = screen[mesh.uv_faces[face].long()][..., :2].unbind(1)
    e1, e2, p = b - a, c - a, center - a
    det = e1[:, 0] * e2[:, 1] - e1[:, 1] * e2[:, 0]
    det = torch.where(det.abs() < 1e-12, torch.full_like(det, 1e-12), det)
    u = ((p[:, 0] * e2[:, 1] - p[:, 1] * e2[:, 0]) / det).clamp(0, 1)
    v = torch.minimum(((e1[:, 0] * p[:, 1] - e1[:, 1] * p[:, 0]) / det).clamp(min=0), 1 - u)
    return face, torch.stack([1 - u - v, u, v], 1), texel


def _to_tangent_space(offset: Tensor, normals: Tensor, tangents: Tensor, handedness: Tensor) -> Tensor:
    """Return the tangent-space unit normals (K, 3) of world-axes normal offsets."""
    n = torch.nn.functional.normalize(normals, dim=1)
    t = torch.nn.functional.normalize(tangents - (tangents * n).sum(1, keepdim=True) * n, dim=1)
    b = torch.linalg.cross(n, t) * handedness[:, None]
    bent = torch.nn.functional.normalize(n + offset, dim=1)
    return torch.stack([(bent * axis).sum(1) for axis in (t, b, n)], 1)


def _fill(flat: Tensor, texel: Tensor, size: int) -> Tensor:
    """Copy the nearest covered texel into every uncovered one, so that filtering over chart borders sees no black."""
    empty = np.ones(size * size, bool)
    empty[texel.cpu().numpy()] = False
    _, (i, j) = ndimage.distance_transform_edt(empty.reshape(size, size), return_indices=True)
    return flat[torch.from_numpy((i * size + j).reshape(-1)).long().to(flat.device)]
