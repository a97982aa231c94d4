"""Gain maps: how much brighter than a picture its scene was, at each place, in a second picture in the file.

Notation: B linear light of the picture, 1 its white; g a sample of the map in [0, 1], bilinear between its
samples; L linear light of the scene, in the unit of B. By ISO 21496-1, with metadata min, max, gamma, k_B and
k_L of each channel, at full headroom (weight 1):

    L = (B + k_B) 2^(min + (max - min) g^(1 / gamma)) - k_L

Android's Ultra HDR 1.0 and Adobe's draft of the same write these numbers as XMP. Apple's older maps have a
headroom H, and l(g) undoes the curve of BT.709 ("Applying Apple HDR effect to your photos"):

    L = B (1 + (H - 1) l(g))
"""

import functools
import struct
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from lightprobe.core.errors import LightprobeWarning
from lightprobe.imaging.resize import bilinear_grid

ISO_NAME = b"urn:iso:std:iso:ts:21496:-1\0"  # of the APP2 segment of a JPEG that holds the metadata
_XMP_NAME = "{http://ns.adobe.com/hdr-gain-map/1.0/}"
_RDF_NAME = "{http://www.w3.org/1999/02/22-rdf-syntax-ns#}"
_XMP_DEFAULTS = {"GainMapMin": 0.0, "Gamma": 1.0, "OffsetSDR": 1 / 64, "OffsetHDR": 1 / 64}
_XMP_ORDER = ("GainMapMin", "GainMapMax", "Gamma", "OffsetSDR", "OffsetHDR")
_SEVERAL_CHANNELS, _BASE_COLORS, _ONE_DENOMINATOR = 0x80, 0x40, 0x08  # flags of ISO 21496-1
_GREATEST_STOPS, _GREATEST_OFFSET = 16.0, 1.0  # beyond, the file is damaged
_FULL = 254.5 / 255  # the map itself is clipped from here on


@dataclass(frozen=True)
class Gain:
    """What the metadata of a gain map say: L = (B + base_offset) factor(g) - offset."""

    factor: Callable[[np.ndarray], np.ndarray]  # (..., 1 | 3) g -> as many factors, or three
    base_offset: np.ndarray  # (1 | 3,)
    offset: np.ndarray  # (1 | 3,)
    base_colors: bool = True  # whether it is of the picture's primaries; else of the map's own


@dataclass(frozen=True)
class GainMap:
    """A gain map that lies over a picture."""

    samples: np.ndarray  # (h, w, 1 | 3) uint8, turned as its picture is
    gain: Gain
    matrix: np.ndarray | None = (
        None  # (3, 3) of its primaries to linear sRGB, where they are not the picture's
    )

    def encoded_rows(self, first: int, last: int, size: tuple[int, int]) -> np.ndarray:
        """Return g (last - first, W, 1 | 3) float32 at rows of a picture of `size` (height, width)."""
        height, width = self.samples.shape[:2]
        down = (np.arange(first, last) + 0.5) * (height / size[0]) - 0.5
        across = (np.arange(size[1]) + 0.5) * (width / size[1]) - 0.5
        return bilinear_grid(self.samples, down, across) / np.float32(255)

    def brighten(self, base: np.ndarray, first: int, size: tuple[int, int]) -> np.ndarray:
        """Return L (h, W, 3) of rows from `first` on: B (h, W, 3) float32 in the primaries of the map."""
        gain = self.gain
        factor = gain.factor(self.encoded_rows(first, first + len(base), size))
        return ((base + gain.base_offset) * factor - gain.offset).astype(np.float32)

    def full_rows(self, first: int, last: int, size: tuple[int, int]) -> np.ndarray:
        """Return where the map gives all that it can, (last - first, W, 1 | 3) bool."""
        return self.encoded_rows(first, last, size) >= _FULL


def iso_gain(data: bytes) -> Gain | None:
    """Return the gain of ISO 21496-1's metadata (annex C.2), None where the picture is the brighter one already.

    Raises `ValueError` or `struct.error` on numbers that no gain map has.
    """
    version, _, flags = struct.unpack_from(">HHB", data)
    if version != 0:
        raise ValueError(f"version {version} of its metadata is unknown")
    channels = 3 if flags & _SEVERAL_CHANNELS else 1
    kinds = "II" + "iiIii" * channels  # two headrooms; min, max, gamma and two offsets of each channel
    if flags & _ONE_DENOMINATOR:
        below, *above = struct.unpack_from(f">I{kinds}", data, 5)
        numbers = np.array(above, np.float64) / (below or np.nan)
    else:
        pairs = np.array(struct.unpack_from(">" + "".join(f"{kind}I" for kind in kinds), data, 5), np.float64)
        numbers = pairs[::2] / np.where(pairs[1::2] > 0, pairs[1::2], np.nan)
    headroom, alternate = numbers[:2]
    if headroom > alternate:
        return None
    return _checked([*numbers[2:].reshape(channels, 5).T], base_colors=bool(flags & _BASE_COLORS))


def xmp_gain(xmp: bytes) -> Gain | None:
    """Return the gain that XMP of a gain map states, None as `iso_gain`.

    Raises `ValueError` where there is none or its numbers make no sense.
    """
    found = _xmp_values(xmp)
    if found.get("BaseRenditionIsHDR", ["False"])[0].strip().lower() == "true":
        return None
    if "GainMapMax" not in found:
        raise ValueError("its XMP has no GainMapMax")
    rows = [[float(v) for v in found.get(key, [_XMP_DEFAULTS.get(key, 0.0)])] for key in _XMP_ORDER]
    if any(len(row) not in (1, 3) for row in rows):
        raise ValueError("its XMP has numbers for other than one or three channels")
    return _checked([np.array(row) for row in rows])


def apple_gain(headroom_note: float, gain_note: float) -> Gain:
    """Return the gain of Apple's map by entries 33 and 48 of the camera's note."""
    if headroom_note < 1:
        line = (-20.0, 1.8) if gain_note <= 0.01 else (-0.101, 1.601)
    else:
        line = (-70.0, 3.0) if gain_note <= 0.01 else (-0.303, 2.303)
    headroom = 2 ** max(line[0] * gain_note + line[1], 0.0)
    if not 1 <= headroom <= 2**_GREATEST_STOPS:
        raise ValueError("the camera's note has a headroom that no picture has")

    def factor(encoded: np.ndarray) -> np.ndarray:
        bright = (np.maximum(encoded, 0.081) + 0.099) / 1.099
        return 1 + (headroom - 1) * np.where(encoded < 0.081, encoded / 4.5, bright ** (1 / 0.45))

    return Gain(factor, np.zeros(1), np.zeros(1))


@functools.lru_cache(maxsize=4096)  # a photo is decoded many times, and this is said once
def say_unread(path: Path, reason: str) -> None:
    """Warn that a photo's gain map is left aside and why."""
    warnings.warn(
        f"{path} has a gain map that is not read ({reason}): only its picture is, in which what is white was at least "
        "that bright; save the photo as Ultra HDR JPEG, or use the camera raw file.",
        LightprobeWarning,
        stacklevel=3,
    )


def _checked(rows: Sequence[np.ndarray], *, base_colors: bool = True) -> Gain:
    """Return the gain of min, max, gamma and the offsets, (1 | 3,) each; raise `ValueError` on odd numbers."""
    least, greatest, gamma, base_offset, offset = rows
    stops, offsets = np.concatenate([least, greatest]), np.concatenate([base_offset, offset])
    fits = (np.abs(stops) <= _GREATEST_STOPS).all() and (np.abs(offsets) <= _GREATEST_OFFSET).all()
    if not (fits and (gamma > 0).all() and np.isfinite(gamma).all()):  # NaN fits nothing
        raise ValueError("its metadata have numbers that no gain map has")
    # Plain numbers where g stands as it is: a power of every pixel takes as long as all the rest
    least, span = least.astype(np.float32), (greatest - least).astype(np.float32)
    exponent = None if (gamma == 1).all() else (1 / gamma).astype(np.float32)

    def factor(encoded: np.ndarray) -> np.ndarray:
        share = encoded if exponent is None else encoded**exponent
        return np.exp2(least + span * share)

    return Gain(factor, base_offset.astype(np.float32), offset.astype(np.float32), base_colors)


def _xmp_values(xmp: bytes) -> dict[str, list[str]]:
    """Return the values of the namespace of gain maps, as attributes or as sequences."""
    if b"<!" in xmp:
        raise ValueError("its XMP declares entities")
    try:
        root = ElementTree.fromstring(xmp.strip(b"\0 \r\n\t"))
    except ElementTree.ParseError as error:
        raise ValueError(f"its XMP is damaged: {error}") from error
    found: dict[str, list[str]] = {}
    for element in root.iter():
        for key, value in element.attrib.items():
            if key.startswith(_XMP_NAME):
                found[key.removeprefix(_XMP_NAME)] = [value]
        if element.tag.startswith(_XMP_NAME):
            values = [item.text or "" for item in element.iter(f"{_RDF_NAME}li")] or [element.text or ""]
            found[element.tag.removeprefix(_XMP_NAME)] = values
    return found
