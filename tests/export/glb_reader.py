"""A small reader of GLB files for tests, written from the glTF 2.0 specification alone."""

import io
import json
import struct

import numpy as np
from PIL import Image

_COMPONENTS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4}
_TYPES = {5126: "<f4", 5125: "<u4"}


class Glb:
    """The JSON document and binary chunk of a GLB file, checked against the container rules while reading."""

    def __init__(self, data: bytes):
        magic, version, length = struct.unpack_from("<4sII", data)
        assert (magic, version, length) == (b"glTF", 2, len(data))
        json_length, json_kind = struct.unpack_from("<I4s", data, 12)
        assert json_kind == b"JSON"
        assert json_length % 4 == 0
        self.document = json.loads(data[20 : 20 + json_length])
        binary_length, binary_kind = struct.unpack_from("<I4s", data, 20 + json_length)
        assert binary_kind == b"BIN\0"
        assert binary_length % 4 == 0
        self.binary = data[28 + json_length :]
        assert len(self.binary) == binary_length == self.document["buffers"][0]["byteLength"]

    def view(self, index: int) -> bytes:
        view = self.document["bufferViews"][index]
        assert view["byteOffset"] % 4 == 0
        assert view["byteOffset"] + view["byteLength"] <= len(self.binary)
        return self.binary[view["byteOffset"] : view["byteOffset"] + view["byteLength"]]

    def array(self, index: int) -> np.ndarray:
        accessor = self.document["accessors"][index]
        width = _COMPONENTS[accessor["type"]]
        values = np.frombuffer(self.view(accessor["bufferView"]), _TYPES[accessor["componentType"]])
        assert values.size == accessor["count"] * width
        values = values.reshape(-1, width)
        for key, reduce in (("min", np.min), ("max", np.max)):
            if key in accessor:
                assert np.array_equal(reduce(values, axis=0), np.asarray(accessor[key], np.float32))
        return values

    def attribute(self, name: str) -> np.ndarray:
        return self.array(self.document["meshes"][0]["primitives"][0]["attributes"][name])

    def positions(self) -> np.ndarray:
        """Return where the first node's transform puts the vertices, (N, 3) float64."""
        return self.attribute("POSITION") + np.array(self.document["nodes"][0]["translation"], np.float64)

    def faces(self) -> np.ndarray:
        return self.array(self.document["meshes"][0]["primitives"][0]["indices"]).reshape(-1, 3)

    def picture(self, texture: int) -> np.ndarray:
        image = self.document["images"][self.document["textures"][texture]["source"]]
        assert image["mimeType"] == "image/png"
        return np.asarray(Image.open(io.BytesIO(self.view(image["bufferView"]))))
