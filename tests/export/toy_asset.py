"""A small asset with what exporters stumble over."""

import numpy as np
import torch

from lightprobe.geometry.mesh import Mesh
from lightprobe.geometry.textures import Textures
from lightprobe.scene.camera import Similarity
from tests.shapes import sphere_mesh

SIMILARITY = Similarity(np.array([2.0, -1.0, 5.0]), 0.5)


def toy_textures(size: int = 32) -> Textures:
    ramp = torch.linspace(0, 1, size)
    color = torch.stack((*torch.meshgrid(ramp, ramp, indexing="ij"), torch.full((size, size), 0.25)), -1)
    bump = torch.stack([0.3 * torch.sin(9 * color[..., 0]), 0.2 * color[..., 1], torch.ones(size, size)], -1)
    normal = torch.nn.functional.normalize(bump, dim=-1)
    return Textures(color, 0.2 + 0.6 * color[..., 0], color[..., 1], normal)


def difficult_mesh() -> Mesh:
    """A sphere with mirrored charts, a vertex without a normal and triangles without UV area."""
    mesh = sphere_mesh(2)
    uvs = mesh.uvs.clone()
    mirrored = mesh.uv_faces[1::2].long().reshape(-1)
    uvs[mirrored, 0] = 1 - uvs[mirrored, 0]
    uvs[mesh.uv_faces[0].long()] = 0.5
    lonely = torch.tensor([[3.0, 0, 0], [3.0, 0, 0], [3.0, 0, 0]])
    faces = torch.cat([mesh.faces, torch.arange(3, dtype=torch.int32)[None] + len(mesh.vertices)])
    uv_faces = torch.cat([mesh.uv_faces, mesh.uv_faces[:1]])
    return Mesh(torch.cat([mesh.vertices, lonely]), faces, uvs, uv_faces)
