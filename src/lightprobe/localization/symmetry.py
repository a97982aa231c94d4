"""Turns that bring an object's shape onto itself: where one pose fits a photo, its copies may fit as well.

A shape's axes of symmetry are among the principal axes of its surface, through its centroid. A turn counts
when the turned surface stays within a small distance of the unturned one; what is painted on it does not
matter here, the photo decides about that.
"""

from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial import cKDTree

from lightprobe.geometry.mesh import Mesh, face_normals
from lightprobe.localization.pose import rotation_of
from lightprobe.scene.camera import Camera

_ANGLES = 24  # about each axis, a full turn
_POINTS = 3000  # of the surface that are compared
_SAME = 0.03  # radii: mean distance of a turned surface, beyond half the spacing of its points


@dataclass(frozen=True)
class Turn:
    """A rotation about a point."""

    rotation: np.ndarray  # (3, 3)
    center: np.ndarray  # (3,) normalised frame

    def copy(self, camera: Camera) -> Camera:
        """Return the camera that sees the turned object where `camera` sees it unturned."""
        pose = camera.camera_to_world.copy()
        pose[:3, :3] = self.rotation @ pose[:3, :3]
        pose[:3, 3] = self.rotation @ (camera.position - self.center) + self.center
        return replace(camera, camera_to_world=pose)


def symmetric_turns(mesh: Mesh) -> list[Turn]:
    """Return the turns, not by nothing, that bring the surface of a mesh onto itself."""
    points = _surface_points(mesh)
    center = points.mean(0)
    arms = points - center
    axes = np.linalg.eigh(arms.T @ arms)[1].T
    tree = cKDTree(arms)
    some = arms[::3]
    spacing = float(tree.query(some, 2)[0][:, 1].mean())
    turns = []
    for axis in axes:
        for step in range(1, _ANGLES):
            rotation = rotation_of(axis * (2 * np.pi * step / _ANGLES))
            if float(tree.query(some @ rotation.T)[0].mean()) <= _SAME + 0.5 * spacing:
                turns.append(Turn(rotation, center))
    return turns


def _surface_points(mesh: Mesh) -> np.ndarray:
    """Return points (N, 3) float64 spread evenly over the surface, the same for the same mesh."""
    corners = mesh.vertices.double().cpu().numpy()[mesh.faces.long().cpu().numpy()]
    area = 0.5 * face_normals(mesh.vertices, mesh.faces).norm(dim=1).double().cpu().numpy()
    random = np.random.default_rng(0)
    face = random.choice(len(area), _POINTS, p=area / area.sum())
    share = random.dirichlet(np.ones(3), _POINTS)
    return (corners[face] * share[..., None]).sum(1)
