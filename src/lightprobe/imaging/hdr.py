"""OpenEXR files, and reading of any HDR file by its content; linear float32 in memory."""

import io
import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import OpenEXR

from lightprobe.core.config.export import ColorSpace
from lightprobe.core.errors import InputError
from lightprobe.core.files import write_bytes
from lightprobe.core.muted import muted
from lightprobe.imaging.color import straight
from lightprobe.imaging.encodings import LINEAR, matrix_to_srgb, primaries_matrix
from lightprobe.imaging.limits import MAX_PIXELS, check_pixels
from lightprobe.imaging.opening import Header, Samples, signature
from lightprobe.imaging.radiance import radiance_size, read_radiance

_EXR_MAGIC = b"\x76\x2f\x31\x01"
_BEAUTY = frozenset(
    {"beauty", "combined", "composite", "rgba", "rgb"}
)  # what renderers call the picture itself
_CHANNELS = {"r": "R", "red": "R", "g": "G", "green": "G", "b": "B", "blue": "B", "a": "A", "alpha": "A"}
_BYTES = 4.0  # of a sample at most
_MOST_BYTES = 4 * _BYTES * MAX_PIXELS  # that are decoded of a file: every channel of all its parts is
_AP1_XY = ((0.713, 0.293), (0.165, 0.830), (0.128, 0.044), (0.32168, 0.33767))  # ACEScg's (S-2014-004)
_DAMAGED = (RuntimeError, ValueError, LookupError, TypeError)
_KEPT = 16.0  # bytes of a pixel that are kept of a photo: four floats
_LARGEST_HALF = 65504.0  # largest finite 16-bit float


def read_hdr(path: Path) -> np.ndarray:
    """Read an OpenEXR or Radiance file, told apart by content.

    Returns (H, W, C) float32, linear: C = 3 for channels R, G, B or X, Y, Z (in that order), 4 with A (values
    as stored, by convention premultiplied), 1 for a single Y. Of an OpenEXR file with layers or parts the colours
    without a layer are read, else those of a layer or part called beauty, combined or the like, else the only
    ones. Colour of an OpenEXR file that names other
    primaries than sRGB's (`chromaticities`) is converted, and cut at 0. Raises `InputError` naming the file
    when it is missing, too large, damaged, or holds other channels.
    """
    path = Path(path)
    start = signature(path)
    if start.startswith(_EXR_MAGIC):
        return _read_exr(path)
    if start.startswith(b"#?"):
        return read_radiance(path)
    raise InputError(f"{path} is neither an OpenEXR nor a Radiance HDR image.")


def read_header(path: Path) -> Header:
    """Return what stands beside the pixels of an OpenEXR or Radiance file; raises `InputError` as `read_hdr`."""
    if not signature(path).startswith(_EXR_MAGIC):
        return Header(radiance_size(path), encoding=LINEAR, pixel_bytes=_KEPT + _BYTES)
    headers = _exr_headers(path)  # all channels of all parts are decoded, whichever are read
    size = _extent(headers[_layer(path, headers).part])
    return Header(size, encoding=LINEAR, pixel_bytes=_KEPT + _decoded_bytes(headers) / math.prod(size))


def decode(path: Path) -> Samples:
    """Return the samples of a photo, (H, W, 1 | 3 | 4) float32 with straight colour; raises as `read_hdr`."""
    return Samples(straight(read_hdr(path)), LINEAR)


def write_exr(
    path: Path, array: np.ndarray, *, half: bool = False, color_space: ColorSpace = ColorSpace.SRGB
) -> None:
    """Write `array` (H, W), (H, W, 1 | 3 | 4) as ZIP-compressed EXR (Y, RGB or RGBA), atomically.

    `half` stores 16-bit floats, with values clipped to their range instead of becoming infinite. color_space: into
    which (H, W, 3) is converted from linear sRGB, its white adapted (Bradford).
    """
    planes = np.asarray(array, np.float32)
    planes = planes[..., None] if planes.ndim == 2 else planes
    header: dict = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    if color_space is ColorSpace.ACESCG:
        planes = planes @ np.linalg.inv(primaries_matrix(*_AP1_XY)).T.astype(np.float32)
        header["chromaticities"] = tuple(np.ravel(_AP1_XY).tolist())
    names = {1: "Y", 3: "RGB", 4: "RGBA"}[planes.shape[2]]
    if half:
        planes = np.clip(planes, -_LARGEST_HALF, _LARGEST_HALF).astype(np.float16)
    channels = {name: np.ascontiguousarray(planes[..., k]) for k, name in enumerate(names)}
    # Encoding to memory leaves the writing, and its errors, to the one place that handles them.
    buffer = io.BytesIO()
    OpenEXR.File(header, channels).write(buffer)
    write_bytes(Path(path), buffer.getvalue())


@dataclass(frozen=True)
class _Layer:
    """Channels of an OpenEXR file that make a picture."""

    part: int
    label: str  # names of part and layer, for a sentence
    channels: tuple[str, ...]  # as the file calls them: red, green, blue and alpha, or X, Y and Z, or Y
    is_color: bool = True


def _read_exr(path: Path) -> np.ndarray:
    """Read a layer of an OpenEXR file; headers are checked first, because decoding trusts any size."""
    try:
        headers = _exr_headers(path)
        layer = _layer(path, headers)
        with muted():
            channels = OpenEXR.File(str(path), separate_channels=True).channels(layer.part)
        values = np.empty((*channels[layer.channels[0]].pixels.shape, len(layer.channels)), np.float32)
        for place, name in enumerate(layer.channels):  # each goes once it is copied
            values[..., place] = channels.pop(name).pixels
    except _DAMAGED as error:
        raise InputError(
            f"{path} cannot be decoded as OpenEXR; the file is damaged or cut short: copy it again."
        ) from error
    matrix = matrix_to_srgb(headers[layer.part].get("chromaticities", ())) if layer.is_color else None
    if matrix is not None:
        values[..., :3] = np.maximum(values[..., :3] @ matrix.T.astype(np.float32), 0)
    return values


def _exr_headers(path: Path) -> list[dict]:
    """Return the headers of an OpenEXR file's parts, checked."""
    try:
        with muted():
            headers = [part.header for part in OpenEXR.File(str(path), header_only=True).parts]
        _check_header(path, headers[_layer(path, headers).part])
        needed = _decoded_bytes(headers)
    except _DAMAGED as error:
        raise InputError(
            f"{path} cannot be decoded as OpenEXR; the file is damaged or cut short: copy it again."
        ) from error
    if needed > _MOST_BYTES:
        raise InputError(
            f"{path} holds {sum(len(header['channels']) for header in headers)} channels, {needed / 1e9:.1f} GB once "
            "decoded; save one layer with R, G, B (and A) alone."
        )
    return headers


def _layer(path: Path, headers: list[dict]) -> _Layer:
    """Return the layer to read: the plain colours, else the beauty, else the only ones; refuse any other choice."""
    colors = [layer for part, header in enumerate(headers) for layer in _color_layers(part, header)]
    plain = [layer for layer in colors if layer.part == 0 and "." not in layer.channels[0]]
    beauty = [layer for layer in colors if not _BEAUTY.isdisjoint(layer.label.lower().split("."))]
    for found in (plain, beauty, colors):
        if len(found) == 1:
            return found[0]
    if colors:
        named = ", ".join(layer.label for layer in colors)[:200]
        raise InputError(
            f"{path} holds the layers {named}, of which not exactly one is called beauty, combined or rgba; save the one "
            "that is meant alone, with R, G, B (and A)."
        )
    full = _full_channels(headers[0])
    if full.issuperset("XYZ"):
        return _Layer(0, "", ("X", "Y", "Z"), is_color=False)
    if full == {"Y"} and len(headers[0]["channels"]) == 1:
        return _Layer(0, "", ("Y",), is_color=False)
    names = sorted({channel.name for header in headers for channel in header["channels"]})
    raise InputError(
        f"{path} has the channels {', '.join(names)[:200]}; save one layer with R, G, B (and A) or X, Y, Z."
    )


def _color_layers(part: int, header: dict) -> Iterator[_Layer]:
    """Yield the layers of a part with R, G and B, in letters of either case, with A where they have it."""
    layers: dict[str, dict[str, str]] = {}
    for name in sorted(_full_channels(header)):
        layer, _, channel = name.rpartition(".")
        layers.setdefault(layer, {}).setdefault(_CHANNELS.get(channel.lower(), ""), name)
    for layer, names in layers.items():
        if {"R", "G", "B"} <= names.keys():
            label = ".".join(filter(None, (str(header.get("name", "")), layer)))
            yield _Layer(part, label or "without a name", tuple(names[key] for key in "RGBA" if key in names))


def _full_channels(header: dict) -> set[str]:
    """Return the names of a part's channels that have a sample for every pixel."""
    return {channel.name for channel in header["channels"] if channel.xSampling == channel.ySampling == 1}


def _decoded_bytes(headers: list[dict]) -> float:
    """Return what all channels of all parts take, at most."""
    return sum(math.prod(_extent(header)) * len(header["channels"]) * _BYTES for header in headers)


def _extent(header: dict) -> tuple[int, int]:
    """Return the (width, height) of a part's pixels."""
    low, high = (np.asarray(corner, np.int64) for corner in header["dataWindow"])
    width, height = (int(extent) for extent in high - low + 1)
    return width, height


def _check_header(path: Path, header: dict) -> None:
    """Raise `InputError` on a size, a crop or a kind of part that is not read."""
    check_pixels(path, *_extent(header))
    windows = zip(header["dataWindow"], header["displayWindow"], strict=True)
    if any((np.asarray(a) != np.asarray(b)).any() for a, b in windows):
        raise InputError(f"{path} is a cropped EXR (data and display window differ); save the whole image.")
    if header.get("type") not in (None, OpenEXR.scanlineimage, OpenEXR.tiledimage):
        raise InputError(f"{path} is a deep EXR; save a flat image.")
