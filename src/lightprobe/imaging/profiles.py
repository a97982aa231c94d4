"""Colour encodings that a file declares: ICC profiles, PNG's gamma and chromaticities, code points of H.273.

They are converted to sRGB's primaries, relative colorimetric. A profile is judged by what it does, not by its
name: one that leads a few colours to where sRGB leads them is sRGB, whoever wrote it, and is not converted.
What a profile of curves and a matrix says (ICC.1:2022, annex F) is computed in floats; profiles of look-up
tables are applied by the colour management module, to 8 bits.
"""

import functools
import io
import struct

import numpy as np
from PIL import Image, ImageCms

from lightprobe.imaging import encodings
from lightprobe.imaging.encodings import SRGB, Curve, Encoding, coded, linear, power
from lightprobe.imaging.opening import Samples
from lightprobe.imaging.resize import STRIP

_USUAL_GAMMA, _GAMMA_STEP = 1 / 2.2, 0.005  # what PNG asks sRGB files to write
_LARGEST_ERROR = 6  # of 255, in a sample: profiles round curves, and a plain 2.2 is off by more in the darks
UNREADABLE = "ICC profile that cannot be read"
_PROFILE_ERRORS = (ImageCms.PyCMSError, OSError, ValueError, TypeError, KeyError, struct.error)
_TABLE_START, _ENTRY = 128, 12  # bytes: the header, and an entry of the table of tags
_MOST_TAGS = 256  # real profiles have dozens
_PARAMETERS = (1, 3, 4, 5, 7)  # how many a parametric curve of each kind has (10.18)


@functools.lru_cache(maxsize=64)
def icc_encoding(data: bytes) -> Encoding:
    """Return the encoding of an ICC profile: `SRGB` when it does the same, named `UNREADABLE` when damaged."""
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
        return _matrix_encoding(data, name) or Encoding(name, profile=data)
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
    """Return M (3, 3) of PNG's white, red, green and blue x, y; None where they are sRGB's or no colours."""
    if values is None or len(values) != 8 or not all(0 < value < 1 for value in values[1::2]):
        return None
    white, red, green, blue = zip(values[::2], values[1::2], strict=True)
    try:
        matrix = encodings.primaries_matrix(red, green, blue, white)
    except np.linalg.LinAlgError:
        return None
    return None if np.abs(matrix - np.eye(3)).max() < 0.02 else matrix


def _patches(*, grey: bool) -> np.ndarray:
    """Return colours that tell encodings apart, (1, N) or (1, N, 3) uint8: a ramp, soft tints in any gamut."""
    ramp = np.arange(0, 256, 17, dtype=np.uint8)
    if grey:
        return ramp[None]
    tints = np.array([[r, g, b] for r in (90, 190) for g in (90, 190) for b in (90, 190)], np.uint8)
    return np.concatenate([np.repeat(ramp[:, None], 3, axis=1), tints])[None]


def samples_to_srgb(values: np.ndarray, levels: int, encoding: Encoding) -> Samples:
    """Return samples (H, W, 1 | 2 | 3 | 4), in sRGB with 8 bits where the profile has look-up tables."""
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


def _matrix_encoding(data: bytes, name: str) -> Encoding | None:
    """Return the encoding that a profile for RGB or grey states by curves, or None when it has tables instead.

    Raises `ValueError` (`LinAlgError` is one), `KeyError` or `struct.error` on a damaged profile.
    """
    tags = _tags(data)
    if b"A2B0" in tags or b"A2B1" in tags:
        return None
    if data[16:20] == b"GRAY":
        return Encoding(name, (_curve(tags[b"kTRC"]),))
    if data[16:20] != b"RGB " or data[20:24] != b"XYZ ":
        return None
    curves = tuple(_curve(tags[key]) for key in (b"rTRC", b"gTRC", b"bTRC"))
    matrix = encodings.from_d50(np.stack([_xyz(tags[key]) for key in (b"rXYZ", b"gXYZ", b"bXYZ")], axis=1))
    if not np.isfinite(matrix).all():
        raise ValueError("primaries that are no colours")
    return Encoding(name, curves, matrix)


def _tags(data: bytes) -> dict[bytes, bytes]:
    (count,) = struct.unpack_from(">I", data, _TABLE_START)
    if count > _MOST_TAGS:
        raise ValueError(f"{count} tags")
    found = {}
    for index in range(count):
        key, start, size = struct.unpack_from(">4sII", data, _TABLE_START + 4 + _ENTRY * index)
        found[key] = data[start : start + size]
    return found


def _xyz(tag: bytes) -> np.ndarray:
    return np.array(struct.unpack_from(">3i", tag, 8)) / 65536


def _curve(tag: bytes) -> Curve:
    """Return the curve of a `curv` or `para` tag."""
    if tag[:4] == b"para":
        return _parametric(tag)
    if tag[:4] != b"curv":
        raise ValueError(f"curve of type {tag[:4]!r}")
    (count,) = struct.unpack_from(">I", tag, 8)
    if count == 0:
        return linear
    if count == 1:
        return power(struct.unpack_from(">H", tag, 12)[0] / 256)
    if count > len(tag) // 2:
        raise ValueError("curve that is cut short")
    values = np.frombuffer(tag, ">u2", count, 12) / 65535
    places = np.linspace(0, 1, count)
    return lambda encoded: np.interp(encoded, places, values)


def _parametric(tag: bytes) -> Curve:
    """Return L = (a E + b)^g + e for E >= d, else c E + f; the simpler kinds leave out parameters (table 68)."""
    (kind,) = struct.unpack_from(">H", tag, 8)
    if kind >= len(_PARAMETERS):
        raise ValueError(f"parametric curve of kind {kind}")
    g, *rest = (value / 65536 for value in struct.unpack_from(f">{_PARAMETERS[kind]}i", tag, 12))
    a, b, c, d, e, f = 1.0, 0.0, 0.0, 0.0, 0.0, 0.0
    if kind in (1, 2):
        a, b, *offset = rest
        if not a:
            raise ValueError("parametric curve that is flat")
        e = f = offset[0] if offset else 0.0
        d = -b / a
    elif kind >= 3:
        a, b, c, d, e, f = (*rest, 0.0, 0.0)[:6]

    def curve(encoded: np.ndarray) -> np.ndarray:
        return np.where(encoded >= d, np.maximum(a * encoded + b, 0.0) ** g + e, c * encoded + f)

    return curve
