"""An environment map as one JPEG for web pages: a picture of it, and a gain map that makes it HDR (Ultra HDR).

Notation: x radiance, s the picture's linear value in [0, 1], g the gain map's value in [0, 1], for each channel:

    x = s 2^(low + g (high - low)),   s = 1 - exp(-f x),   f = min(1, 4 / greatest x)

by ISO 21496-1 and Adobe's Gain Map 1.0 (`hdrgm`), without offsets and with gamma 1. g is found from the picture as it
comes out of JPEG, and so makes good what eight bits and JPEG have changed in it. What JPEG changes in g itself stays:
a step or two of 255; so g has to cover few stops, which is why a bright map's picture is darker (f) and why there is a
greatest radiance. Nineteen of twenty texels come back within 2 %, the others within 6 %.

The two pictures are sRGB JPEGs, one after the other; the first tells where the second begins (MPF, CIPA DC-007). The
gain map is described twice, in XMP and in ISO's binary form: readers know one of them.
"""

import io
import struct
import warnings
from pathlib import Path

import numpy as np
from PIL import Image

from lightprobe.core.errors import LightprobeWarning
from lightprobe.core.files import write_bytes
from lightprobe.imaging import srgb_decode, srgb_encode
from lightprobe.imaging.gain_map import ISO_NAME
from lightprobe.light.display import tone_mapped

DARKEST, BRIGHTEST = 0.01, 8.0  # radiance that the file holds: for lamps, eight bits are too coarse
_PEAK, _WIDEST = 4.0, 2.5  # f times the greatest radiance; stops between the least and the greatest gain
_MILLION = 1_000_000  # denominator of ISO's fractions
_APP1, _APP2 = 0xE1, 0xE2
_XMP = b"http://ns.adobe.com/xap/1.0/\0"
_HDRGM, _CONTAINER = "http://ns.adobe.com/hdr-gain-map/1.0/", "http://ns.google.com/photos/1.0/container/"
_ITEM = (
    '<rdf:li rdf:parseType="Resource"><Container:Item Item:Semantic="{}" Item:Mime="image/jpeg"{}/></rdf:li>'
)


def write_ultra_hdr(path: Path, image: np.ndarray) -> None:
    """Write a map (H, 2H, 3) of linear radiance >= 0 as an Ultra HDR JPEG, atomically.

    Radiance is held from `DARKEST` to `BRIGHTEST`; less is nearly black, and more is cut, which a warning tells.
    Raises `ResourceError` when the disk refuses.
    """
    cut = np.maximum(image - BRIGHTEST, 0).sum(dtype=np.float64)
    if cut > 0:
        share = 100 * cut / image.sum(dtype=np.float64)
        warnings.warn(
            f"{path.name} holds radiance up to {BRIGHTEST:g} and the map has up to {image.max():.3g}: {share:.3g} % of "
            f"its light are cut off there; {path.stem}.exr has all of it.",
            LightprobeWarning,
            stacklevel=3,
        )
    write_bytes(path, encode_ultra_hdr(image))


def encode_ultra_hdr(image: np.ndarray) -> bytes:
    """Return the bytes of a map (H, 2H, 3) of linear radiance >= 0, cut at `BRIGHTEST`."""
    radiance = np.minimum(image, BRIGHTEST).astype(np.float32)
    factor = min(1.0, _PEAK / max(float(radiance.max()), 1e-30))
    first = _jpeg(srgb_encode(tone_mapped(radiance, factor)))
    shown = srgb_decode(np.asarray(Image.open(io.BytesIO(first)), np.float32) / 255)
    gain = np.log2(np.maximum(radiance, 1e-9) / np.maximum(shown, 1e-9))
    matters = (radiance >= DARKEST) & (shown > 0)
    high = float(gain.max(where=matters, initial=0.1))
    low = max(float(gain.min(where=matters, initial=0.0)), high - _WIDEST)
    second = _jpeg(((gain - low) / (high - low)).clip(0, 1))
    told = {"GainMapMin": low, "GainMapMax": high, "Gamma": 1.0, "OffsetSDR": 0.0, "OffsetHDR": 0.0}
    told |= {"HDRCapacityMin": 0.0, "HDRCapacityMax": high, "BaseRenditionIsHDR": False}
    attributes = "".join(f' hdrgm:{name}="{value}"' for name, value in told.items())
    second = _with_segments(second, _xmp(attributes) + _segment(_APP2, ISO_NAME + _iso_metadata(low, high)))
    items = _ITEM.format("Primary", "") + _ITEM.format("GainMap", f' Item:Length="{len(second)}"')
    spaces = f' xmlns:Container="{_CONTAINER}" xmlns:Item="{_CONTAINER}item/"'
    container = _xmp(spaces, f"<Container:Directory><rdf:Seq>{items}</rdf:Seq></Container:Directory>")
    first = _with_segments(first, container + _segment(_APP2, ISO_NAME + bytes(4)))  # bytes: versions 0
    return _with_index(first, second)


def _jpeg(values: np.ndarray) -> bytes:
    """Return a JPEG of values (H, W, 3) in [0, 1], as exact as JPEG is."""
    buffer, codes = io.BytesIO(), np.rint(255 * values).astype(np.uint8)
    Image.fromarray(codes).save(buffer, "JPEG", quality=100, subsampling=0)
    return buffer.getvalue()


def _segment(marker: int, content: bytes) -> bytes:
    return struct.pack(">BBH", 0xFF, marker, 2 + len(content)) + content


def _xmp(attributes: str, content: str = "") -> bytes:
    """Return the XMP segment of a gain map's version 1.0, with attributes and an element more."""
    text = (
        '<x:xmpmeta xmlns:x="adobe:ns:meta/"><rdf:RDF xmlns:rdf="http://www.w3.org/1999/02/22-rdf-syntax-ns#">'
        f'<rdf:Description xmlns:hdrgm="{_HDRGM}" hdrgm:Version="1.0"{attributes}>{content}</rdf:Description>'
        "</rdf:RDF></x:xmpmeta>"
    )
    return _segment(_APP1, _XMP + text.encode())


def _iso_metadata(low: float, high: float) -> bytes:
    """Return the gain map's description by ISO 21496-1, annex C: one for all channels, in fractions."""
    fractions = 0.0, high, low, high, 1.0, 0.0, 0.0  # headrooms of both pictures; gain, gamma and offsets
    pairs = (struct.pack(">iI", round(value * _MILLION), _MILLION) for value in fractions)
    return struct.pack(">HHB", 0, 0, 0x40) + b"".join(
        pairs
    )  # versions 0; flag: in the first picture's primaries


def _with_segments(jpeg: bytes, segments: bytes) -> bytes:
    """Return a JPEG with segments after its first, JFIF's."""
    place = 4 + int.from_bytes(jpeg[4:6], "big")
    return jpeg[:place] + segments + jpeg[place:]


def _with_index(first: bytes, second: bytes) -> bytes:
    """Return two JPEGs as one file, with the MPF segment that tells where the second begins after JFIF's."""
    place = 4 + int.from_bytes(first[4:6], "big")
    header = b"MM\0*" + struct.pack(">IH", 8, 3)  # big endian; where the three tags are
    entries_at = len(header) + 3 * 12 + 4
    tags = struct.pack(">HHI4s", 0xB000, 7, 4, b"0100") + struct.pack(">HHII", 0xB001, 4, 1, 2)
    tags += struct.pack(">HHIII", 0xB002, 7, 32, entries_at, 0)
    size = entries_at + 32  # of the index, which offsets count from
    length = len(first) + 4 + len(b"MPF\0") + size
    behind = length - (place + 4 + len(b"MPF\0"))
    entries = struct.pack(">IIIHH", 0x030000, length, 0, 0, 0) + struct.pack(
        ">IIIHH", 0, len(second), behind, 0, 0
    )
    return _with_segments(first, _segment(_APP2, b"MPF\0" + header + tags + entries)) + second
