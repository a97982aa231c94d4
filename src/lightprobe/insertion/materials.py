"""Materials of a glTF file, sampled at the visible points of its surface, and their textures.

A texture has any shape, is repeated or clamped, and has coarser levels for far views. Texels stay 8-bit in
memory and become linear numbers when they are looked up. A texture is reduced to 2048 texels along its longer
side; an object in a photo shows no more.
"""

import functools
import io
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import torch
from PIL import Image, JpegImagePlugin, PngImagePlugin
from torch import Tensor

from lightprobe.core.errors import InputError
from lightprobe.imaging import resize_area, srgb_decode, srgb_encode
from lightprobe.imaging.opening import decode_errors
from lightprobe.insertion.glb_file import GlbFile, number, numbers

_BRIGHTEST = 1e4  # of emission, in whites of the photo
_LARGEST = 8192  # texels along an edge that are decoded
_LARGEST_TOTAL = 2**28  # texels of all pictures of a file
_FAINT = 1e-3  # weight of a transparent texel, so that it keeps its colour among others of its kind
_KEPT = 2048  # texels along an edge that are kept
_CLAMP, _MIRROR = 33071, 33648  # glTF's wrap modes; all else repeats
_READERS = (
    (b"\x89PNG\r\n\x1a\n", PngImagePlugin.PngImageFile),
    (b"\xff\xd8\xff", JpegImagePlugin.jpeg_factory),
)


@dataclass(frozen=True)
class Texture:
    """One texture of a material."""

    levels: tuple[Tensor, ...]  # (h, w, 4) uint8 each, from the finest; halved from one to the next
    srgb: bool  # whether red, green and blue carry the sRGB curve
    wrap: tuple[int, int]  # along u and v, as glTF numbers them
    uv_set: int
    transform: np.ndarray  # (2, 3) of KHR_texture_transform

    def to(self, device: torch.device) -> "Texture":
        """Return the texture on another device."""
        return replace(self, levels=tuple(level.to(device) for level in self.levels))

    def sample(self, uvs: Tensor, footprint: Tensor) -> Tensor:
        """Return values (N, 4), colours linear, at texture coordinates (N, 4), two of each set; bilinear.

        footprint (N,): the area in units of uv that a sample stands for; it chooses the level.
        """
        linear = uvs.new_tensor(self.transform)
        uv = uvs[:, 2 * self.uv_set : 2 * self.uv_set + 2] @ linear[:, :2].T + linear[:, 2]
        texels = footprint * abs(float(np.linalg.det(self.transform[:, :2]))) * self.levels[0][..., 0].numel()
        wanted = (0.5 * torch.log2(texels.clamp(min=1e-12))).round().long().clamp(0, len(self.levels) - 1)
        found = uvs.new_zeros(len(uvs), 4)
        for k, level in enumerate(self.levels):
            rows = (wanted == k).nonzero()[:, 0]
            if len(rows):
                found[rows] = self._bilinear(level, uv[rows])
        return found

    def _bilinear(self, level: Tensor, uv: Tensor) -> Tensor:
        height, width = level.shape[:2]
        place = uv * uv.new_tensor([width, height]) - 0.5
        low = place.floor()
        (fx, fy), (x, y) = (place - low).unbind(1), low.long().unbind(1)
        flat, table = level.reshape(-1, 4), _table(self.srgb, level.device)
        total = uv.new_zeros(len(uv), 4)
        for dx, wx in ((0, 1 - fx), (1, fx)):
            for dy, wy in ((0, 1 - fy), (1, fy)):
                texel = _wrapped(y + dy, height, self.wrap[1]) * width + _wrapped(x + dx, width, self.wrap[0])
                code = flat[texel].long()
                total += (wx * wy)[:, None] * torch.cat([table[0][code[:, :3]], table[1][code[:, 3:]]], 1)
        return total


@functools.lru_cache(maxsize=8)
def _table(srgb: bool, device: torch.device) -> Tensor:
    """Return the values of the codes 0 to 255, of colours and of alpha, (2, 256)."""
    codes = torch.arange(256, dtype=torch.float32, device=device) / 255
    return torch.stack([srgb_decode(codes) if srgb else codes, codes])


def _wrapped(texel: Tensor, count: int, mode: int) -> Tensor:
    if mode == _CLAMP:
        return texel.clamp(0, count - 1)
    if mode == _MIRROR:
        folded = texel.remainder(2 * count)
        return torch.where(folded < count, folded, 2 * count - 1 - folded)
    return texel.remainder(count)


class TextureReader:
    """Decodes the pictures of a file, each once, and no more of them than fit."""

    def __init__(self, file: GlbFile):
        self._file = file
        self._decoded: dict[int, Image.Image] = {}
        self._left = _LARGEST_TOTAL

    def read(self, info: dict[str, Any], *, srgb: bool, cut: bool = False) -> Texture:
        """Return the texture that a material names; raises `InputError` for a picture that cannot be used."""
        entry = self._file.entry("textures", info["index"])
        if "source" not in entry:
            raise InputError(f"{self._file.path} has a texture that is neither PNG nor JPEG; convert it.")
        sampler = self._file.entry("samplers", entry["sampler"]) if "sampler" in entry else {}
        extension = info.get("extensions", {}).get("KHR_texture_transform", {})
        uv_set = extension.get("texCoord", info.get("texCoord", 0))
        if uv_set not in (0, 1):
            raise InputError(f"{self._file.path} uses more than two sets of texture coordinates; use one.")
        wrap = (int(sampler.get("wrapS", 10497)), int(sampler.get("wrapT", 10497)))
        levels = _levels(self._image(entry["source"]), srgb=srgb, cut=cut)
        return Texture(levels, srgb, wrap, int(uv_set), _transform(extension))

    def _image(self, source: int) -> Image.Image:
        if source not in self._decoded:
            data, path = self._file.picture(source), self._file.path
            reader = next((reader for magic, reader in _READERS if data.startswith(magic)), None)
            if reader is None:
                raise InputError(f"{path} has a texture that is neither PNG nor JPEG; convert it.")
            with decode_errors(path):
                image = reader(io.BytesIO(data))
                width, height = image.size
                self._left -= width * height
                if max(width, height) > _LARGEST or self._left < 0:
                    words = f"textures of {width} x {height} texels, more than are read"
                    raise InputError(f"{path} has {words}; shrink them.")
                scale = min(1.0, _KEPT / max(width, height))
                size = max(1, round(width * scale)), max(1, round(height * scale))
                # channel by channel: transparent texels keep their colour
                parts = [part.resize(size, Image.Resampling.BOX) for part in _eight_bits(image).split()]
                self._decoded[source] = Image.merge("RGBA", parts)
        return self._decoded[source]


def _eight_bits(image: Image.Image) -> Image.Image:
    """Return a picture as RGBA of 8 bits; grey of 16 bits, which Pillow would clip, keeps its range."""
    if image.mode.startswith("I"):
        grey = np.asarray(image).astype(np.float64) / 257 + 0.5
        image = Image.fromarray(grey.clip(0, 255).astype(np.uint8))
    return image.convert("RGBA")


def _levels(image: Image.Image, *, srgb: bool, cut: bool) -> tuple[Tensor, ...]:
    """Return a picture at its size and at halves of it, (h, w, 4) uint8 each, averaged in linear light.

    cut: whether alpha cuts the surface out: then colours are averaged with it as weight, else apart from it.
    """
    codes = np.array(image)
    levels, planes = [codes], codes.astype(np.float32) / 255
    if srgb:
        planes[..., :3] = srgb_decode(planes[..., :3])
    while max(planes.shape[:2]) > 1:
        height, width = (max(1, side // 2) for side in planes.shape[:2])
        weight = np.maximum(planes[..., 3:], _FAINT) if cut else np.ones_like(planes[..., 3:])
        small = resize_area(np.dstack([planes[..., :3] * weight, planes[..., 3:], weight]), height, width)
        planes = np.dstack([small[..., :3] / small[..., 4:], small[..., 3:4]])
        encoded = np.dstack([srgb_encode(planes[..., :3]), planes[..., 3:]]) if srgb else planes
        levels.append((encoded * 255 + 0.5).clip(0, 255).astype(np.uint8))
    return tuple(torch.from_numpy(level) for level in levels)


def _transform(extension: dict[str, Any]) -> np.ndarray:
    """Return the (2, 3) matrix of KHR_texture_transform: translation times rotation times scale."""
    offset, scale = (numbers(extension.get(k, d), 2) for k, d in (("offset", [0, 0]), ("scale", [1, 1])))
    angle = number(extension.get("rotation", 0))
    rotation = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    return np.concatenate([rotation * scale, offset[:, None]], 1)


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
        glow = numbers(entry.get("emissiveFactor", [0, 0, 0]), 3)
        glow = glow * number(strength.get("emissiveStrength", 1))

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
        moved: dict[str, Any] = {k: v.to(device) for k, v in vars(self).items() if isinstance(v, Texture)}
        return replace(self, **moved)

    def sample(self, uvs: Tensor, colors: Tensor, footprint: Tensor) -> Sampled:
        """Return the material at texture coordinates (N, 4) and vertex colours (N, 4).

        footprint (N,): as in `Texture.sample`.
        """
        one = torch.ones_like(colors)
        textures = self.base, self.orm, self.emissive
        base, orm, glow = (one if each is None else each.sample(uvs, footprint) for each in textures)
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
