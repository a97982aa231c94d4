"""From triangles and a camera to the visible surface points, differentiable in the vertex positions.

Visibility itself (which face a pixel sees) is not differentiable; the silhouette's motion enters through
`silhouette.coverage`, and the motion of points on the surface through the barycentric coordinates here.

Notation: P covered pixels in row-major order; everything in the normalised frame.
"""

from dataclasses import dataclass

import torch
from torch import Tensor

from lightprobe.kernels import gather_rows, rasterize, weighted_gather
from lightprobe.scene.camera import Camera
from lightprobe.scene.support import SupportPlane

_LOWEST = 0.02  # radii above its support that a point is taken to lie at least


@dataclass(frozen=True)
class View:
    """A camera as tensors on a device."""

    rotation: Tensor  # (3, 3) camera to world
    position: Tensor  # (3,)
    focal: Tensor  # (2,) pixels
    center: Tensor  # (2,) pixels
    width: int
    height: int
    support: Tensor | None = None  # (4,) normal and offset of the plane that the object stands on, if known

    @staticmethod
    def of(camera: Camera, device: torch.device, support: SupportPlane | None = None) -> "View":
        """Return the view of a normalised-frame camera, with the support in the same frame."""
        pose = torch.as_tensor(camera.camera_to_world, dtype=torch.float32, device=device)
        focal = torch.tensor([camera.fx, camera.fy], dtype=torch.float32, device=device)
        center = torch.tensor([camera.cx, camera.cy], dtype=torch.float32, device=device)
        plane = None
        if support is not None:
            plane = torch.tensor([*support.normal, support.offset], dtype=torch.float32, device=device)
        return View(pose[:3, :3], pose[:3, 3], focal, center, camera.width, camera.height, plane)

    def project(self, points: Tensor) -> Tensor:
        """Project points (V, 3) to (V, 3): pixel x, pixel y, depth (> 0 in front). Differentiable."""
        x, y, z = ((points - self.position) @ self.rotation).unbind(1)
        depth = -z
        inverse = 1 / torch.where(depth.abs() < 1e-6, torch.full_like(depth, 1e-6), depth)
        column = self.center[0] + self.focal[0] * x * inverse
        row = self.center[1] - self.focal[1] * y * inverse
        return torch.stack([column, row, depth], 1)

    def rays(self, pixel: Tensor) -> Tensor:
        """Return ray directions (P, 3) in world axes through centres of row-major pixels, not normalised."""
        row = torch.div(pixel, self.width, rounding_mode="floor")
        x, y = (place.to(self.focal.dtype) + 0.5 for place in (pixel % self.width, row))
        x, y = (x - self.center[0]) / self.focal[0], -(y - self.center[1]) / self.focal[1]
        return torch.stack([x, y, -torch.ones_like(x)], 1) @ self.rotation.T


def from_center(direction: Tensor, position: Tensor, support: Tensor) -> Tensor:
    """Return where from the object's centre lies what rays meet, (P, 3), not normalised.

    A ray d, `direction` (P, 3), from the point p, `position` (P, 3) or (3,), falls on the plane n . x = o, `support` (4,),
    after t = (n . p - o) / -(n . d), at p + t d = t (d + p / t). What it does not fall on is far away, in the direction d
    itself.
    """
    normal, offset = support[:3], support[3]
    height = (position @ normal - offset).clamp(min=_LOWEST)
    share = (-(direction @ normal)).clamp(min=0) / height
    return direction + position * share[:, None]


@dataclass(frozen=True)
class Surface:
    """The visible points of a mesh."""

    pixel: Tensor  # (P,) int64
    face: Tensor  # (P,) int64
    barycentric: Tensor  # (P, 3)
    position: Tensor  # (P, 3)
    view: Tensor  # (P, 3) unit, from the surface to the camera

    def select(self, rows: Tensor) -> "Surface":
        """Return the points at `rows` (K,) int64."""
        return Surface(*(values[rows] for values in vars(self).values()))

    def interpolate(self, values: Tensor, faces: Tensor) -> Tensor:
        """Interpolate per-vertex `values` (V, C) over `faces` (F, 3) at the visible points, (P, C)."""
        return weighted_gather(values, faces[self.face], self.barycentric)


def visible_surface(vertices: Tensor, faces: Tensor, view: View, screen: Tensor | None = None) -> Surface:
    """Return the visible surface of a mesh (V, 3), (F, 3); differentiable in the vertices, not in visibility.

    screen (V, 3): `view.project(vertices)`, where the caller has it.
    """
    if screen is None:
        screen = view.project(vertices)
    visibility = rasterize(screen.detach(), faces, view.height, view.width)
    flat = visibility.face.reshape(-1)
    pixel = (flat >= 0).nonzero()[:, 0]
    face = flat[pixel].long()
    a, b, c = gather_rows(vertices, faces[face]).unbind(1)
    ray = view.rays(pixel)
    e1, e2, s = b - a, c - a, view.position - a
    p, q = torch.linalg.cross(ray, e2), torch.linalg.cross(s, e1)
    det = (p * e1).sum(1)
    inverse = 1 / torch.where(det.abs() < 1e-12, torch.full_like(det, 1e-12), det)
    # A pixel centre can miss its triangle by rounding; clamping keeps interpolation within the face.
    u = ((p * s).sum(1) * inverse).clamp(0, 1)
    v = torch.minimum(((q * ray).sum(1) * inverse).clamp(min=0), 1 - u)
    barycentric = torch.stack([1 - u - v, u, v], 1)
    position = barycentric[:, :1] * a + barycentric[:, 1:2] * b + barycentric[:, 2:] * c
    to_camera = torch.nn.functional.normalize(view.position - position, dim=1)
    return Surface(pixel, face, barycentric, position, to_camera)


def face_camera(normal: Tensor, to_camera: Tensor) -> Tensor:
    """Bend normals (P, 3) that look away from the camera just enough to be seen, and return unit vectors.

    Interpolated and mapped normals can point backwards at the rim, where shading would otherwise turn black.
    """
    facing = (normal * to_camera).sum(1, keepdim=True)
    bent = normal + (0.02 - facing).clamp(min=0) * to_camera
    return torch.nn.functional.normalize(bent, dim=1, eps=1e-12)
