"""What a stranger's GLB says of itself, read before anything in it is: no other files, and not too many triangles."""

import json
import struct
from pathlib import Path
from typing import Any

from lightprobe.core.errors import InputError

MOST_FACES = 2_000_000
"""Triangles of a GLB that is taken."""
_MOST_JSON = 64 * 2**20  # bytes of the description in front
_TRIANGLES = 4  # glTF's number of the mode of separate triangles


def check_glb(path: Path, name: str) -> int:
    """Return the number of triangles of a GLB file; raise `InputError` calling it `name` when it cannot be used."""
    document = _document(path, name)
    for key in ("buffers", "images"):
        for part in _entries(document, key):
            uri = part.get("uri")
            if isinstance(uri, str) and not uri.startswith("data:"):
                raise InputError(f"{name} needs another file beside it; export it as one GLB with everything inside.")
    faces = _faces(document)
    if faces > MOST_FACES:
        raise InputError(
            f"{name} has {faces / 1e6:.1f} million triangles, more than {MOST_FACES // 1_000_000} million; reduce it."
        )
    if faces == 0:
        raise InputError(f"{name} holds no triangles; export the meshes with it.")
    return faces


def _document(path: Path, name: str) -> dict[str, Any]:
    no_glb = InputError(f"{name} is no GLB file (binary glTF 2.0); export it as .glb.")
    with open(path, "rb") as file:
        start = file.read(20)
        if len(start) < 20 or start[:4] != b"glTF" or start[16:20] != b"JSON":
            raise no_glb
        length = struct.unpack("<I", start[12:16])[0]
        if length > _MOST_JSON:
            raise InputError(f"{name} describes itself in {length / 1e6:.0f} MB, which is too much to be read.")
        try:
            document = json.loads(file.read(length))
        except (ValueError, RecursionError) as error:
            raise no_glb from error
    if not isinstance(document, dict):
        raise no_glb
    return document


def _faces(document: dict[str, Any]) -> int:
    """Return the triangles of all meshes."""
    counts = [_count(entry.get("count")) for entry in _entries(document, "accessors")]
    total = 0
    for mesh in _entries(document, "meshes"):
        for part in _entries(mesh, "primitives"):
            attributes = part.get("attributes")
            corner = part.get("indices", attributes.get("POSITION") if isinstance(attributes, dict) else None)
            if isinstance(corner, int) and 0 <= corner < len(counts) and part.get("mode", _TRIANGLES) >= _TRIANGLES:
                total += counts[corner] // 3
    return total


def _count(value: Any) -> int:
    return value if isinstance(value, int) and not isinstance(value, bool) and value > 0 else 0


def _entries(value: dict[str, Any], key: str) -> list[dict[str, Any]]:
    found = value.get(key)
    return [entry for entry in found if isinstance(entry, dict)] if isinstance(found, list) else []
