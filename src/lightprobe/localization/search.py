"""Where in a photo a known object may stand, and how: templates compared at every place and size, under any light.

At a place and size, with N template pixels on the object and y the photo's appearance less the template's:

    left   = |y - mean(y) - U U^T y|^2 / N       what no light explains; for the tints U is empty
    spread = |l - mean(l)|^2 / N                 what the photo shows there at all
    score  = sqrt(N) sum_channels w log((spread + noise^2) / (left + noise^2)) / 2 + w_edges cos(2 angle to the outline)

A featureless part of the background is explained by every object, but there is nothing to explain in it.
"""

from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from lightprobe.imaging import resize_area
from lightprobe.localization.appearance import appearance, edge_field
from lightprobe.localization.pose import least_rotation
from lightprobe.localization.templates import SIDE, Templates
from lightprobe.scene.camera import Camera

_SMALLEST, _LARGEST = 0.3, 1.35  # side of a template in the photo's longer side
_STEP = 1.14  # from one size to the next
_STRIDE = 2  # template pixels between places
_OUTSIDE = 8  # template pixels by which the object's sphere may leave the photo
_NOISE = (0.20, 0.10, 0.10)  # of the appearance that even the right template leaves
_WEIGHT = (1.0, 0.5, 0.5)  # of the channels
_TINT = 0.5  # usual size of the tint of a light, as a logarithm
_EDGES = 12.0  # weight of the outline's agreement


@dataclass(frozen=True)
class Sighting:
    """A place where a template fits."""

    score: float
    view: int  # of the templates
    center: tuple[float, float]  # of the template in the photo, in pixels of its longer side 1
    side: float  # of the template, likewise


def search(color: np.ndarray, templates: Templates, count: int) -> list[Sighting]:
    """Return the `count` best sightings in a linear photo `color` (H, W, 3), best first; one for each view
    and place.

    They are distinct: of the same view at most one within a quarter of its side.
    """
    longest = max(color.shape[:2])
    bank = _Bank.of(templates)
    found: list[Sighting] = []
    side = _SMALLEST
    while side <= _LARGEST:
        scale = SIDE / (side * longest)
        found += _at_size(color, bank, scale, side)
        side *= _STEP
    found.sort(key=lambda sighting: -sighting.score)
    return _distinct(found, count)


def sighted_camera(sighting: Sighting, templates: Templates, focal: float, width: int, height: int) -> Camera:
    """Return the normalised-frame camera, of a focal length in pixels, that sees the object as a sighting
    does.

    Around the object's origin the photo then looks as the template does, at the template's place and size.
    """
    longest = max(width, height)
    pose = templates.camera[sighting.view].double().numpy()
    x = (sighting.center[0] * longest - 0.5 * width) / focal
    y = (sighting.center[1] * longest - 0.5 * height) / focal
    ray = np.array([x, -y, -1.0])
    ray /= np.linalg.norm(ray)
    turn = least_rotation(
        np.array([0.0, 0.0, -1.0]), ray
    )  # camera axes: from the middle of the photo to the object
    half = 0.5 * sighting.side * longest / focal  # tangent of the template's half side
    distance = np.linalg.norm(pose[:3, 3]) * float(templates.tangent[sighting.view]) / half
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
        return _Bank(
            mask,
            mean,
            offset[:, 1:].T,
            lights.permute(2, 1, 0).flatten(1).contiguous(),
            along,
            templates.edges.float().flatten(2).permute(1, 2, 0).contiguous(),
        )


def _at_size(color: np.ndarray, bank: _Bank, scale: float, side: float) -> list[Sighting]:
    """Return the best place of every view, and the second best, at one size."""
    height, width = (max(4, round(length * scale)) for length in color.shape[:2])
    small = appearance(torch.from_numpy(resize_area(color, height, width))).numpy()
    field = edge_field(small)
    planes = np.concatenate([small, field], 2)
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
            found.append(Sighting(float(score[view]), view, (x, y), side))
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


def _distinct(found: list[Sighting], count: int) -> list[Sighting]:
    chosen: list[Sighting] = []
    for sighting in found:
        near = (
            other.view == sighting.view
            and np.hypot(*np.subtract(other.center, sighting.center)) < 0.25 * other.side
            for other in chosen
        )
        if not any(near):
            chosen.append(sighting)
        if len(chosen) == count:
            break
    return chosen
