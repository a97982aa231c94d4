"""A binary glTF 2.0 file with one textured object, and its light: lamps (KHR_lights_punctual) and all the rest
(EXT_lights_image_based).

Layout: a 12-byte header, a JSON chunk padded with spaces and a binary chunk padded with zeros, each to four
bytes; every array and picture starts at a multiple of four (glTF 2.0, sections 3.6 and 4.4).
"""

import json
import math
import struct
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from lightprobe.core.files import write_bytes
from lightprobe.export.gltf_mesh import GltfMesh, to_y_up
from lightprobe.export.image_based_light import SIDE, ImageBasedLight
from lightprobe.light.sources import LightSource

_FLOAT, _UINT = 5126, 5125  # component types of glTF 2.0
_ARRAY_BUFFER, _ELEMENT_ARRAY_BUFFER = 34962, 34963  # targets of buffer views
_LIGHTS, _ENVIRONMENTS = "KHR_lights_punctual", "EXT_lights_image_based"
_SAMPLER = {"magFilter": 9729, "minFilter": 9987, "wrapS": 33071, "wrapT": 33071}  # trilinear, clamped


@dataclass(frozen=True)
class GltfPictures:
    """PNG files in memory; v = 0 is their top row."""

    base_color: bytes  # sRGB
    orm: bytes  # linear; R ambient occlusion, G roughness, B metallic
    normal: bytes  # linear; tangent space, green towards the top of the picture


@dataclass(frozen=True)
class DirectionalLight:
    """A sun or lamp as other programs' directional light, in a y-up frame.

    glTF's directional light shines along its node's -z (KHR_lights_punctual), USD's distant light along its own -z:
    the node's +z points to the source.
    """

    direction: np.ndarray  # (3,) unit, towards the source
    color: tuple[float, float, float]  # linear RGB, its largest value 1
    intensity: float  # irradiance of a surface that faces it; glTF's lux where a unit of the map is a cd/m^2
    angle: float  # degrees across its disc

    @staticmethod
    def of(source: LightSource) -> "DirectionalLight":
        """Return a source turned y-up; a black one is white with no intensity."""
        intensity = max(source.irradiance)
        r, g, b = (value / intensity if intensity > 0 else 1.0 for value in source.irradiance)
        angle = min(360.0, 2 * math.degrees(source.angular_radius))
        return DirectionalLight(to_y_up(np.asarray(source.direction)), (r, g, b), intensity, angle)

    def quaternion(self) -> tuple[float, float, float, float]:
        """Return the unit quaternion (x, y, z, w) of the shortest turn from +z to the direction."""
        x, y, z = (float(v) for v in self.direction)
        if z < -1 + 1e-9:  # half a turn about any axis across
            return 1.0, 0.0, 0.0, 0.0
        w = math.sqrt((1 + z) / 2)
        return -y / (2 * w), x / (2 * w), 0.0, w


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
        view = self.view(little.tobytes(), _ARRAY_BUFFER)
        entry: dict[str, Any] = {"bufferView": view, "componentType": _FLOAT, "count": len(little)}
        entry["type"] = kind
        if bounds:
            entry |= {"min": little.min(0).tolist(), "max": little.max(0).tolist()}
        self.accessors.append(entry)
        return len(self.accessors) - 1

    def indices(self, faces: np.ndarray) -> int:
        """Append triangle corners (F, 3) and return the index of their accessor."""
        view = self.view(np.ascontiguousarray(faces, "<u4").tobytes(), _ELEMENT_ARRAY_BUFFER)
        entry = {"bufferView": view, "componentType": _UINT, "count": faces.size, "type": "SCALAR"}
        self.accessors.append(entry)
        return len(self.accessors) - 1


def write_glb(
    path: Path,
    mesh: GltfMesh,
    pictures: GltfPictures,
    lights: Sequence[DirectionalLight] = (),
    environment: ImageBasedLight | None = None,
) -> None:
    """Write the object as a GLB file, atomically; raise `ResourceError` when the disk refuses."""
    write_bytes(path, encode_glb(mesh, pictures, lights=lights, environment=environment))


def encode_glb(
    mesh: GltfMesh,
    pictures: GltfPictures,
    *,
    name: str = "object",
    lights: Sequence[DirectionalLight] = (),
    environment: ImageBasedLight | None = None,
) -> bytes:
    """Return the bytes of a GLB file with one mesh of one material, a node for each lamp, and the environment."""
    binary = _Binary()
    attributes = {
        "POSITION": binary.array(mesh.positions, "VEC3", bounds=True),
        "NORMAL": binary.array(mesh.normals, "VEC3"),
        "TANGENT": binary.array(mesh.tangents, "VEC4"),
        "TEXCOORD_0": binary.array(mesh.uvs, "VEC2"),
    }
    primitive = {"attributes": attributes, "indices": binary.indices(mesh.faces), "material": 0, "mode": 4}
    images = [
        {"bufferView": binary.view(png), "mimeType": "image/png", "name": key}
        for key, png in vars(pictures).items()
    ]
    around = None
    if environment is not None:
        around = _environment(environment, binary, images)
    binary.data.extend(bytes(-len(binary.data) % 4))
    material = {
        "name": name,
        "pbrMetallicRoughness": {"baseColorTexture": {"index": 0}, "metallicRoughnessTexture": {"index": 1}},
        "normalTexture": {"index": 2},
        "occlusionTexture": {"index": 1},
    }
    document: dict[str, Any] = {
        "asset": {"version": "2.0", "generator": "lightprobe"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0, "name": name, "translation": mesh.origin.tolist()}],
        "meshes": [{"primitives": [primitive], "name": name}],
        "materials": [material],
        "textures": [{"source": i, "sampler": 0} for i in range(len(vars(pictures)))],
        "samplers": [_SAMPLER],
        "images": images,
        "accessors": binary.accessors,
        "bufferViews": binary.views,
        "buffers": [{"byteLength": len(binary.data)}],
    }
    if lights:
        _add_lights(document, lights)
    if around is not None:
        _extend(document, _ENVIRONMENTS, {"lights": [around]})
        document["scenes"][0]["extensions"] = {_ENVIRONMENTS: {"light": 0}}
    return _container(document, bytes(binary.data))


def _environment(light: ImageBasedLight, binary: _Binary, images: list[dict[str, Any]]) -> dict[str, Any]:
    """Append the faces of a light to the binary chunk and to `images`, and return the light's entry."""
    first = len(images)
    for level, faces in enumerate(light.faces):
        for face, png in zip(("px", "nx", "py", "ny", "pz", "nz"), faces, strict=True):
            name = f"environment_{level}_{face}"
            images.append({"bufferView": binary.view(png), "mimeType": "image/png", "name": name})
    return {
        "name": "environment",
        "intensity": light.intensity,
        "irradianceCoefficients": light.irradiance,
        "specularImageSize": SIDE,
        "specularImages": [list(range(k, k + 6)) for k in range(first, len(images), 6)],
    }


def _extend(document: dict[str, Any], name: str, content: dict[str, Any]) -> None:
    """Add an extension to a document, which programs that do not know it may ignore."""
    document.setdefault("extensionsUsed", []).append(name)
    document.setdefault("extensions", {})[name] = content


def _add_lights(document: dict[str, Any], lights: Sequence[DirectionalLight]) -> None:
    """Add directional lights to the document of one node, in nodes of their own."""
    named = [(f"sun_{k + 1}", light) for k, light in enumerate(lights)]
    punctual = [
        {"type": "directional", "name": each, "color": list(light.color), "intensity": light.intensity}
        for each, light in named
    ]
    nodes = [
        {"name": name, "rotation": list(light.quaternion()), "extensions": {_LIGHTS: {"light": k}}}
        for k, (name, light) in enumerate(named)
    ]
    _extend(document, _LIGHTS, {"lights": punctual})
    document["nodes"] += nodes
    document["scenes"] = [{"nodes": list(range(1 + len(nodes)))}]


def _container(document: dict[str, Any], binary: bytes) -> bytes:
    text = json.dumps(document, separators=(",", ":"), allow_nan=False).encode()
    text += b" " * (-len(text) % 4)
    heads = struct.pack("<I4s", len(text), b"JSON"), struct.pack("<I4s", len(binary), b"BIN\0")
    chunks = heads[0] + text + heads[1] + binary
    return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks
