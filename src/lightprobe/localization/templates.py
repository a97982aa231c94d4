"""Small pictures of the object from many sides, each with the ways in which light can change it.

For a view of P object pixels, and the appearance of `localization.appearance`:

    l(E) ~ t + U e + c        t: log luma under a constant light, U (P, K): orthonormal log-luma changes by other lights

K directions span most of what lights of 6 x 2 x 2 texels do, to first order about the constant light. What of a photo's
log luma lies outside of U and of a constant, no light explains; that takes products with t and U, nothing else.
"""

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy
import torch
from torch import Tensor

from lightprobe.light.photometry import USUAL_MEAN, luma
from lightprobe.localization.appearance import appearance, edge_field
from lightprobe.localization.pose import least_rotation
from lightprobe.render.asset import Asset, rasterize_asset
from lightprobe.render.coarse_transport import CoarseTransport
from lightprobe.scene.camera import Camera

SIDE = 32  # pixels of a template: what a global search over places and sizes can afford
_FINE = 2  # rendered so many times larger, and averaged
_MARGIN = 1.06  # of a template's side over the diameter of the object's sphere
LIGHTS = 6  # ways of light; more explain the background as well
_BLOCKS = 8  # texels along a cubemap edge of the coarse transport
_COVERED = 0.5  # of a pixel, from which it is the object's


@dataclass(frozen=True)
class Templates:
    """V views of the object, the middle of the picture at the object's origin; pixels outside the object are
    0.
    """

    camera: Tensor  # (V, 4, 4) float32 camera to world, normalised frame
    tangent: Tensor  # (V,) float32 half the picture's side over the focal length
    mask: Tensor  # (V, S, S) uint8, 1 on the object
    mean: Tensor  # (V, 3, S, S) float16 appearance under a constant light
    lights: Tensor  # (V, K, S, S) float16 orthonormal changes of log luma by light, without their mean
    edges: Tensor  # (V, 2, S, S) float16 direction of the outline, doubled, of total length 1

    def tensors(self) -> dict[str, Tensor]:
        """Return all tensors by name."""
        return dict(vars(self))


def make_templates(asset: Asset, cameras: Sequence[Camera], device: torch.device) -> Templates:
    """Return the templates of the asset from the sides at which normalised-frame `cameras` look at it."""
    views = [centred(camera) for camera in cameras]
    made = [_template(asset, view, device) for view in views]
    poses = torch.as_tensor(np.stack([view.camera_to_world for view in views]), dtype=torch.float32)
    tangents = torch.tensor([0.5 * view.width / view.fx for view in views], dtype=torch.float32)
    parts = (torch.stack(part) for part in zip(*made, strict=True))
    return Templates(poses, tangents, *parts)


def centred(camera: Camera) -> Camera:
    """Return a camera at the same place that looks at the origin, not rolled against `camera`, and sees all
    of it.
    """
    distance = float(np.linalg.norm(camera.position))
    back = camera.position / distance
    right = np.cross(camera.camera_to_world[:3, 1], back)
    right /= np.linalg.norm(right)
    pose = np.eye(4)
    pose[:3, :3] = np.stack([right, np.cross(back, right), back], 1)
    pose[:3, 3] = camera.position
    side = SIDE * _FINE
    focal = 0.5 * side / (_MARGIN * np.sqrt(1 / max(distance**2 - 1, 0.1)))
    return Camera(pose, focal, focal, 0.5 * side, 0.5 * side, side, side)


def surrounding_views(cameras: Sequence[Camera], spacing: float = 11.0, reach: float = 20.0) -> list[Camera]:
    """Return views of the origin about `spacing` degrees apart, from wherever a camera is within `reach`
    degrees.

    Each has the distance and the roll of the nearest of the normalised-frame `cameras`.
    """
    count = round(4 * np.pi / np.radians(spacing) ** 2)
    height = 1 - (2 * np.arange(count) + 1) / count
    angle = (
        np.arange(count) * np.pi * (3 - np.sqrt(5))
    )  # the golden angle: a spiral that covers the sphere evenly
    across = np.sqrt(1 - height**2)
    spiral = np.stack([across * np.cos(angle), across * np.sin(angle), height], 1)
    distance = np.array([np.linalg.norm(camera.position) for camera in cameras])
    known = np.stack([camera.position for camera in cameras]) / distance[:, None]
    cosine = spiral @ known.T
    views = []
    for direction, nearest in zip(spiral, cosine.argmax(1), strict=True):
        if direction @ known[nearest] >= np.cos(np.radians(reach)):
            pose = cameras[nearest].camera_to_world.copy()
            pose[:3, :3] = least_rotation(known[nearest], direction) @ pose[:3, :3]
            pose[:3, 3] = distance[nearest] * direction
            views.append(dataclasses.replace(cameras[nearest], camera_to_world=pose))
    return views


def _template(asset: Asset, view: Camera, device: torch.device) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    """Return mask (S, S), mean (3, S, S), lights (K, S, S) and edges (2, S, S) of one view."""
    gbuffer = rasterize_asset(asset, view, device)
    matrix = CoarseTransport.of(gbuffer).matrix
    coarse = matrix.unflatten(2, (6, 2, _BLOCKS // 2, 2, _BLOCKS // 2)).sum((4, 6)).flatten(2).cpu()
    grid = _averaged(coarse.permute(1, 0, 2).flatten(1), gbuffer.pixel.cpu(), view.width)
    mask = grid[-1] >= _COVERED
    place = mask.nonzero(as_tuple=True)
    shown = (grid[:-1, place[0], place[1]] / grid[-1, place[0], place[1]]).T.unflatten(
        1, (3, -1)
    )  # (P, 3, 24)
    white = shown.sum(2)
    white = white * (USUAL_MEAN / white.mean().clamp(min=1e-6))
    shades = luma(shown.transpose(1, 2)) / luma(shown.sum(2)).clamp(min=1e-6)[:, None]
    changes = torch.linalg.svd(shades - shades.mean(0), full_matrices=False).U[:, :LIGHTS]
    mean, lights = torch.zeros(3, SIDE, SIDE), torch.zeros(LIGHTS, SIDE, SIDE)
    mean[:, place[0], place[1]] = appearance(white).T
    lights[: changes.shape[1], place[0], place[1]] = changes.T
    return mask.to(torch.uint8), mean.half(), lights.half(), _outline(mask.numpy()).half()


def _averaged(values: Tensor, pixel: Tensor, side: int) -> Tensor:
    """Return values (P, C) at `pixel` (P,), and last their coverage, averaged to (C + 1, S, S)."""
    grid = torch.zeros(side * side, values.shape[1] + 1)
    grid[pixel, :-1], grid[pixel, -1] = values, 1.0
    return grid.reshape(SIDE, _FINE, SIDE, _FINE, -1).mean((1, 3)).permute(2, 0, 1)


def _outline(mask: np.ndarray) -> Tensor:
    """Return the doubled direction (2, S, S) of a mask's outline, of total length 1."""
    soft = scipy.ndimage.gaussian_filter(mask.astype(np.float64), 0.7)
    field = edge_field(np.repeat(soft[..., None], 3, 2), 0.05)
    length = np.hypot(*np.moveaxis(field, 2, 0))
    field[length < 0.3] = 0
    return (
        torch.from_numpy(field / max(float(length[length >= 0.3].sum()), 1e-6)).permute(2, 0, 1).contiguous()
    )
