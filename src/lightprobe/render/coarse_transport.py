"""The photo as a linear function of a coarse light, written out as matrices, and the light that inverts them.

At 6 x 8 x 8 texels (eleven degrees) the operator A of `render.transport` is small enough to be stored, and the
least-squares light is found exactly within milliseconds. That light is blurred, and may be negative where the photo
contradicts itself: it is evidence for other estimates, not a prediction.
"""

import functools
import math
from dataclasses import dataclass

import torch
from torch import Tensor

from lightprobe.kernels import weighted_gather
from lightprobe.light import cubemap
from lightprobe.light import prefilter as prefilters
from lightprobe.light.prefilter import BLOCKS
from lightprobe.render.gbuffer import GBuffer
from lightprobe.render.split_sum import occlude, reflectance, specular_taps

TEXELS = 6 * BLOCKS**2


@dataclass(frozen=True)
class CoarseTransport:
    """The matrices (3, P, 384) from each channel of a light of 6 x 8 x 8 texels to P pixels; no autograd."""

    matrix: Tensor

    @staticmethod
    @torch.no_grad()
    def of(gbuffer: GBuffer, side: int = BLOCKS) -> "CoarseTransport":
        """Return the matrices of all pixels of a G-buffer.

        side: texels along a face; below 8 the matrices (3, P, 6 `side`^2) are those of `broader`, made faster.
        """
        operator, lobes = _dense_prefilter(gbuffer.normal.device, side)
        r = reflectance(gbuffer)
        sharp = weighted_gather(lobes, *specular_taps(r, gbuffer, operator))
        if gbuffer.visibility is None:
            wide = weighted_gather(lobes, *operator.diffuse_taps(gbuffer.normal))
            parts = [(r.specular, sharp), (r.diffuse, wide)]
        else:
            diffuse, ambient = gbuffer.visibility.weights(gbuffer.normal)
            lobe, bounce = occlude(gbuffer, r, diffuse.sum(1))
            parts = [(lobe * r.specular, sharp), (r.diffuse, _pooled(diffuse, side))]
            parts.append((bounce, _pooled(ambient, side)))
        matrix = torch.zeros(3, *sharp.shape, device=sharp.device)
        for factor, average in parts:
            for channel in range(3):
                matrix[channel].addcmul_(factor[:, channel, None], average)
        return CoarseTransport(matrix)

    def broader(self, side: int) -> Tensor:
        """Return the matrices (3, P, T) from lights of T = 6 `side`^2 texels, constant over blocks of the 384."""
        block = BLOCKS // side
        return self.matrix.unflatten(2, (6, side, block, side, block)).sum((4, 6)).flatten(2)

    def solve(self, observed: Tensor, weight: Tensor, level: Tensor, strengths: tuple[float, ...]) -> Tensor:
        """Return the lights (S, 384, 3) closest to `observed` (P, 3), pulled towards a grey `level` ().

        weight (P, 3) >= 0. The objective is `transport.solve_light`'s without bounds, with each of the `strengths`.
        """
        angle = cubemap.solid_angles(BLOCKS, observed.device).reshape(-1) / (4 * math.pi)
        lights = []
        for channel in range(3):
            a, w = self.matrix[channel], weight[:, channel] / weight[:, channel].sum().clamp(min=1e-12)
            white = a.sum(1)
            weighted = w[:, None] * a
            normal, right = weighted.T @ a, weighted.T @ (observed[:, channel] - level * white)
            gain = (w * white.square()).sum()
            for strength in strengths:
                factor = torch.linalg.cholesky(normal + torch.diag(strength * gain * angle + 1e-9))
                lights.append(torch.cholesky_solve(right[:, None], factor)[:, 0] + level)
        return torch.stack(lights, 1).reshape(TEXELS, 3, len(strengths)).permute(2, 0, 1).contiguous()


@functools.lru_cache(maxsize=4)
def _dense_prefilter(device: torch.device, side: int) -> tuple[prefilters.Prefilter, Tensor]:
    """Return the prefilter of the coarse light and its levels as a matrix (T, 6 `side`^2)."""
    operator = prefilters.cached(BLOCKS, device)
    return operator, _pooled(operator.dense_levels, side)


def _pooled(weights: Tensor, side: int) -> Tensor:
    """Return the sums (N, 6 `side`^2) of weights (N, 384) over the blocks of texels that make one broader texel."""
    if side == BLOCKS:
        return weights
    block = BLOCKS // side
    means = torch.nn.functional.avg_pool2d(weights.reshape(-1, 1, BLOCKS, BLOCKS), block)
    return (means * block**2).reshape(len(weights), -1)
