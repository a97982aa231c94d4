"""From encoded samples to linear sRGB: transfer curves and primaries, by the code points of ITU-T H.273.

Notation: E encoded value in [0, 1] -> L linear light, 1.0 the reference white; M (3, 3) takes linear values
of the file's primaries to those of sRGB, white to white. Sources: IEC 61966-2-1 (sRGB), SMPTE ST 2084 (PQ),
ITU-R BT.2100 (HLG), BT.2408 (reference white at 203 cd/m2, or E = .75 of HLG), RP 177 (M from
chromaticities).

Values outside sRGB's gamut are negative in M's result; they are cut at 0, as no surface here reflects less
than none.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from lightprobe.imaging.color import srgb_decode

Curve = Callable[[np.ndarray], np.ndarray]  # E, any shape, float64 -> L

_REFERENCE_WHITE = 203 / 10000  # of PQ's peak (BT.2408)
_HLG_WHITE = 0.75  # encoded reference white of HLG (BT.2408)
_D65 = (0.3127, 0.3290)  # x, y of sRGB's white
_D50_XYZ = np.array([0.9642, 1.0, 0.8249])  # white of ICC's connection space (ICC.1, 7.2.16)
_BRADFORD = np.array([[0.8951, 0.2664, -0.1614], [-0.7502, 1.7135, 0.0367], [0.0389, -0.0685, 1.0296]])
SRGB_XY = ((0.64, 0.33), (0.30, 0.60), (0.15, 0.06), _D65)  # x, y of red, green, blue and white
_SAME = 0.002  # chromaticities' largest difference, by which primaries count as those of sRGB
# Chromaticities of red, green, blue and white by H.273's number of colour primaries
_PRIMARIES = {
    5: ((0.64, 0.33), (0.29, 0.60), (0.15, 0.06), _D65),
    6: ((0.630, 0.340), (0.310, 0.595), (0.155, 0.070), _D65),
    9: ((0.708, 0.292), (0.170, 0.797), (0.131, 0.046), _D65),
    12: ((0.680, 0.320), (0.265, 0.690), (0.150, 0.060), _D65),
}
_PRIMARY_NAMES = {5: "BT.601 (625)", 6: "BT.601 (525)", 9: "BT.2020", 12: "Display P3"}


@dataclass(frozen=True)
class Encoding:
    """How a file's samples are encoded."""

    name: str | None = None  # None: sRGB, declared or not
    curves: tuple[Curve, ...] = (srgb_decode,)  # of all channels, or one for each
    matrix: np.ndarray | None = field(default=None, compare=False)  # (3, 3) float64 M; None: sRGB's primaries
    profile: bytes | None = None  # ICC profile of look-up tables, for a colour management module


def linear(encoded: np.ndarray) -> np.ndarray:
    """Return `encoded` (any shape) itself: L = E."""
    return encoded


SRGB, LINEAR = Encoding(), Encoding(curves=(linear,))


def power(exponent: float) -> Curve:
    """Return the curve L = E^exponent."""
    return lambda encoded: np.maximum(encoded, 0.0) ** exponent


def pq(encoded: np.ndarray) -> np.ndarray:
    """Return linear light of PQ values (any shape), 1.0 at 203 cd/m2 (ST 2084, equation 4.1)."""
    m1, m2, c1, c2, c3 = 2610 / 16384, 2523 / 32, 3424 / 4096, 2413 / 128, 2392 / 128
    root = np.maximum(encoded, 0.0) ** (1 / m2)
    return (np.maximum(root - c1, 0.0) / (c2 - c3 * root)) ** (1 / m1) / _REFERENCE_WHITE


def hlg(encoded: np.ndarray) -> np.ndarray:
    """Return scene light of HLG values (any shape), 1.0 at E = .75 (BT.2100, table 5, inverse OETF)."""

    def inverse(value: np.ndarray) -> np.ndarray:
        a, b, c = 0.17883277, 0.28466892, 0.55991073
        bright = (np.exp((np.maximum(value, 0.5) - c) / a) + b) / 12
        return np.where(value <= 0.5, value**2 / 3, bright)

    return inverse(np.asarray(encoded)) / inverse(np.asarray(_HLG_WHITE))


# Curves by H.273's number of transfer characteristics. All others count as sRGB (13): television's 1, 6, 14 and
# 15 are for pictures graded on a display, which undoes them by about that curve.
_TRANSFERS: dict[int, Curve] = {4: power(2.2), 5: power(2.8), 8: linear, 16: pq, 18: hlg}
_TRANSFER_NAMES = {4: "gamma 2.2", 5: "gamma 2.8", 8: "linear", 16: "PQ", 18: "HLG"}


def coded(primaries: int, transfer: int) -> Encoding:
    """Return the encoding of two code points of H.273; unknown ones and those of no camera count as sRGB's."""
    names = [_PRIMARY_NAMES.get(primaries), _TRANSFER_NAMES.get(transfer)]
    if not any(names):
        return SRGB
    matrix = primaries_matrix(*_PRIMARIES[primaries]) if names[0] else None
    return Encoding(" ".join(filter(None, names)), (_TRANSFERS.get(transfer, srgb_decode),), matrix)


def primaries_matrix(red: tuple, green: tuple, blue: tuple, white: tuple) -> np.ndarray:
    """Return M (3, 3) float64 of primaries given as chromaticities (x, y); another white is adapted to D65."""
    return from_d50(_to_d50(white) @ _to_xyz(red, green, blue, white))


def matrix_to_srgb(chromaticities: Any) -> np.ndarray | None:
    """Return `primaries_matrix` (3, 3) of eight numbers, x and y of red, green, blue and white.

    None where they are sRGB's, or no primaries at all.
    """
    named = np.ravel(chromaticities).astype(np.float64)
    if named.size != 8 or not np.isfinite(named).all() or np.abs(named - np.ravel(SRGB_XY)).max() < _SAME:
        return None
    try:
        with np.errstate(all="ignore"):
            matrix = primaries_matrix(*named.reshape(4, 2))
    except np.linalg.LinAlgError:
        return None
    return matrix if np.isfinite(matrix).all() else None


def from_d50(to_d50: np.ndarray) -> np.ndarray:
    """Return M (3, 3) for `to_d50` (3, 3), linear values to XYZ adapted to D50, as ICC profiles store."""
    return np.linalg.solve(_to_d50(_D65) @ _to_xyz(*SRGB_XY), to_d50)


def camera_matrix(from_xyz: np.ndarray) -> np.ndarray:
    """Return M (3, 3) of white-balanced camera values for `from_xyz` (3, 3), XYZ (D65) to camera values.

    As the camera's balance has made white (1, 1, 1) already, rows are scaled to keep it there.
    """
    from_srgb = np.asarray(from_xyz, np.float64) @ _to_xyz(*SRGB_XY)
    return np.linalg.inv(from_srgb / from_srgb.sum(axis=1, keepdims=True))


def _xyz(chromaticity: tuple) -> np.ndarray:
    x, y = chromaticity
    return np.array([x / y, 1.0, (1 - x - y) / y])


def _to_xyz(red: tuple, green: tuple, blue: tuple, white: tuple) -> np.ndarray:
    """Return (3, 3), linear values to XYZ with Y = 1 for white (RP 177)."""
    columns = np.stack([_xyz(primary) for primary in (red, green, blue)], axis=1)
    return columns * np.linalg.solve(columns, _xyz(white))


def _to_d50(white: tuple) -> np.ndarray:
    """Return Bradford's adaptation (3, 3) of XYZ under `white` to D50."""
    ratio = (_BRADFORD @ _D50_XYZ) / (_BRADFORD @ _xyz(white))
    return np.linalg.solve(_BRADFORD, ratio[:, None] * _BRADFORD)


# Adobe RGB (1998), as cameras declare it by EXIF alone
ADOBE_RGB = Encoding(
    "Adobe RGB", (power(563 / 256),), primaries_matrix((0.64, 0.33), (0.21, 0.71), (0.15, 0.06), _D65)
)
