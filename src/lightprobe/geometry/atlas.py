"""Texture coordinates for a mesh: charts by xatlas under a time limit, or a simple atlas that always succeeds."""

import multiprocessing
from multiprocessing.connection import Connection

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
    context = multiprocessing.get_context("spawn")
    receiver, sender = context.Pipe(duplex=False)
    process = context.Process(target=_xatlas_worker, args=(sender, vertices, faces, texture_size), daemon=True)
    process.start()
    sender.close()
    try:
        return receiver.recv() if receiver.poll(time_limit) else None
    except EOFError:
        return None
    finally:
        process.kill()
        process.join()


def _xatlas_worker(sender: Connection, vertices: np.ndarray, faces: np.ndarray, texture_size: int) -> None:
    import xatlas

    atlas = xatlas.Atlas()
    atlas.add_mesh(np.ascontiguousarray(vertices, np.float32), np.ascontiguousarray(faces, np.uint32))
    pack = xatlas.PackOptions()
    pack.resolution = texture_size
    pack.padding = 2
    pack.bilinear = True
    atlas.generate(xatlas.ChartOptions(), pack)
    _, uv_faces, uvs = atlas[0]
    sender.send((np.asarray(uvs, np.float32), np.asarray(uv_faces, np.int32)))


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
