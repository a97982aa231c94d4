"""Texture coordinates for a mesh: charts by xatlas under a time limit, or a simple atlas."""

import io
import math
import subprocess
import sys
import zipfile

import numpy as np
import torch

from lightprobe.geometry.mesh import Mesh

_FEWEST_TEXELS = 6  # along an edge of the square that two triangles share, margins included


def unwrap(vertices: np.ndarray, faces: np.ndarray, texture_size: int, time_limit: float) -> tuple[Mesh, int]:
    """Return the mesh with texture coordinates, vertices (V, 3), faces (F, 3), and the texture size that it
    needs.

    The unwrapper runs in a process of its own, because on difficult meshes it can take unbounded time; after
    `time_limit` seconds (or a crash) `triangle_atlas` takes over, which may need more than `texture_size`
    texels.
    """
    result = _run_xatlas(vertices, faces, texture_size, time_limit)
    if result is None:
        texture_size = max(texture_size, triangle_atlas_size(len(faces), _FEWEST_TEXELS))
        result = triangle_atlas(len(faces), texture_size)
    uvs, uv_faces = result
    mesh = Mesh(
        torch.from_numpy(np.ascontiguousarray(vertices, np.float32)),
        torch.from_numpy(np.ascontiguousarray(faces, np.int32)),
        torch.from_numpy(np.ascontiguousarray(uvs, np.float32)),
        torch.from_numpy(np.ascontiguousarray(uv_faces, np.int32)),
    )
    return mesh, texture_size


def _run_xatlas(
    vertices: np.ndarray, faces: np.ndarray, texture_size: int, time_limit: float
) -> tuple[np.ndarray, np.ndarray] | None:
    """Return (uvs, uv_faces) from the unwrapper in another process, or None when it failed or took too long."""
    request = io.BytesIO()
    np.savez(request, vertices=vertices, faces=faces, texture_size=texture_size)
    command = [sys.executable, "-m", "lightprobe.geometry.xatlas_process"]
    try:
        done = subprocess.run(
            command, input=request.getvalue(), capture_output=True, timeout=time_limit, check=True
        )
        answer = np.load(io.BytesIO(done.stdout), allow_pickle=False)
        return answer["uvs"], answer["uv_faces"]
    except (subprocess.SubprocessError, OSError, ValueError, zipfile.BadZipFile):
        return None


def triangle_atlas_size(count: int, texels: int) -> int:
    """Return the texture size, a multiple of 256, that gives each pair of triangles a square of `texels`²."""
    return 256 * math.ceil((texels * math.sqrt(count / 2) + 64) / 256)


def triangle_atlas(count: int, texture_size: int) -> tuple[np.ndarray, np.ndarray]:
    """Return uvs (3 * count, 2) and uv_faces (count, 3): each pair of triangles fills a square of a grid."""
    squares = (count + 1) // 2
    side = int(np.ceil(np.sqrt(squares)))
    margin = min(0.45, side / texture_size)  # one texel, in units of a square
    number = np.arange(count)
    square = number // 2
    origin = np.stack([square % side, square // side], 1)[:, None, :]
    lower = np.array([[margin, margin], [1 - 2.5 * margin, margin], [margin, 1 - 2.5 * margin]])
    corner = np.where((number % 2 == 0)[:, None, None], lower, 1 - lower)
    return ((origin + corner) / side).reshape(-1, 2), np.arange(3 * count).reshape(-1, 3)
