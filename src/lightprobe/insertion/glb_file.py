"""The container of a stranger's GLB file: its JSON document, and arrays and pictures of its one binary chunk.

glTF 2.0, sections 3.6 and 4.4. Nothing outside of the file is read, and announced sizes are checked against
the file's before memory is taken for them.
"""

import contextlib
import json
import struct
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from lightprobe.core.errors import InputError, shown
from lightprobe.core.reading import check_file
from lightprobe.core.stored import is_finite_number

LARGEST_FILE = 2**29  # bytes
_LARGEST_JSON = 2**26  # bytes
_HEADER, _CHUNK = struct.Struct("<4sII"), struct.Struct("<I4s")
_COMPONENTS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4}
_TYPES = {5120: "<i1", 5121: "<u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
_DAMAGE = (LookupError, TypeError, ValueError, AttributeError, OverflowError, RecursionError, struct.error)


@contextlib.contextmanager
def sound(path: Path) -> Iterator[None]:
    """Turn what a reader meets in a malformed document into an `InputError` naming `path`."""
    try:
        yield
    except _DAMAGE as error:
        detail = shown(str(error)).rstrip(".") or type(error).__name__
        kind = type(error).__name__
        raise InputError(
            f"{path} is no sound GLB file ({kind}: {detail}); export it again from a 3D program."
        ) from error


@dataclass(frozen=True)
class GlbFile:
    """A GLB file in memory."""

    path: Path
    document: dict[str, Any]
    binary: bytes

    @staticmethod
    def read(path: Path) -> "GlbFile":
        """Read a file; raise `InputError` when it is missing, too large, no GLB, or refers to other files."""
        check_file(path, LARGEST_FILE)
        try:
            data = path.read_bytes()
        except OSError as error:
            raise InputError(f"{path} cannot be read: {error.strerror or error}.") from error
        with sound(path):
            found = GlbFile(path, *_chunks(path, data))
            buffers, images = found.entries("buffers"), found.entries("images")
            if len(buffers) > 1 or any("uri" in entry for entry in (*buffers, *images)):
                raise InputError(
                    f"{path} refers to other files, which are not read; export it as one GLB with its textures inside."
                )
        return found

    def entries(self, key: str) -> list[Any]:
        """Return a list of the document's top level, empty where there is none."""
        value = self.document.get(key, [])
        if not isinstance(value, list):
            raise ValueError(f"'{key}' is no list")
        return value

    def entry(self, key: str, index: object) -> dict[str, Any]:
        """Return an entry of a list; raise `ValueError` for a wrong index, or an entry that is no object."""
        values = self.entries(key)  # checked one by one: all of them at each look-up would take minutes
        if isinstance(index, bool) or not isinstance(index, int) or not 0 <= index < len(values):
            raise ValueError(f"{key}[{shown(index)}] does not exist")
        if not isinstance(values[index], dict):
            raise ValueError(f"{key}[{index}] is no object")
        return values[index]

    def count(self, accessor: object) -> int:
        """Return how many elements an accessor announces."""
        return _whole(self.entry("accessors", accessor)["count"])

    def array(self, accessor: object, kinds: tuple[str, ...]) -> np.ndarray:
        """Return an accessor's elements (N, C): float32, or the integers of a scalar one (N, 1).

        kinds: types that are allowed. Raises `ValueError` for elements beyond the file, `InputError` for NaN.
        """
        entry = self.entry("accessors", accessor)
        if entry["type"] not in kinds or "sparse" in entry:
            raise ValueError(f"an accessor is {'sparse' if 'sparse' in entry else shown(entry['type'])}")
        count, width = self.count(accessor), _COMPONENTS[entry["type"]]
        dtype = np.dtype(_TYPES[entry["componentType"]])
        view = self._view(entry["bufferView"])
        element = width * dtype.itemsize
        stride = _whole(self.entry("bufferViews", entry["bufferView"]).get("byteStride", element))
        start = _whole(entry.get("byteOffset", 0))
        used = start + (stride * (count - 1) + element if count else 0)
        if stride < element or used > len(view):
            raise ValueError("an accessor reaches beyond its buffer view")
        found = np.ndarray((count, width), dtype, view, start, (stride, dtype.itemsize))
        if kinds == ("SCALAR",):
            if dtype.kind != "u":
                raise ValueError("indices are no unsigned integers")
            return found.copy()
        values = found.astype(np.float32)
        if dtype.kind != "f" and entry.get("normalized", False):
            values = np.maximum(values / np.iinfo(dtype).max, -1)
        if not np.isfinite(values).all():
            raise InputError(f"{self.path} holds NaN or infinity; export it again from a 3D program.")
        return values

    def picture(self, image: object) -> bytes:
        """Return the bytes of an embedded picture."""
        return bytes(self._view(self.entry("images", image)["bufferView"]))

    def _view(self, index: object) -> memoryview:
        entry = self.entry("bufferViews", index)
        start, length = _whole(entry.get("byteOffset", 0)), _whole(entry["byteLength"])
        if entry["buffer"] != 0 or start + length > len(self.binary):
            raise ValueError("a buffer view reaches beyond the file's binary chunk")
        return memoryview(self.binary)[start : start + length]


def _chunks(path: Path, data: bytes) -> tuple[dict[str, Any], bytes]:
    if data[:4] != b"glTF":
        raise InputError(f"{path} is not a GLB file (binary glTF 2.0); export the object as .glb.")
    _, version, length = _HEADER.unpack_from(data)
    if version != 2 or length > len(data):
        raise ValueError(f"version {version}, {length} bytes of which {len(data)} are there")
    size, kind = _CHUNK.unpack_from(data, 12)
    if kind != b"JSON" or size > min(_LARGEST_JSON, length - 20):
        raise ValueError("its first chunk is no JSON of a sane size")
    document = json.loads(data[20 : 20 + size].decode())
    if not isinstance(document, dict):
        raise ValueError("its document is no object")
    place = 20 + size
    if place + 8 > length:
        return document, b""
    size, kind = _CHUNK.unpack_from(data, place)
    if kind != b"BIN\0" or place + 8 + size > length:
        raise ValueError("its second chunk is no binary one within the file")
    return document, data[place + 8 : place + 8 + size]


def _whole(value: object) -> int:
    """Return a number of bytes or elements; raise `ValueError` when it is none."""
    if isinstance(value, bool) or not isinstance(value, int) or not 0 <= value <= LARGEST_FILE:
        raise ValueError(f"{shown(value)} is no number of bytes or elements")
    return value


def numbers(value: object, count: int) -> np.ndarray:
    """Return a JSON list of `count` finite numbers (count,) float64; raise `ValueError` when it is none."""
    if not isinstance(value, list) or len(value) != count or not all(is_finite_number(one) for one in value):
        raise ValueError(f"{shown(value)} is no list of {count} finite numbers")
    return np.asarray(value, np.float64)


def number(value: object) -> float:
    """Return a finite JSON number; raise `ValueError` when it is none."""
    if not is_finite_number(value):
        raise ValueError(f"{shown(value)} is no finite number")
    return float(value)  # type: ignore[arg-type]
