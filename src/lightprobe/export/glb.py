"""A binary glTF 2.0 file with one textured object, and directional lights (KHR_lights_punctual).

Layout: a 12-byte header, a JSON chunk padded with spaces and a binary chunk padded with zeros, each to four
bytes; every array and picture starts at a multiple of four (glTF 2.0, sections 3.6 and 4.4).
"""

import json
import struct
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from lightprobe.core.files import write_bytes
from lightprobe.export.gltf_mesh import GltfMesh
from lightprobe.export.lamps import DirectionalLight

_FLOAT, _UINT = 5126, 5125  # component types of glTF 2.0
_ARRAY_BUFFER, _ELEMENT_ARRAY_BUFFER = 34962, 34963  # targets of buffer views
_LIGHTS = "KHR_lights_punctual"
_SAMPLER = {"magFilter": 9729, "minFilter": 9987, "wrapS": 33071, "wrapT": 33071}  # trilinear, clamped


@dataclass(frozen=True)
class GltfPictures:
    """PNG files in memory; v = 0 is their top row."""

    base_color: bytes  # sRGB
    orm: bytes  # linear; R ambient occlusion, G roughness, B metallic
    normal: bytes  # linear; tangent space, green towards the top of the picture


@dataclass
class _Binary:
    """The binary chunk while it grows, with the views and accessors into it."""

    data: bytearray = field(default_factory=bytearray)
    views: list[dict[str, Any]] = field(default_factory=list)
    accessors: list[dict[str, Any]] = field(default_factory=list)

    def view(self, payload: bytes, target: int | None = None) -> int:
        """Append bytes at the next multiple of four and return the index of their buffer view."""
        self.data.extend(bytes(-len(self.data) % 4))
        entry = {"buffer": 0, "byteOffset": len(self.data), "byteLength": len(payload)}
        self.views.append(entry if target is None else {**entry, "target": target})
        self.data.extend(payload)
        return len(self.views) - 1

    def array(self, values: np.ndarray, kind: str, *, bounds: bool = False) -> int:
        """Append float vertex attributes (N, C) and return the index of their accessor."""
        little = np.ascontiguousarray(values, "<f4")
        entry: dict[str, Any] = {
            "bufferView": self.view(little.tobytes(), _ARRAY_BUFFER),
            "componentType": _FLOAT,
        }
        entry |= {"count": len(little), "type": kind}
        if bounds:
            entry |= {"min": little.min(0).tolist(), "max": little.max(0).tolist()}
        self.accessors.append(entry)
        return len(self.accessors) - 1

    def indices(self, faces: np.ndarray) -> int:
        """Append triangle corners (F, 3) and return the index of their accessor."""
        view = self.view(np.ascontiguousarray(faces, "<u4").tobytes(), _ELEMENT_ARRAY_BUFFER)
        self.accessors.append(
            {"bufferView": view, "componentType": _UINT, "count": faces.size, "type": "SCALAR"}
        )
        return len(self.accessors) - 1


def write_glb(
    path: Path,
    mesh: GltfMesh,
    pictures: GltfPictures,
    *,
    name: str = "object",
    lights: Sequence[DirectionalLight] = (),
) -> None:
    """Write the object as a GLB file, atomically; raise `ResourceError` when the disk refuses."""
    write_bytes(path, encode_glb(mesh, pictures, name=name, lights=lights))


def encode_glb(
    mesh: GltfMesh, pictures: GltfPictures, *, name: str = "object", lights: Sequence[DirectionalLight] = ()
) -> bytes:
    """Return the bytes of a GLB file with one mesh of one material, and a node for each light."""
    binary = _Binary()
    attributes = {
        "POSITION": binary.array(mesh.positions, "VEC3", bounds=True),
        "NORMAL": binary.array(mesh.normals, "VEC3"),
        "TANGENT": binary.array(mesh.tangents, "VEC4"),
        "TEXCOORD_0": binary.array(mesh.uvs, "VEC2"),
    }
    primitive = {"attributes": attributes, "indices": binary.indices(mesh.faces), "material": 0, "mode": 4}
    named = {"base_color": pictures.base_color, "orm": pictures.orm, "normal": pictures.normal}
    images = [
        {"bufferView": binary.view(png), "mimeType": "image/png", "name": key} for key, png in named.items()
    ]
    binary.data.extend(bytes(-len(binary.data) % 4))
    document = {
        "asset": {"version": "2.0", "generator": "lightprobe"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0, "name": name}],
        "meshes": [{"primitives": [primitive], "name": name}],
        "materials": [_material(name)],
        "textures": [{"source": i, "sampler": 0} for i in range(len(images))],
        "samplers": [_SAMPLER],
        "images": images,
        "accessors": binary.accessors,
        "bufferViews": binary.views,
        "buffers": [{"byteLength": len(binary.data)}],
    }
    return _container(_with_lights(document, lights), bytes(binary.data))


def _with_lights(document: dict[str, Any], lights: Sequence[DirectionalLight]) -> dict[str, Any]:
    """Return the document of one node with directional lights in nodes of their own."""
    if not lights:
        return document
    named = [(f"sun_{k + 1}", light) for k, light in enumerate(lights)]
    punctual = [
        {"type": "directional", "name": name, "color": list(light.color), "intensity": light.intensity}
        for name, light in named
    ]
    nodes = [
        {"name": name, "rotation": list(light.quaternion()), "extensions": {_LIGHTS: {"light": k}}}
        for k, (name, light) in enumerate(named)
    ]
    return document | {
        "extensionsUsed": [_LIGHTS],
        "extensions": {_LIGHTS: {"lights": punctual}},
        "nodes": [*document["nodes"], *nodes],
        "scenes": [{"nodes": list(range(1 + len(nodes)))}],
    }


def _material(name: str) -> dict[str, Any]:
    return {
        "name": name,
        "pbrMetallicRoughness": {"baseColorTexture": {"index": 0}, "metallicRoughnessTexture": {"index": 1}},
        "normalTexture": {"index": 2},
        "occlusionTexture": {"index": 1},
    }


def _container(document: dict[str, Any], binary: bytes) -> bytes:
    text = json.dumps(document, separators=(",", ":"), allow_nan=False).encode()
    text += b" " * (-len(text) % 4)
    chunks = (
        struct.pack("<I4s", len(text), b"JSON") + text + struct.pack("<I4s", len(binary), b"BIN\0") + binary
    )
    return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks
