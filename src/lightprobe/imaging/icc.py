"""ICC profiles of curves and a matrix (ICC.1:2022, annex F): what they say in numbers, to compute with in
floats.

Profiles with look-up tables instead are left to a colour management module.
"""

import struct

import numpy as np

from lightprobe.imaging.encodings import Curve, Encoding, from_d50, linear, power

_TABLE_START, _ENTRY = 128, 12  # bytes: the header, and an entry of the table of tags
_MOST_TAGS = 256  # real profiles have dozens
_PARAMETERS = (1, 3, 4, 5, 7)  # how many a parametric curve of each kind has (10.18)


def matrix_encoding(data: bytes, name: str) -> Encoding | None:
    """Return the encoding that an ICC profile for RGB or grey states by curves, or None when it has tables
    instead.

    Raises `ValueError`, `KeyError` or `struct.error` on a damaged profile.
    """
    tags = _tags(data)
    if b"A2B0" in tags or b"A2B1" in tags:
        return None
    if data[16:20] == b"GRAY":
        return Encoding(name, (_curve(tags[b"kTRC"]),))
    if data[16:20] != b"RGB " or data[20:24] != b"XYZ ":
        return None
    curves = tuple(_curve(tags[key]) for key in (b"rTRC", b"gTRC", b"bTRC"))
    matrix = from_d50(np.stack([_xyz(tags[key]) for key in (b"rXYZ", b"gXYZ", b"bXYZ")], axis=1))
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
