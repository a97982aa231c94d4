"""Small changes of a camera, how projected points follow them, and the turns that leave a shape as it is.

Notation: a step has seven numbers: a turn w (3) about the object's origin and a shift s (3), both in camera
axes, the shift in distances from camera to origin; and p, the change of the logarithm of the focal length. A
longer focal length comes with a proportionally larger distance, so that the object keeps its size in the
photo:

    x' = o + exp(w) (x - o) + |o| (s_x, s_y, s_z - p),   f' = f exp(p)

x, o: a point and the origin in camera axes (x right, y up, looking along -z).
"""

from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial import cKDTree

from lightprobe.geometry.mesh import Mesh, face_normals
from lightprobe.scene.camera import Camera

PARAMETERS = 7  # of a step, the last of which is the focal length's
_ANGLES = 24  # about each axis, a full turn
_POINTS = 3000  # of the surface that are compared
_SAME = 0.03  # radii: mean distance of a turned surface, beyond half the spacing of its points


def moved(camera: Camera, step: np.ndarray) -> Camera:
    """Return the camera after a step (7,)."""
    rotation, position = camera.camera_to_world[:3, :3], camera.position
    origin = -rotation.T @ position
    turn = rotation_of(step[:3])
    shifted = origin + np.linalg.norm(origin) * (step[3:6] - np.array([0.0, 0.0, step[6]]))
    pose = np.eye(4)
    pose[:3, :3] = rotation @ turn.T
    pose[:3, 3] = -pose[:3, :3] @ shifted
    factor = float(np.exp(step[6]))
    return replace(camera, camera_to_world=pose, fx=camera.fx * factor, fy=camera.fy * factor)


def rotation_of(turn: np.ndarray) -> np.ndarray:
    """Return the rotation matrix (3, 3) of an axis times its angle in radians, (3,)."""
    angle = float(np.linalg.norm(turn))
    x, y, z = turn / max(angle, 1e-12)
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross


def least_rotation(start: np.ndarray, end: np.ndarray) -> np.ndarray:
    """Return the least rotation (3, 3) from the unit vector `start` (3,) to `end` (3,), not its opposite."""
    axis, cosine = np.cross(start, end), float(start @ end)
    cross = np.array([[0, -axis[2], axis[1]], [axis[2], 0, -axis[0]], [-axis[1], axis[0], 0]])
    return np.eye(3) + cross + cross @ cross / max(1 + cosine, 1e-9)


def motion(camera: Camera, points: np.ndarray) -> np.ndarray:
    """Return how world points (N, 3) move in the photo with a step, (N, 2, 7) pixels per unit."""
    rotation, position = camera.camera_to_world[:3, :3], camera.position
    local = (points - position) @ rotation
    origin = -rotation.T @ position
    x, y, depth = local[:, 0], local[:, 1], np.maximum(-local[:, 2], 1e-6)
    arm = local - origin
    zero = np.zeros_like(x)
    turning = np.cross(np.eye(3), arm[:, None]).transpose(0, 2, 1)  # columns of d x / d w
    size = np.linalg.norm(origin)
    shift = np.broadcast_to(size * np.eye(3), (len(x), 3, 3))
    focal = np.broadcast_to(np.array([0.0, 0.0, -size])[:, None], (len(x), 3, 1))
    local_motion = np.concatenate([turning, shift, focal], 2)  # (N, 3, 7)
    across = np.stack([camera.fx / depth, zero, camera.fx * x / depth**2], 1)
    down = np.stack([zero, -camera.fy / depth, -camera.fy * y / depth**2], 1)
    result = np.stack([across, down], 1) @ local_motion
    result[:, 0, 6] += camera.fx * x / depth
    result[:, 1, 6] -= camera.fy * y / depth
    return result


def mean_distance(camera: Camera, other: Camera, points: np.ndarray) -> float:
    """Return how far apart two cameras see points (N, 3), the mean in pixels."""
    return float(np.linalg.norm(camera.project(points)[:, :2] - other.project(points)[:, :2], axis=1).mean())


@dataclass(frozen=True)
class Turn:
    """A rotation about a point that brings a shape onto itself: one pose's copy may fit a photo as well."""

    rotation: np.ndarray  # (3, 3)
    center: np.ndarray  # (3,) normalised frame

    def copy(self, camera: Camera) -> Camera:
        """Return the camera that sees the turned object where `camera` sees it unturned."""
        pose = camera.camera_to_world.copy()
        pose[:3, :3] = self.rotation @ pose[:3, :3]
        pose[:3, 3] = self.rotation @ (camera.position - self.center) + self.center
        return replace(camera, camera_to_world=pose)


def symmetric_turns(mesh: Mesh) -> list[Turn]:
    """Return the turns, other than by nothing, that bring the surface of a mesh onto itself.

    A shape's axes of symmetry are among the principal axes of its surface, through its centroid. A turn
    counts when the turned surface stays near the unturned one, whatever is painted on it.
    """
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
