"""The virtual object to be put into a photo: a GLB file's triangles with their materials, z up, in the file's
units.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor

from lightprobe.core.errors import InputError
from lightprobe.geometry.mesh import is_closed
from lightprobe.insertion.glb_file import GlbFile, numbers, sound
from lightprobe.insertion.materials import Material, TextureReader

MOST_FACES = 2_000_000  # that are drawn
_MOST_NODES = 100_000  # of a scene's tree
_FARTHEST = 1e9  # coordinates, in the file's units
_TRIANGLES, _STRIP, _FAN = 4, 5, 6  # modes of glTF
_READ_EXTENSIONS = {"KHR_texture_transform", "KHR_materials_emissive_strength", "KHR_mesh_quantization"}


@dataclass(frozen=True)
class VirtualObject:
    """Triangles of V vertices; each vertex has one normal, one place in each texture set and one colour."""

    vertices: Tensor  # (V, 3) float32, z up, from the middle of its box: coordinates of a survey would round
    faces: Tensor  # (F, 3) int32, counter-clockwise from outside
    normals: Tensor  # (V, 3) unit
    uvs: Tensor  # (V, 4): two sets of texture coordinates
    colors: Tensor  # (V, 4) linear, in [0, 1]
    material: Tensor  # (F,) int64 into `materials`
    twin: Tensor  # (F,) int64: the other side of an open two-sided face, -1 for none
    materials: tuple[Material, ...]
    warnings: tuple[str, ...] = ()

    @property
    def size(self) -> np.ndarray:
        """Extent along x, y and z, (3,)."""
        return (self.vertices.amax(0) - self.vertices.amin(0)).numpy().astype(np.float64)

    def to(self, device: torch.device) -> "VirtualObject":
        """Return the virtual object on another device."""
        moved: dict[str, Any] = {key: v.to(device) for key, v in vars(self).items() if isinstance(v, Tensor)}
        return replace(self, **moved, materials=tuple(material.to(device) for material in self.materials))


def load_virtual_object(path: Path) -> VirtualObject:
    """Return the virtual object in a GLB file, as its default scene shows it at rest.

    Raises `InputError` for a file that is missing, damaged, hostile or empty, has more than 2 million faces,
    or needs unsupported features: other files, compressed meshes or textures, point clouds.
    """
    file = GlbFile.read(Path(path))
    with sound(file.path):
        needed = file.document.get("extensionsRequired", [])
        if unread := sorted({str(name) for name in needed} - _READ_EXTENSIONS):
            names = ", ".join(unread)[:100]
            raise InputError(f"{file.path} needs {names}, which is not read; export it without extensions.")
        instances = list(_instances(file))
        _check_count(file, instances)
        parts = [_part(file, primitive, matrix) for primitive, matrix in instances]
        materials, reader = {}, TextureReader(file)
        for index in dict.fromkeys(part.source for part in parts):
            entry = {} if index is None else file.entry("materials", index)
            materials[index] = Material.of(entry, reader)
        return _joined(file, parts, materials)


@dataclass(frozen=True)
class _Part:
    """One primitive of one node, in world axes."""

    vertices: np.ndarray
    faces: np.ndarray
    normals: np.ndarray
    uvs: np.ndarray
    colors: np.ndarray
    source: int | None  # the document's material


def _instances(file: GlbFile) -> Iterator[tuple[dict[str, Any], np.ndarray]]:
    """Yield every primitive of triangles that the scene shows, with its matrix to the world (4, 4)."""
    nodes, scenes = file.entries("nodes"), file.entries("scenes")
    if len(nodes) > _MOST_NODES:
        raise InputError(f"{file.path} has {len(nodes)} nodes, more than are read; join its parts.")
    roots = range(len(nodes))
    if scenes:
        roots = file.entry("scenes", file.document.get("scene", 0)).get("nodes", [])
    waiting, seen = [(index, np.eye(4)) for index in roots], set[int]()
    while waiting:
        index, above = waiting.pop()
        node = file.entry("nodes", index)
        if index in seen:
            if not scenes:
                continue
            raise ValueError("a node has two parents or is its own")
        seen.add(index)
        matrix = above @ _local(node)
        if not np.isfinite(matrix).all():
            raise ValueError("a node's transform is not finite")
        waiting += [(child, matrix) for child in node.get("children", [])]
        if "mesh" in node:
            for primitive in file.entry("meshes", node["mesh"])["primitives"]:
                if primitive.get("mode", _TRIANGLES) in (_TRIANGLES, _STRIP, _FAN):
                    yield primitive, matrix


def _local(node: dict[str, Any]) -> np.ndarray:
    """Return a node's own transform (4, 4)."""
    if "matrix" in node:
        return numbers(node["matrix"], 16).reshape(4, 4).T
    quaternion = numbers(node.get("rotation", [0, 0, 0, 1]), 4)
    x, y, z, w = quaternion / max(float(np.linalg.norm(quaternion)), 1e-12)
    matrix = np.eye(4)
    matrix[:3, :3] = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    matrix[:3, :3] *= numbers(node.get("scale", [1, 1, 1]), 3)
    matrix[:3, 3] = numbers(node.get("translation", [0, 0, 0]), 3)
    return matrix


def _check_count(file: GlbFile, instances: list[tuple[dict[str, Any], np.ndarray]]) -> None:
    """Refuse a file without triangles, or with too many, by the counts that its document announces."""
    faces = vertices = 0
    for primitive, _ in instances:
        points = file.count(primitive["attributes"]["POSITION"])
        corners = file.count(primitive["indices"]) if "indices" in primitive else points
        faces += corners // 3 if primitive.get("mode", _TRIANGLES) == _TRIANGLES else max(corners - 2, 0)
        vertices += points
    if faces == 0:
        raise InputError(f"{file.path} shows no triangles; export the mesh, not only animations or points.")
    if faces > MOST_FACES or vertices > 3 * MOST_FACES:
        raise InputError(
            f"{file.path} has {faces} faces and {vertices} vertices, more than the {MOST_FACES} faces that are read; "
            "simplify its mesh."
        )


def _part(file: GlbFile, primitive: dict[str, Any], matrix: np.ndarray) -> _Part:
    attributes = primitive["attributes"]
    points = file.array(attributes["POSITION"], ("VEC3",)).astype(np.float64)
    faces = _triangles(file, primitive, len(points))
    linear = matrix[:3, :3]
    if np.linalg.det(linear) < 0:  # a mirror turns triangles around
        faces = faces[:, ::-1]
    world = points @ linear.T + matrix[:3, 3]
    if not np.abs(world).max(initial=0) <= _FARTHEST:
        raise InputError(f"{file.path} has vertices absurdly far from its origin; export it again, nearer.")

    def attribute(name: str, *kinds: str) -> np.ndarray | None:
        if name not in attributes:
            return None
        values = file.array(attributes[name], kinds).astype(np.float64)
        if len(values) != len(points):
            raise ValueError(f"{name} has {len(values)} elements for {len(points)} vertices")
        return values

    pairs = [attribute(f"TEXCOORD_{k}", "VEC2") for k in (0, 1)]
    uvs = np.concatenate([np.zeros((len(points), 2)) if pair is None else pair for pair in pairs], 1)
    colors = np.ones((len(points), 4))
    if (painted := attribute("COLOR_0", "VEC3", "VEC4")) is not None:
        colors[:, : painted.shape[1]] = painted.clip(0, 1)
    normals = attribute("NORMAL", "VEC3")
    if normals is not None:
        # Normals turn with the cofactors of the transform, whose sign a mirror flips.
        a, b, c = linear
        cofactors = np.stack([np.cross(b, c), np.cross(c, a), np.cross(a, b)])
        normals = normals @ (cofactors * np.sign(np.linalg.det(linear) or 1.0)).T
        used, corners = np.unique(faces, return_inverse=True)  # several meshes may share a list of vertices
        faces = corners.reshape(-1, 3)
        world, uvs, colors, normals = (values[used] for values in (world, uvs, colors, normals))
    else:  # flat, as glTF asks for
        world, uvs, colors = (values[faces.ravel()] for values in (world, uvs, colors))
        faces = np.arange(len(world)).reshape(-1, 3)
        normals = np.repeat(np.cross(world[1::3] - world[::3], world[2::3] - world[::3]), 3, 0)
    length = np.linalg.norm(normals, axis=1, keepdims=True)
    normals = np.where(length > 1e-20, normals / np.maximum(length, 1e-20), [0.0, 1.0, 0.0])
    return _Part(_z_up(world), faces, _z_up(normals), uvs, colors, primitive.get("material"))


def _z_up(vectors: np.ndarray) -> np.ndarray:
    """Turn glTF's y-up vectors (N, 3) into the z-up frame: (x, -z, y)."""
    return np.stack([vectors[:, 0], -vectors[:, 2], vectors[:, 1]], 1)


def _triangles(file: GlbFile, primitive: dict[str, Any], count: int) -> np.ndarray:
    """Return the faces (F, 3) int64 of a list, strip or fan of triangles."""
    index = np.arange(count)
    if "indices" in primitive:
        index = file.array(primitive["indices"], ("SCALAR",))[:, 0].astype(np.int64)
    if index.max(initial=-1) >= count:
        raise ValueError("an index names a vertex that does not exist")
    mode = primitive.get("mode", _TRIANGLES)
    if mode == _TRIANGLES:
        return index[: len(index) // 3 * 3].reshape(-1, 3)
    if mode == _FAN:
        return np.stack([np.repeat(index[:1], max(len(index) - 2, 0)), index[1:-1], index[2:]], 1)
    faces = np.stack([index[:-2], index[1:-1], index[2:]], 1)
    faces[1::2] = faces[1::2, [1, 0, 2]]
    return faces


def _joined(file: GlbFile, parts: list[_Part], materials: dict[int | None, Material]) -> VirtualObject:
    """Return all parts as one; open parts that are two-sided get their other side as faces of its own."""
    order = list(materials)
    columns: dict[str, list[np.ndarray]] = {key: [] for key in ("vertices", "normals", "uvs", "colors")}
    faces, kinds, twins, base, count = [], [], [], 0, 0
    for part in parts:
        two_sided = materials[part.source].double_sided and not _encloses(part)
        for side in (1, -1) if two_sided else (1,):
            for key, values in columns.items():
                values.append(getattr(part, key) * (side if key == "normals" else 1))
            faces.append((part.faces if side == 1 else part.faces[:, [0, 2, 1]]) + base)
            here = np.arange(count, count + len(part.faces))
            twins.append(here + side * len(part.faces) if two_sided else np.full(len(here), -1))
            kinds.append(np.full(len(here), order.index(part.source)))
            base, count = base + len(part.vertices), count + len(here)
    if count > MOST_FACES:
        raise InputError(f"{file.path} has {count} faces, both sides of sheets counted; simplify its mesh.")
    vertices = np.concatenate(columns["vertices"])
    if (vertices.max(0) - vertices.min(0)).max() < 1e-9:
        raise InputError(f"{file.path} has no extent: all its vertices are at one point.")
    columns["vertices"] = [vertices - (vertices.min(0) + vertices.max(0)) / 2]
    return VirtualObject(
        **{key: torch.from_numpy(np.concatenate(values)).float() for key, values in columns.items()},
        faces=torch.from_numpy(np.concatenate(faces).astype(np.int32)),
        material=torch.from_numpy(np.concatenate(kinds)),
        twin=torch.from_numpy(np.concatenate(twins)),
        materials=tuple(materials.values()),
        warnings=tuple(_warnings(file)),
    )


def _encloses(part: _Part) -> bool:
    """Return whether a part bounds a solid, with vertices joined that textures and creases have split."""
    near = part.vertices - part.vertices[0]  # far from the origin 32 bits would join vertices that are apart
    points, index = np.unique(near.astype(np.float32) + 0.0, axis=0, return_inverse=True)
    return is_closed(torch.from_numpy(points), torch.from_numpy(index.reshape(-1)[part.faces]))


def _warnings(file: GlbFile) -> Iterator[str]:
    used = {str(name) for name in file.document.get("extensionsUsed", [])}
    odd = sorted(name for name in used if name.startswith("KHR_materials") and name not in _READ_EXTENSIONS)
    if odd:
        yield f"{file.path}: {', '.join(odd)[:100]} is left out; glass, coats and the like are drawn as plain surfaces."
    if file.entries("skins"):
        yield f"{file.path} has a skeleton; the object is drawn in the pose that its mesh is stored in."
