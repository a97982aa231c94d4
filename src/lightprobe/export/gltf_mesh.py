"""The mesh as glTF wants it: one index per corner, y up, the user's units, tangents with handedness.

Frames: normalised (z up) -> user (z up), by undoing the similarity -> glTF, by (x, y, z) -> (x, z, -y).

Formats store vertices in 32 bits, seven digits: those of an object at survey coordinates, millions of units away,
would fall together. So vertices are told from the object's middle, and where that is, in 64 bits, apart from them:
it goes into the transform of the node or prim, which both formats keep in 64 bits.
"""

from dataclasses import dataclass

import numpy as np
import torch

from lightprobe.geometry.mesh import Mesh, uv_tangents
from lightprobe.render.asset import uv_handedness
from lightprobe.scene.camera import Similarity


@dataclass(frozen=True)
class GltfMesh:
    """Arrays of N vertices and F triangles in the glTF frame."""

    origin: np.ndarray  # (3,) float64, user's units: where the middle of the object is
    positions: np.ndarray  # (N, 3) float32, user's units, from `origin`
    normals: np.ndarray  # (N, 3) float32, unit
    tangents: np.ndarray  # (N, 4) float32: unit, orthogonal to the normal; w = +-1
    uvs: np.ndarray  # (N, 2) float32, v downwards
    faces: np.ndarray  # (F, 3) uint32, counter-clockwise from outside


def to_y_up(vectors: np.ndarray) -> np.ndarray:
    """Turn z-up vectors (..., 3) into glTF's y-up frame: (x, z, -y); Blender's importer does the reverse."""
    return np.stack([vectors[..., 0], vectors[..., 2], -vectors[..., 1]], axis=-1)


Y_UP = torch.from_numpy(
    to_y_up(np.eye(3)).T.copy()
)  # (3, 3) float64: the y-up frame's axes, a row each, z up


def gltf_mesh(mesh: Mesh, similarity: Similarity) -> GltfMesh:
    """Return the mesh with positions, texture coordinates and tangents under one index.

    Corners that share position, texture vertex, normal and UV orientation share a vertex; nothing else does.
    """
    mesh = mesh.to(torch.device("cpu"))
    normals = mesh.normals().detach().numpy().astype(np.float64)
    tangents = uv_tangents(mesh).numpy().astype(np.float64)
    hand = np.repeat(uv_handedness(mesh).numpy()[:, None], 3, axis=1)
    faces, uv_faces = mesh.faces.numpy(), mesh.uv_faces.numpy()
    normal_faces, w = mesh.normal_index.numpy().ravel(), hand.ravel().astype(faces.dtype)
    shared = faces.ravel(), uv_faces.ravel(), normal_faces, w
    unique, index = np.unique(np.stack(shared, axis=1), axis=0, return_inverse=True)
    vertex, uv, bent, w = unique.T
    normal = _unit(normals[bent], np.array([0.0, 0.0, 1.0]))
    tangent = _orthogonal_unit(tangents[uv], normal)
    return GltfMesh(
        to_y_up(similarity.center),
        to_y_up(similarity.scale * mesh.vertices.detach().numpy()[vertex].astype(np.float64)).astype(
            np.float32
        ),
        to_y_up(normal).astype(np.float32),
        np.concatenate([to_y_up(tangent), w[:, None]], axis=1).astype(np.float32),
        mesh.uvs.numpy()[uv].astype(np.float32),
        index.reshape(-1, 3).astype(np.uint32),
    )


def _unit(vectors: np.ndarray, fallback: np.ndarray) -> np.ndarray:
    length = np.linalg.norm(vectors, axis=1, keepdims=True)
    return np.where(length > 1e-12, vectors / np.maximum(length, 1e-12), fallback)


def _orthogonal_unit(tangents: np.ndarray, normals: np.ndarray) -> np.ndarray:
    """Make tangents orthogonal to unit normals; a tangent along its normal is replaced by any orthogonal one."""
    axis = np.eye(3)[np.argmin(np.abs(normals), axis=1)]  # the one farthest from the normal
    spare = _unit(np.cross(normals, axis), axis)
    flat = tangents - (tangents * normals).sum(1, keepdims=True) * normals
    return np.where(np.linalg.norm(flat, axis=1, keepdims=True) > 1e-4, _unit(flat, spare), spare)
