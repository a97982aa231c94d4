"""Small meshes, cameras and assets that tests share."""

import numpy as np
import torch

from lightprobe.geometry.atlas import triangle_atlas
from lightprobe.geometry.mesh import Mesh
from lightprobe.scene.camera import Camera


def sphere(subdivisions: int) -> tuple[np.ndarray, np.ndarray]:
    """Return a unit icosphere: vertices (V, 3) float32, faces (F, 3) int32."""
    import trimesh

    ball = trimesh.creation.icosphere(subdivisions)
    return np.asarray(ball.vertices, np.float32), np.asarray(ball.faces, np.int32)


def sphere_mesh(subdivisions: int, texture_size: int = 256) -> Mesh:
    """Return the icosphere with a triangle atlas."""
    vertices, faces = sphere(subdivisions)
    uvs, uv_faces = triangle_atlas(len(faces), texture_size)
    return Mesh(
        torch.from_numpy(vertices),
        torch.from_numpy(faces),
        torch.from_numpy(uvs.astype(np.float32)),
        torch.from_numpy(uv_faces.astype(np.int32)),
    )


def ball_over_floor(radius: float, height: float) -> tuple[torch.Tensor, torch.Tensor, int]:
    """Return a fine square floor at z = 0 with a ball over its middle, and the index of the middle vertex."""
    n = 41
    line = torch.linspace(-0.7, 0.7, n)
    floor = torch.stack([*torch.meshgrid(line, line, indexing="xy"), torch.zeros(n, n)], -1).reshape(-1, 3)
    corner = (torch.arange(n - 1)[:, None] * n + torch.arange(n - 1)).reshape(-1)
    faces = torch.cat(
        [
            torch.stack([corner, corner + 1, corner + n], 1),
            torch.stack([corner + 1, corner + n + 1, corner + n], 1),
        ]
    )
    vertices, ball = (torch.from_numpy(part) for part in sphere(3))
    moved = radius * vertices + torch.tensor([0.0, 0.0, height])
    return torch.cat([floor, moved]), torch.cat([faces, ball.long() + n * n]).int(), n * n // 2


def camera_at(position, *, size: int = 64, focal: float = 90.0, width: int | None = None) -> Camera:
    """Return a camera at `position` that looks at the origin with +z up in the image."""
    eye = np.asarray(position, np.float64)
    back = eye / np.linalg.norm(eye)
    right = np.cross([0.0, 0.0, 1.0], back)
    right /= np.linalg.norm(right)
    pose = np.eye(4)
    pose[:3, 0], pose[:3, 1], pose[:3, 2], pose[:3, 3] = right, np.cross(back, right), back, eye
    width = width or size
    return Camera(pose, focal, focal, width / 2, size / 2, width, size)
