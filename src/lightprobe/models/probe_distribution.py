"""The distribution of a light probe: from which directions the light came that a pixel reflects.

Notation (design of Equation 4): n unit normal, w_o unit direction surface -> camera, w unit direction surface
-> light, h = (w + w_o)/|w + w_o|, r roughness, alpha^2 the squared GGX width.

    D_p(w) = alpha^2 / (pi ((n.h)^2 (alpha^2 - 1) + 1)^2) max(n.w, 0)

The printed equation has ((w_o + w_i)/2)^2 where the GGX density it cites has (n.h)^2, and w_o.n where the
rendering equation has w_i.n; the density is meant. It also prints r^2 for alpha^2, where the renderer's alpha
is r^2 and alpha^2 is r^4: the lobe that mirrors the renderer's is the default, the printed one an option.
"""

import torch
from torch import Tensor

from lightprobe import kernels
from lightprobe.core.config.distillation import AlphaRule, TotalDistribution
from lightprobe.light.culled_stacking import stack_on_cubemap
from lightprobe.models.probe_pixels import ProbePixels

_CHUNK = 2048  # pixels
_LEAST_ROUGHNESS = 0.08  # the renderer's own floor; below it a lobe is narrower than any texel


def alpha2(roughness: Tensor, rule: AlphaRule) -> Tensor:
    """Return the squared GGX width of roughness (any shape)."""
    r = roughness.clamp(_LEAST_ROUGHNESS, 1)
    return r**4 if rule is AlphaRule.R4 else r**2


def mean_distribution(pixels: ProbePixels, directions: Tensor, rule: AlphaRule) -> Tensor:
    """Return the mean of D_p over the pixels in each of `directions` (M, 3): (M,), per steradian."""
    total = kernels.probe_weight(pixels.normal, pixels.view, alpha2(pixels.roughness, rule), directions)
    return total / max(len(pixels), 1)


def total_distribution(
    pixels: ProbePixels, directions: Tensor, rule: AlphaRule, total: TotalDistribution, samples: int
) -> Tensor:
    """Return D_total of Equation 6 in `directions` (M, 3): (M,), the divisor of the mean over `samples` pixels."""
    mean = mean_distribution(pixels, directions, rule)
    if total is TotalDistribution.SUM:
        return mean * (len(pixels) / min(samples, len(pixels)))
    if total is TotalDistribution.PER_DIRECTION:
        facing = sum(((normal @ directions.T) > 0).sum(0) for normal in pixels.normal.split(_CHUNK))
        return mean * len(pixels) / torch.as_tensor(facing, device=mean.device).clamp(min=1)
    return mean


def stack(pixels: ProbePixels, colors: Tensor, directions: Tensor, rule: AlphaRule) -> tuple[Tensor, Tensor]:
    """Stack the probes of `pixels` with `colors` (N, 3) into radiance (M, 3) and mean distribution (M,):
    Equation 5.

    P(w) = sum_p c_p D_p(w) / sum_p D_p(w); zero where no pixel looks. Differentiable in `colors`.
    """
    radiance, total = kernels.stack_probes(
        colors, pixels.normal, pixels.view, alpha2(pixels.roughness, rule), directions
    )
    return radiance, total / max(len(pixels), 1)


def stack_everywhere(
    pixels: ProbePixels, colors: Tensor, resolution: int, rule: AlphaRule
) -> tuple[Tensor, Tensor]:
    """Return `stack` in all texels of a cubemap: radiance (6, R, R, 3) and mean distribution (6, R, R).

    For many pixels and texels: not differentiable, and within the bound of `kernels.culled_stacking`.
    """
    lobes = pixels.normal, pixels.view, alpha2(pixels.roughness, rule)
    radiance, total = stack_on_cubemap(colors, *lobes, resolution)
    return radiance, total / max(len(pixels), 1)
