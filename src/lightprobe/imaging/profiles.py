"""Colour encodings that a file declares: ICC profiles, PNG's gamma and chromaticities, code points of H.273.

They are converted to sRGB's primaries, relative colorimetric. A profile is judged by what it does, not by its
name: one that leads a few colours to where sRGB leads them is sRGB, whoever wrote it, and is not converted.
"""

import functools
import io
import struct

import numpy as np
from PIL import Image, ImageCms

from lightprobe.imaging.encodings import SRGB, Encoding, coded, linear, power, primaries_matrix
from lightprobe.imaging.header import Samples
from lightprobe.imaging.icc import matrix_encoding
from lightprobe.imaging.resize import STRIP

_USUAL_GAMMA, _GAMMA_STEP = 1 / 2.2, 0.005  # what PNG asks sRGB files to write
_LARGEST_ERROR = (
    6  # of 255, in a sample: profiles store rounded curves, and a plain 2.2 is off by more in the darks
)
UNREADABLE = "ICC profile that cannot be read"
_PROFILE_ERRORS = (
    ImageCms.PyCMSError,
    OSError,
    ValueError,
    TypeError,
    KeyError,
    struct.error,
    np.linalg.LinAlgError,
)


@functools.lru_cache(maxsize=64)
def icc_encoding(data: bytes) -> Encoding:
    """Return the encoding of an ICC profile: `SRGB` when it does the same, `UNREADABLE` by name when it is
    damaged and sRGB is assumed."""
    try:
        profile = ImageCms.ImageCmsProfile(io.BytesIO(data))
        name = f"ICC profile {ImageCms.getProfileDescription(profile).strip() or 'without a name'}"
        space = profile.profile.xcolor_space.strip()
        if space not in ("RGB", "GRAY"):
            return Encoding(name, profile=data)
        patches = Image.fromarray(_patches(grey=space == "GRAY"))
        difference = np.asarray(to_srgb(patches, data), int) - np.asarray(patches.convert("RGB"), int)
        if np.abs(difference).max() <= _LARGEST_ERROR:
            return SRGB
        return matrix_encoding(data, name) or Encoding(name, profile=data)
    except _PROFILE_ERRORS:
        return Encoding(UNREADABLE)


def to_srgb(image: Image.Image, profile: bytes) -> Image.Image:
    """Return an image of 8 bits converted from an ICC profile to sRGB, relative colorimetric, as RGB."""
    source, target = ImageCms.ImageCmsProfile(io.BytesIO(profile)), ImageCms.createProfile("sRGB")
    shown = ImageCms.profileToProfile(
        image, source, target, ImageCms.Intent.RELATIVE_COLORIMETRIC, outputMode="RGB"
    )
    if shown is None:
        raise ValueError("no image")
    return shown


def png_encoding(info: dict, code_points: bytes | None) -> Encoding:
    """Return the encoding of a PNG without an ICC profile, or with code points.

    `info`: Pillow's, with `gamma`, `srgb` and `chromaticity`; `code_points`: the four bytes of its cICP
    chunk, which count before the others (PNG, third edition, 4.3).
    """
    if code_points is not None:
        return coded(code_points[0], code_points[1])
    gamma = info.get("gamma")
    if gamma is None or "srgb" in info or not gamma > 0:
        return SRGB
    matrix = _chromaticities(info.get("chromaticity"))
    if abs(gamma - _USUAL_GAMMA) <= _GAMMA_STEP and matrix is None:
        return SRGB
    name = f"PNG gamma {gamma:.4g}" + (" with primaries of its own" if matrix is not None else "")
    if abs(gamma - _USUAL_GAMMA) <= _GAMMA_STEP:
        return Encoding(name, matrix=matrix)
    return Encoding(name, (linear if abs(gamma - 1) <= _GAMMA_STEP else power(1 / gamma),), matrix)


def _chromaticities(values: tuple | None) -> np.ndarray | None:
    """Return M (3, 3) of PNG's white, red, green and blue x, y; None where they are sRGB's, absent or no
    colours.
    """
    if values is None or len(values) != 8 or not all(0 < value < 1 for value in values[1::2]):
        return None
    white, red, green, blue = zip(values[::2], values[1::2], strict=True)
    try:
        matrix = primaries_matrix(red, green, blue, white)
    except np.linalg.LinAlgError:
        return None
    return None if np.abs(matrix - np.eye(3)).max() < 0.02 else matrix


def _patches(*, grey: bool) -> np.ndarray:
    """Return colours that tell encodings apart, (1, N) or (1, N, 3) uint8: a ramp, and soft tints within any
    gamut.
    """
    ramp = np.arange(0, 256, 17, dtype=np.uint8)
    if grey:
        return ramp[None]
    tints = np.array([[r, g, b] for r in (90, 190) for g in (90, 190) for b in (90, 190)], np.uint8)
    return np.concatenate([np.repeat(ramp[:, None], 3, axis=1), tints])[None]


def samples_to_srgb(values: np.ndarray, levels: int, encoding: Encoding) -> Samples:
    """Return samples (H, W, 1 | 2 | 3 | 4) of a profile of look-up tables in sRGB, with 8 bits, as the module
    has.
    """
    colors = values.shape[2] - (values.shape[2] in (2, 4))
    if encoding.profile is None or {b"RGB ": 3, b"GRAY": 1}.get(encoding.profile[16:20]) != colors:
        return Samples(values, encoding, levels)
    height, width, channels = values.shape
    shown = np.empty((height, width, 3 + channels - colors), np.uint8)
    step = max(1, STRIP // width)
    for top in range(0, height, step):  # in strips: the wide integers take several times what comes out
        part = values[top : top + step].astype(np.uint32)
        eight = ((part * 255 + levels // 2) // levels).astype(np.uint8)
        picture = eight[..., 0] if colors == 1 else eight[..., :3]
        shown[top : top + step, :, :3] = to_srgb(
            Image.fromarray(np.ascontiguousarray(picture)), encoding.profile
        )
        shown[top : top + step, :, 3:] = eight[..., colors:]
    return Samples(shown, SRGB)
