"""Renders in files, and the material as the three PNG files of glTF: base colour sRGB, others linear."""

from pathlib import Path

import numpy as np
import torch

from lightprobe.export.glb import GltfPictures
from lightprobe.geometry.mesh import vertex_normals
from lightprobe.geometry.texels import bake_vertices
from lightprobe.imaging import write_exr, write_png
from lightprobe.render.asset import Asset
from lightprobe.render.visibility import ambient_occlusion

NAMES = ("base_color", "orm", "normal")


def write_pictures(asset: Asset, folder: Path) -> GltfPictures:
    """Write base_color.png, orm.png (R occlusion, G roughness, B metallic), normal.png; return the bytes."""
    textures = asset.textures
    parts = textures.base_color, textures.roughness, textures.metallic, textures.normal
    color, roughness, metallic, normal = (part.detach().cpu().numpy() for part in parts)
    orm = np.stack([_occlusion(asset), roughness, metallic], axis=-1)
    for name, picture in zip(NAMES, (color, orm, 0.5 + 0.5 * normal), strict=True):
        write_png(folder / f"{name}.png", np.clip(picture, 0, 1), srgb=name == "base_color")
    return GltfPictures(*((folder / f"{name}.png").read_bytes() for name in NAMES))


def _occlusion(asset: Asset) -> np.ndarray:
    """Return the ambient occlusion (S, S), 1 for open; all 1 for an object that casts no shadows on itself."""
    mesh, size = asset.mesh, asset.textures.size
    if asset.visibility is None:
        return np.ones((size, size), np.float32)
    opened = ambient_occlusion(asset.visibility, vertex_normals(mesh.vertices, mesh.faces))
    return bake_vertices(mesh, opened[:, None], size)[..., 0].cpu().numpy()


def write_picture(path: Path, image: torch.Tensor, cover: torch.Tensor) -> None:
    """Write a premultiplied linear image and coverage (H, W): straight sRGB PNG or premultiplied EXR."""
    color, alpha = image.cpu().numpy(), cover.cpu().numpy()
    if path.suffix.lower() == ".exr":
        write_exr(path, np.concatenate([color, alpha[..., None]], axis=2))
    else:
        write_png(path, color / np.maximum(alpha, 1e-6)[..., None], alpha)
