"""Materials of a glTF file, sampled at the visible points of its surface."""

from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from torch import Tensor

from lightprobe.insertion.glb_file import number, numbers
from lightprobe.insertion.textures import Texture, TextureReader

_BRIGHTEST = 1e4  # of emission, in whites of the photo


@dataclass(frozen=True)
class Sampled:
    """A material at N points."""

    base_color: Tensor  # (N, 3) linear
    alpha: Tensor  # (N,)
    roughness: Tensor  # (N,)
    metallic: Tensor  # (N,)
    emission: Tensor  # (N, 3) linear radiance
    normal: Tensor  # (N, 3) tangent space, unit


@dataclass(frozen=True)
class Material:
    """A glTF metallic-roughness material; factors multiply textures."""

    base_factor: np.ndarray  # (4,) linear
    metallic: float
    roughness: float
    emission: np.ndarray  # (3,)
    normal_scale: float
    cutoff: float | None  # alpha below it is a hole, above it solid; None: see `blended`
    blended: bool  # whether alpha is the share of what is behind that the surface hides
    double_sided: bool
    base: Texture | None
    orm: Texture | None
    normal: Texture | None
    emissive: Texture | None

    @staticmethod
    def of(entry: dict[str, Any], reader: TextureReader) -> "Material":
        """Return the material of a document's entry, glTF's default for an empty one."""
        pbr, mode = entry.get("pbrMetallicRoughness", {}), entry.get("alphaMode", "OPAQUE")
        strength = entry.get("extensions", {}).get("KHR_materials_emissive_strength", {})
        glow = numbers(entry.get("emissiveFactor", [0, 0, 0]), 3) * number(
            strength.get("emissiveStrength", 1)
        )

        def texture(owner: dict[str, Any], key: str, *, srgb: bool, cut: bool = False) -> Texture | None:
            return reader.read(owner[key], srgb=srgb, cut=cut) if key in owner else None

        return Material(
            numbers(pbr.get("baseColorFactor", [1, 1, 1, 1]), 4).clip(0, 1),
            min(max(number(pbr.get("metallicFactor", 1)), 0), 1),
            min(max(number(pbr.get("roughnessFactor", 1)), 0), 1),
            glow.clip(0, _BRIGHTEST),
            number(entry.get("normalTexture", {}).get("scale", 1)),
            number(entry.get("alphaCutoff", 0.5)) if mode == "MASK" else None,
            mode == "BLEND",
            bool(entry.get("doubleSided", False)),
            texture(pbr, "baseColorTexture", srgb=True, cut=mode != "OPAQUE"),
            texture(pbr, "metallicRoughnessTexture", srgb=False),
            texture(entry, "normalTexture", srgb=False),
            texture(entry, "emissiveTexture", srgb=True) if glow.any() else None,
        )

    def to(self, device: torch.device) -> "Material":
        """Return the material with its textures on another device."""
        moved = {key: value.to(device) for key, value in vars(self).items() if isinstance(value, Texture)}
        return Material(**{**vars(self), **moved})

    def sample(self, uvs: Tensor, colors: Tensor, footprint: Tensor) -> Sampled:
        """Return the material at points with texture coordinates (N, 4), vertex colours (N, 4) and
        `footprint` (N,).

        footprint: as in `Texture.sample`.
        """
        one = torch.ones_like(colors)
        base, orm, glow = (
            one if texture is None else texture.sample(uvs, footprint)
            for texture in (self.base, self.orm, self.emissive)
        )
        base = base * colors * uvs.new_tensor(self.base_factor)
        normal = torch.zeros_like(base[:, :3])
        normal[:, 2] = 1
        if self.normal is not None:
            normal = 2 * self.normal.sample(uvs, footprint)[:, :3] - 1
            normal = normal * uvs.new_tensor([self.normal_scale, self.normal_scale, 1])
            normal = torch.nn.functional.normalize(normal, dim=1, eps=1e-12)
        alpha = base[:, 3] if self.blended else one[:, 0]
        if self.cutoff is not None:
            alpha = (base[:, 3] >= self.cutoff).float()
        return Sampled(
            base[:, :3].clamp(0, 1),
            alpha.clamp(0, 1),
            (self.roughness * orm[:, 1]).clamp(0.04, 1),
            (self.metallic * orm[:, 2]).clamp(0, 1),
            glow[:, :3] * uvs.new_tensor(self.emission),
            normal,
        )
