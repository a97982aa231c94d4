"""Pictures on disk: sRGB PNG, half-float EXR, OBJ. Written and read here without the product's own code."""

from pathlib import Path

import numpy as np
import OpenEXR
from PIL import Image


def srgb_encode(linear: np.ndarray) -> np.ndarray:
    """Linear to sRGB (IEC 61966-2-1), clipped to [0, 1]."""
    x = np.clip(linear, 0.0, 1.0)
    return np.where(x <= 0.0031308, 12.92 * x, 1.055 * np.maximum(x, 1e-9) ** (1 / 2.4) - 0.055)


def srgb_decode(encoded: np.ndarray) -> np.ndarray:
    """SRGB in [0, 1] to linear."""
    return np.where(encoded <= 0.04045, encoded / 12.92, ((encoded + 0.055) / 1.055) ** 2.4)


def round_half(value: np.ndarray, largest: float, bits: int = 8) -> np.ndarray:
    """Return half floats of at most `largest` with `bits` instead of 10 mantissa bits, which compress better.

    The relative error is at most 0.2 % with 8 bits, 0.4 % with 7, 1.6 % with 5.
    """
    half = np.clip(value, -largest, largest).astype(np.float16)
    step = 1 << (10 - bits)
    pattern = half.view(np.uint16).astype(np.uint32)
    return ((pattern + step // 2) & (0x10000 - step)).astype(np.uint16).view(np.float16)


def write_png(path: Path, values: np.ndarray) -> None:
    """Write values in [0, 1], (H, W, 3 or 4), as they are, to 8 bits, compressed as far as it goes."""
    path.parent.mkdir(exist_ok=True)
    image = Image.fromarray((np.clip(values, 0, 1) * 255.0 + 0.5).astype(np.uint8))
    image.save(path, optimize=True)


def read_png(path: Path) -> np.ndarray:
    """Return the values in [0, 1] of an 8-bit PNG."""
    with Image.open(path) as image:
        return np.asarray(image, np.float64) / 255.0


def write_exr(path: Path, values: np.ndarray, channels: str) -> None:
    """Write half floats (H, W, C), one letter of `channels` each, with lossless ZIP compression."""
    path.parent.mkdir(exist_ok=True)
    planes = {name: np.ascontiguousarray(values[..., k]) for k, name in enumerate(channels)}
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    with OpenEXR.File(header, planes) as file:
        file.write(str(path))


def read_exr(path: Path, channels: str) -> np.ndarray:
    """Return the named channels of an EXR, (H, W, C) float64."""
    with OpenEXR.File(str(path), separate_channels=True) as file:
        found = file.channels()
        return np.stack([found[name].pixels.astype(np.float64) for name in channels], axis=-1)


def write_obj(path: Path, vertices: np.ndarray, faces: np.ndarray) -> None:
    """Write positions to 4 decimals and triangles."""
    lines = [f"v {x:.4f} {y:.4f} {z:.4f}" for x, y, z in vertices]
    lines += [f"f {a} {b} {c}" for a, b, c in faces + 1]
    path.write_text("\n".join(lines) + "\n")


def read_obj(path: Path) -> tuple[np.ndarray, np.ndarray]:
    """Return vertices (V, 3) float64 and triangles (F, 3) of a file that `write_obj` made."""
    rows = [line.split() for line in path.read_text().splitlines()]
    vertices = np.array([row[1:] for row in rows if row[0] == "v"], float)
    return vertices, np.array([row[1:] for row in rows if row[0] == "f"], int) - 1
