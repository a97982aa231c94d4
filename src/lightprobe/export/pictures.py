"""The material as the three PNG files of glTF: base colour in sRGB, ORM and normals linear."""

from pathlib import Path

import numpy as np

from lightprobe.export.glb import GltfPictures
from lightprobe.imaging import write_png
from lightprobe.material.textures import Textures

NAMES = ("base_color", "orm", "normal")


def write_pictures(textures: Textures, folder: Path) -> GltfPictures:
    """Write base_color.png, orm.png (R occlusion = 1, G roughness, B metallic) and normal.png; return their bytes."""
    color, roughness, metallic, normal = (
        t.detach().cpu().numpy() for t in (textures.base_color, textures.roughness, textures.metallic, textures.normal)
    )
    orm = np.stack([np.ones_like(roughness), roughness, metallic], axis=-1)
    for name, picture in zip(NAMES, (color, orm, 0.5 + 0.5 * normal), strict=True):
        write_png(folder / f"{name}.png", np.clip(picture, 0, 1), srgb=name == "base_color")
    return GltfPictures(*((folder / f"{name}.png").read_bytes() for name in NAMES))
