"""Distance between two surfaces, measured where both can be seen from outside."""

import numpy as np
import scipy
import torch

from lightprobe.evaluation.viewpoints import surrounding
from lightprobe.kernels import rasterize
from lightprobe.render.surface import View

_VIEWS, _SIDE = 96, 256  # cameras, and pixels of their pictures, that decide which faces can be seen at all


def sample_surface(vertices: np.ndarray, faces: np.ndarray, count: int, seed: int) -> np.ndarray:
    """Return `count` points (count, 3) float64 spread evenly by area over triangles."""
    rng = np.random.default_rng(seed)
    corners = np.asarray(vertices, np.float64)[faces]
    e1, e2 = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    area = np.linalg.norm(np.cross(e1, e2), axis=1)
    chosen = rng.choice(len(faces), size=count, p=area / area.sum())
    u, v = rng.random((2, count, 1))
    flip = u + v > 1
    u, v = np.where(flip, 1 - u, u), np.where(flip, 1 - v, v)
    return corners[chosen, 0] + u * e1[chosen] + v * e2[chosen]


def chamfer_distance(points: np.ndarray, reference: np.ndarray) -> float:
    """Return the mean of the two mean nearest-neighbour distances between point sets (N, 3) and (M, 3)."""
    there = scipy.spatial.cKDTree(reference).query(points)[0].mean()
    back = scipy.spatial.cKDTree(points).query(reference)[0].mean()
    return float((there + back) / 2)


def mesh_chamfer(
    mesh: tuple[np.ndarray, np.ndarray], truth: tuple[np.ndarray, np.ndarray], *, count: int = 40_000
) -> float:
    """Return the Chamfer distance of two meshes (vertices, faces) in one frame, in units of the true object's
    radius.

    Only faces that can be seen from somewhere outside count: nothing in a photo tells of the others. Points
    are drawn on each mesh on its own, so that equal meshes are as far apart as their points: about .005 with
    40 000 of them.
    """
    vertices = truth[0]
    center = (vertices.min(0) + vertices.max(0)) / 2
    radius = float(np.linalg.norm(vertices - center, axis=1).max())
    clouds = []
    for seed, (v, f) in enumerate((mesh, truth)):
        local = (np.asarray(v, np.float64) - center) / radius
        clouds.append(sample_surface(local, f[outer_faces(local, f)], count, seed))
    return chamfer_distance(*clouds)


def outer_faces(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Return the sorted indices (K,) int64 of the faces seen from any of 96 viewpoints all around the origin.

    vertices (V, 3) and faces (F, 3): the mesh.
    """
    v, f = torch.as_tensor(vertices, dtype=torch.float32), torch.as_tensor(np.asarray(faces, np.int32))
    seen = np.zeros(len(f), bool)
    for camera in surrounding(_VIEWS, _SIDE, float(np.linalg.norm(vertices, axis=1).max())):
        view = View.of(camera, v.device)
        face = rasterize(view.project(v), f, view.height, view.width).face
        seen[face[face >= 0].numpy()] = True
    return seen.nonzero()[0]
