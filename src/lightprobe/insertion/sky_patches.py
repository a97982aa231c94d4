"""The sky over a horizontal ground as a few hundred patches of about equal irradiance, each of which casts
one shadow.

Median cut (Debevec, A Median Cut Algorithm for Light Probe Sampling, 2005): the equirectangular map above the
horizon is halved again and again where both halves weigh the same. The weight of a texel is its irradiance on
the ground plus a share of what a uniform sky would give, so that dark parts of the sky are not left to one
direction. A patch that a lamp or the sun makes strong is spread over directions within it, which gives its
shadow a penumbra.

    E_k = sum over the patch of L (d.z) dw,   a_k = sum of (d.z) dw,   sum of a_k = pi
"""

import math
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from lightprobe.imaging import LUMA
from lightprobe.light import equirect
from lightprobe.light.environment import Environment

CUTS = 8  # times the map is halved: 256 patches
_UNIFORM = 0.3  # weight of the uniform sky
_STRONG = 0.012  # share of the irradiance from which a patch is spread
_MOST = 24  # directions of one patch
_GOLDEN = math.pi * (3 - math.sqrt(5))


@dataclass(frozen=True)
class SkyPatches:
    """K patches of the sky."""

    direction: Tensor  # (K, 3) unit, z > 0
    irradiance: Tensor  # (K, 3) on the ground
    angle: Tensor  # (K,) projected solid angle
    strong: Tensor  # (K,) bool: its shadow has edges to be drawn finely

    @staticmethod
    def of(environment: Environment, cuts: int = CUTS) -> "SkyPatches":
        """Return the patches of a light, at most about 2^cuts, on its device."""
        image = environment.panorama().astype(np.float64)
        rows = image.shape[0] // 2
        direction = equirect.directions(image.shape[0])[:rows].numpy().astype(np.float64)
        solid = equirect.solid_angles(image.shape[0])[:rows].numpy().astype(np.float64)
        angle = direction[..., 2] * solid
        power = image[:rows] * angle[..., None]
        bright = power @ np.asarray(LUMA)
        weight = bright / max(bright.sum(), 1e-30) + _UNIFORM * angle / angle.sum()
        patches = [
            patch
            for window in _windows(weight, cuts)
            for patch in _directions(window, direction, power, angle, weight, solid, float(bright.sum()))
        ]
        columns = [
            torch.tensor(np.array(column)).to(environment.device) for column in zip(*patches, strict=True)
        ]
        return SkyPatches(columns[0].float(), columns[1].float(), columns[2].float(), columns[3])

    def total(self) -> Tensor:
        """Return the irradiance (3,) of ground that sees the whole sky."""
        return self.irradiance.sum(0)

    def select(self, rows: Tensor) -> "SkyPatches":
        """Return the patches where `rows` (K,) bool holds."""
        return SkyPatches(self.direction[rows], self.irradiance[rows], self.angle[rows], self.strong[rows])


_Window = tuple[slice, slice]


def _windows(weight: np.ndarray, cuts: int) -> list[_Window]:
    """Return 2^cuts rectangles of a map (H, W) of about equal weight; single texels are not cut further."""
    height, width = weight.shape
    windows: list[_Window] = [(slice(0, height), slice(0, width))]
    for _ in range(cuts):
        windows = [part for window in windows for part in _halves(window, weight)]
    return windows


def _halves(window: _Window, weight: np.ndarray) -> list[_Window]:
    rows, columns = window
    tall, wide = rows.stop - rows.start, columns.stop - columns.start
    if tall * wide <= 1:
        return [window]
    theta = math.pi * (0.5 * (rows.start + rows.stop)) / (2 * weight.shape[0])
    part = weight[window]
    if tall > 1 and (wide == 1 or tall >= wide * math.sin(theta)):
        cut = rows.start + _median(part.sum(1))
        return [(slice(rows.start, cut), columns), (slice(cut, rows.stop), columns)]
    cut = columns.start + _median(part.sum(0))
    return [(rows, slice(columns.start, cut)), (rows, slice(cut, columns.stop))]


def _median(weight: np.ndarray) -> int:
    """Return how many of the first entries weigh about as much as the rest; at least one on either side."""
    total = np.cumsum(weight)
    return int(np.argmin(np.abs(total[:-1] - 0.5 * total[-1]))) + 1


def _directions(
    window: _Window,
    direction: np.ndarray,
    power: np.ndarray,
    angle: np.ndarray,
    weight: np.ndarray,
    solid: np.ndarray,
    whole: float,
) -> list[tuple[np.ndarray, np.ndarray, float, bool]]:
    """Return direction, irradiance, projected angle and strength of a patch, several of a strong one."""
    energy, projected = power[window].sum((0, 1)), float(angle[window].sum())
    middle = (direction[window] * weight[window][..., None]).sum((0, 1))
    middle /= max(float(np.linalg.norm(middle)), 1e-12)
    share = float(energy @ np.asarray(LUMA)) / max(whole, 1e-30)
    if share < _STRONG:
        return [(middle, energy, projected, False)]
    count = min(_MOST, math.ceil(share / _STRONG) + 3)
    radius = math.sqrt(float(solid[window].sum()) / math.pi)
    across = np.cross(middle, [1.0, 0, 0] if abs(middle[0]) < 0.6 else [0, 1.0, 0])
    across /= np.linalg.norm(across)
    around = np.cross(middle, across)
    found = []
    for k in range(count):
        out, turn = radius * math.sqrt((k + 0.5) / count), _GOLDEN * k
        spread = middle + out * (math.cos(turn) * across + math.sin(turn) * around)
        spread[2] = max(spread[2], 1e-3)
        found.append((spread / np.linalg.norm(spread), energy / count, projected / count, True))
    return found
