"""From the surface to its texture: which point each texel shows, and what texels outside all charts hold."""

import numpy as np
import scipy
import torch
from torch import Tensor

from lightprobe.geometry.mesh import Mesh
from lightprobe.kernels import rasterize


def texel_points(mesh: Mesh, size: int) -> tuple[Tensor, Tensor, Tensor]:
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


def fill_texels(flat: Tensor, texel: Tensor, size: int) -> Tensor:
    """Copy the nearest covered texel into every uncovered one: filtering over chart borders sees no black.

    flat (S^2, C): the texels, row by row, of a texture of `size` S, also returned; texel (K,): those that are
    covered.
    """
    empty = np.ones(size * size, bool)
    empty[texel.cpu().numpy()] = False
    _, (i, j) = scipy.ndimage.distance_transform_edt(empty.reshape(size, size), return_indices=True)
    return flat[torch.from_numpy((i * size + j).reshape(-1)).long().to(flat.device)]


def bake_vertices(mesh: Mesh, values: Tensor, size: int) -> Tensor:
    """Return per-vertex values (V, C) as a texture (S, S, C)."""
    face, barycentric, texel = texel_points(mesh, size)
    flat = values.new_zeros(size * size, values.shape[1])
    flat[texel] = (values[mesh.faces[face].long()] * barycentric[..., None]).sum(1)
    return fill_texels(flat, texel, size).reshape(size, size, -1)
