"""Small pictures of the object from many sides, and where in a photo they fit: at every place and size, in
any light.

For a view of P object pixels, and the appearance of `localization.appearance`:

    l(E) ~ t + U e + c     t: log luma under a constant light, U (P, K): orthonormal changes of log luma by light

K directions span most of what lights of 6 x 2 x 2 texels do, to first order about the constant light. What of
a photo's log luma lies outside of U and of a constant, no light explains. At a place and size, with N
template pixels on the object and y the photo's appearance less the template's:

    left   = |y - mean(y) - U U^T y|^2 / N       what no light explains; for the tints U is empty
    spread = |l - mean(l)|^2 / N                 what the photo shows there at all
    score  = sqrt(N) sum_channels w log((spread + noise^2) / (left + noise^2)) / 2 + w_edges cos(2 angle)

with the angle between the photo's edges and the template's outline. A featureless part of the background is
explained by every object, but there is nothing to explain in it.
"""

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy
import torch
from torch import Tensor

from lightprobe.imaging import resize_area
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
_COVERED = 0.5  # of a pixel, from which it is the object's
_SMALLEST, _LARGEST = 0.3, 1.35  # side of a template in the photo's longer side
_STEP = 1.14  # from one size to the next
_STRIDE = 2  # template pixels between places
_OUTSIDE = 8  # template pixels by which the object's sphere may leave the photo
_NOISE = (0.20, 0.10, 0.10)  # of the appearance that even the right template leaves
_WEIGHT = (1.0, 0.5, 0.5)  # of the channels
_TINT = 0.5  # usual size of the tint of a light, as a logarithm
_EDGES = 12.0  # weight of the outline's agreement


@dataclass(frozen=True)
class Templates:
    """V views of the object, its origin in the middle of each picture; pixels outside the object are 0."""

    camera: Tensor  # (V, 4, 4) float32 camera to world, normalised frame
    tangent: Tensor  # (V,) float32 half the picture's side over the focal length
    mask: Tensor  # (V, S, S) uint8, 1 on the object
    mean: Tensor  # (V, 3, S, S) float16 appearance under a constant light
    lights: Tensor  # (V, K, S, S) float16 orthonormal changes of log luma by light, without their mean
    edges: Tensor  # (V, 2, S, S) float16 direction of the outline, doubled, of total length 1


def make_templates(asset: Asset, cameras: Sequence[Camera], device: torch.device) -> Templates:
    """Return the templates of the asset from the sides at which normalised-frame `cameras` look at it."""
    views = [centred(camera) for camera in cameras]
    made = [_template(asset, view, device) for view in views]
    poses = torch.as_tensor(np.stack([view.camera_to_world for view in views]), dtype=torch.float32)
    tangents = torch.tensor([0.5 * view.width / view.fx for view in views], dtype=torch.float32)
    parts = (torch.stack(part) for part in zip(*made, strict=True))
    return Templates(poses, tangents, *parts)


def centred(camera: Camera) -> Camera:
    """Return a camera at the place of `camera`, rolled as it is, that looks at the origin and sees all."""
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


def views_around(cameras: Sequence[Camera], spacing: float = 11.0, reach: float = 20.0) -> list[Camera]:
    """Return views of the origin about `spacing` degrees apart, within `reach` degrees of a given camera.

    Each has the distance and the roll of the nearest of the normalised-frame `cameras`.
    """
    count = round(4 * np.pi / np.radians(spacing) ** 2)
    height = 1 - (2 * np.arange(count) + 1) / count
    angle = np.arange(count) * np.pi * (3 - np.sqrt(5))  # the golden angle: a spiral that covers evenly
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
    coarse = CoarseTransport.of(gbuffer).broader(2).cpu()
    grid = _averaged(coarse.permute(1, 0, 2).flatten(1), gbuffer.pixel.cpu(), view.width)
    mask = grid[-1] >= _COVERED
    rows, columns = mask.nonzero(as_tuple=True)
    inside = (grid[:-1, rows, columns] / grid[-1, rows, columns]).T.unflatten(1, (3, -1))  # (P, 3, 24)
    white = inside.sum(2)
    white = white * (USUAL_MEAN / white.mean().clamp(min=1e-6))
    shades = luma(inside.transpose(1, 2)) / luma(inside.sum(2)).clamp(min=1e-6)[:, None]
    changes = torch.linalg.svd(shades - shades.mean(0), full_matrices=False).U[:, :LIGHTS]
    mean, lights = torch.zeros(3, SIDE, SIDE), torch.zeros(LIGHTS, SIDE, SIDE)
    mean[:, rows, columns] = appearance(white).T
    lights[: changes.shape[1], rows, columns] = changes.T
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
    total = max(float(length[length >= 0.3].sum()), 1e-6)
    return torch.from_numpy(field / total).permute(2, 0, 1).contiguous()


@dataclass(frozen=True)
class Detection:
    """A view of the object found in a photo, before any refinement."""

    score: float
    view: int  # of the templates
    center: tuple[float, float]  # of the template in the photo, in pixels of its longer side 1
    side: float  # of the template, likewise


def search(color: np.ndarray, templates: Templates, count: int) -> list[Detection]:
    """Return the `count` best detections in a linear photo `color` (H, W, 3), best first.

    Detections of the same view lie at least a quarter of the template's side apart.
    """
    bank, side = _Bank.of(templates), _SMALLEST
    found: list[Detection] = []
    while side <= _LARGEST:
        found += _at_size(color, bank, SIDE / (side * max(color.shape[:2])), side)
        side *= _STEP
    found.sort(key=lambda detection: -detection.score)
    return _distinct(found, count)


def detected_camera(
    detection: Detection, templates: Templates, focal: float, width: int, height: int
) -> Camera:
    """Return the normalised-frame camera, focal length in pixels, that sees the object as detected.

    Around the object's origin the photo then looks as the template does, at the template's place and size.
    """
    longest = max(width, height)
    pose = templates.camera[detection.view].double().numpy()
    x = (detection.center[0] * longest - 0.5 * width) / focal
    y = (detection.center[1] * longest - 0.5 * height) / focal
    ray = np.array([x, -y, -1.0])
    ray /= np.linalg.norm(ray)
    turn = least_rotation(np.array([0.0, 0.0, -1.0]), ray)  # from the middle of the photo to the object
    half = 0.5 * detection.side * longest / focal  # tangent of the template's half side
    distance = np.linalg.norm(pose[:3, 3]) * float(templates.tangent[detection.view]) / half
    moved = np.eye(4)
    moved[:3, :3] = pose[:3, :3] @ turn.T
    moved[:3, 3] = -distance * (moved[:3, :3] @ ray)
    return Camera(moved, focal, focal, 0.5 * width, 0.5 * height, width, height)


@dataclass(frozen=True)
class _Bank:
    """Templates as the columns of products; S^2 rows."""

    mask: Tensor  # (S^2, V)
    mean: Tensor  # (3, S^2, V) less its own mean on the mask
    offset: Tensor  # (2, V) that mean of the tints
    lights: Tensor  # (S^2, K V)
    along: Tensor  # (K, V) products of `lights` with `mean`
    edges: Tensor  # (2, S^2, V)

    @staticmethod
    def of(templates: Templates) -> "_Bank":
        mask = templates.mask.float().flatten(1).T.contiguous()
        mean = templates.mean.float().flatten(2)  # (V, 3, S^2)
        offset = mean.sum(2) / mask.sum(0)[:, None]  # (V, 3)
        mean = ((mean - offset[..., None]) * mask.T[:, None]).permute(1, 2, 0).contiguous()
        lights = templates.lights.float().flatten(2)  # (V, K, S^2)
        along = torch.einsum("vks,sv->kv", lights, mean[0])
        edges = templates.edges.float().flatten(2).permute(1, 2, 0).contiguous()
        return _Bank(
            mask, mean, offset[:, 1:].T, lights.permute(2, 1, 0).flatten(1).contiguous(), along, edges
        )


def _at_size(color: np.ndarray, bank: _Bank, scale: float, side: float) -> list[Detection]:
    """Return the best place of every view, and the second best, at one size."""
    height, width = (max(4, round(length * scale)) for length in color.shape[:2])
    small = appearance(torch.from_numpy(resize_area(color, height, width))).numpy()
    planes = np.concatenate([small, edge_field(small)], 2)
    padded = np.pad(planes, ((_OUTSIDE, _OUTSIDE), (_OUTSIDE, _OUTSIDE), (0, 0)), mode="edge")
    if min(padded.shape[:2]) < SIDE:
        return []
    patches = torch.from_numpy(np.ascontiguousarray(padded.transpose(2, 0, 1)))
    patches = patches.unfold(1, SIDE, _STRIDE).unfold(2, SIDE, _STRIDE)
    rows, columns = patches.shape[1:3]
    scores = _scores(patches.reshape(5, rows * columns, SIDE * SIDE), bank)  # (positions, V)
    best = scores.topk(min(2, len(scores)), dim=0)
    found = []
    for score, place in zip(best.values, best.indices, strict=True):
        for view in range(scores.shape[1]):
            row, column = divmod(int(place[view]), columns)
            x, y = ((step * _STRIDE - _OUTSIDE + 0.5 * SIDE) / SIDE * side for step in (column, row))
            found.append(Detection(float(score[view]), view, (x, y), side))
    return found


def _scores(patches: Tensor, bank: _Bank) -> Tensor:
    """Return the scores (M, V) of patches (5, M, S^2): appearance and edges."""
    count = bank.mask.sum(0)
    total = torch.zeros(patches.shape[1], bank.mask.shape[1])
    for channel in range(3):
        patch = patches[channel]
        middle = patch.mean(1, keepdim=True)  # keeps squares small
        patch = patch - middle
        mean = patch @ bank.mask / count
        spread = (patch.square() @ bank.mask / count - mean.square()).clamp(min=0)
        left = spread * count - 2 * (patch @ bank.mean[channel]) + bank.mean[channel].square().sum(0)
        if channel == 0:
            ways = (patch @ bank.lights).unflatten(1, (-1, bank.mask.shape[1])) - bank.along
            left = left - ways.square().sum(1)
        else:
            tint = mean + middle - bank.offset[channel - 1]
            total -= _WEIGHT[channel] * 0.5 * (tint / _TINT).square().clamp(max=9)
        noise = _NOISE[channel] ** 2
        gain = (spread + noise) / (left.clamp(min=0) / count + noise)
        total += _WEIGHT[channel] * 0.5 * count.sqrt() * gain.log()
    agreement = patches[3] @ bank.edges[0] + patches[4] @ bank.edges[1]
    return total + _EDGES * agreement


def _distinct(found: list[Detection], count: int) -> list[Detection]:
    chosen: list[Detection] = []
    for detection in found:
        same = [other for other in chosen if other.view == detection.view]
        away = (np.hypot(*np.subtract(one.center, detection.center)) - 0.25 * one.side for one in same)
        if all(distance >= 0 for distance in away):
            chosen.append(detection)
        if len(chosen) == count:
            break
    return chosen
