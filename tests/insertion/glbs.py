"""GLB files for tests, written from the glTF 2.0 specification."""

import io
import json
import struct
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

_CORNERS = np.array([[x, y, z] for x in (-1, 1) for y in (0, 2) for z in (-1, 1)], np.float32)  # y up
_SIDES = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]  # outwards


def png(color: tuple[int, int, int], size: int = 4) -> bytes:
    buffer = io.BytesIO()
    Image.new("RGB", (size, size), color).save(buffer, format="PNG")
    return buffer.getvalue()


class Writer:
    """A document that grows, and the binary chunk with it."""

    def __init__(self) -> None:
        self.binary = bytearray()
        self.document: dict[str, Any] = {
            "asset": {"version": "2.0"},
            "scene": 0,
            "scenes": [{"nodes": [0]}],
            "nodes": [{"mesh": 0}],
            "bufferViews": [],
            "accessors": [],
            "meshes": [{"primitives": []}],
        }

    def view(self, data: bytes) -> int:
        self.binary += bytes(-len(self.binary) % 4)
        views = self.document["bufferViews"]
        views.append({"buffer": 0, "byteOffset": len(self.binary), "byteLength": len(data)})
        self.binary += data
        return len(views) - 1

    def array(self, values: np.ndarray, kind: str) -> int:
        values = np.ascontiguousarray(values)
        component = {"f": 5126, "u": 5125}[values.dtype.kind]
        accessors = self.document["accessors"]
        view = self.view(values.astype("<f4" if component == 5126 else "<u4").tobytes())
        accessors.append({"bufferView": view, "componentType": component, "count": len(values), "type": kind})
        return len(accessors) - 1

    def bytes(self) -> bytes:
        self.document["buffers"] = self.document.get("buffers", [{"byteLength": len(self.binary)}])
        text = json.dumps(self.document).encode()
        text += b" " * (-len(text) % 4)
        binary = bytes(self.binary) + bytes(-len(self.binary) % 4)
        heads = struct.pack("<I4s", len(text), b"JSON"), struct.pack("<I4s", len(binary), b"BIN\0")
        chunks = heads[0] + text + heads[1] + binary
        return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks


def box(color: tuple[float, float, float] = (0.8, 0.2, 0.1)) -> Writer:
    """A box 2 x 2 x 2 that stands on y = 0, without normals."""
    made = Writer()
    faces = np.array([(a, b, c) for a, b, c, d in _SIDES] + [(a, c, d) for a, b, c, d in _SIDES], np.uint32)
    primitive = {
        "attributes": {"POSITION": made.array(_CORNERS, "VEC3")},
        "indices": made.array(faces.reshape(-1), "SCALAR"),
        "material": 0,
    }
    made.document["meshes"][0]["primitives"].append(primitive)
    pbr = {"baseColorFactor": [*color, 1], "metallicFactor": 0, "roughnessFactor": 0.7}
    made.document["materials"] = [{"pbrMetallicRoughness": pbr}]
    return made


def write(path: Path, made: Writer) -> Path:
    path.write_bytes(made.bytes())
    return path
