"""Texture coordinates for a mesh: charts by xatlas under a time limit, or a simple atlas that always succeeds."""

import io
import subprocess
import sys
import zipfile

import numpy as np
import torch

from lightprobe.geometry.mesh import Mesh


def unwrap(vertices: np.ndarray, faces: np.ndarray, texture_size: int, time_limit: float) -> Mesh:
    """Return the mesh with texture coordinates; vertices (V, 3), faces (F, 3).

    The unwrapper runs in a process of its own, because on difficult meshes it can take unbounded time; after
    `time_limit` seconds (or a crash) `triangle_atlas` takes over.
    """
    result = _run_xatlas(vertices, faces, texture_size, time_limit)
    uvs, uv_faces = result if result is not None else triangle_atlas(len(faces), texture_size)
    return Mesh(
        torch.from_numpy(np.ascontiguousarray(vertices, np.float32)),
        torch.from_numpy(np.ascontiguousarray(faces, np.int32)),
        torch.from_numpy(np.ascontiguousarray(uvs, np.float32)),
        torch.from_numpy(np.ascontiguousarray(uv_faces, np.int32)),
    )


def _run_xatlas(
    vertices: np.ndarray, faces: np.ndarray, texture_size: int, time_limit: float
) -> tuple[np.ndarray, np.ndarray] | None:
    """Return (uvs, uv_faces) from the unwrapper in another process, or None when it failed or took too long."""
    request = io.BytesIO()
    np.savez(request, vertices=vertices, faces=faces, texture_size=texture_size)
    command = [sys.executable, "-m", "lightprobe.geometry.xatlas_process"]
    try:
        done = subprocess.run(command, input=request.getvalue(), capture_output=True, timeout=time_limit, check=True)
        answer = np.load(io.BytesIO(done.stdout), allow_pickle=False)
        return answer["uvs"], answer["uv_faces"]
    except (subprocess.SubprocessError, OSError, ValueError, zipfile.BadZipFile):
        return None


def triangle_atlas(count: int, texture_size: int) -> tuple[np.ndarray, np.ndarray]:
    """Return uvs (3 * count, 2) and uv_faces (count, 3): each pair of triangles fills one square of a regular grid."""
    squares = (count + 1) // 2
    side = int(np.ceil(np.sqrt(squares)))
    margin = min(0.45, side / texture_size)  # one texel, in units of a square
    number = np.arange(count)
    square = number // 2
    origin = np.stack([square % side, square // side], 1)[:, None, :]
    lower = np.array([[margin, margin], [1 - 2.5 * margin, margin], [margin, 1 - 2.5 * margin]])
    corner = np.where((number % 2 == 0)[:, None, None], lower, 1 - lower)
    return ((origin + corner) / side).reshape(-1, 2), np.arange(3 * count).reshape(-1, 3)
