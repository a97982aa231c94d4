"""The weighted loss of Phase II (Equation 6).

Notation: E true light, P prediction, both (M, 3) radiance relative to the photo's light level (so their mean
is near 1); dw solid angles of the M texels; D_s, D_t the mean distribution of the sampled and of all object
pixels, (M,). Means in place of the printed sums change the loss by a factor that all photos share.

    loss = sum_w dw/4pi  (D_s/D_t)(w)  Y(E(w))  |g(E) - g(P)|^2

Y is the paper's |luma - .5| + .5 on the luma of E, where the photo's average light counts as .5 and
twice that or more as white: the paper's maps live in [0, 1], ours do not, and unclamped a sun would own the
loss twice over. g is the identity (the paper) or log(1 + x). Texels count by solid angle, since those of a
cubemap differ by a factor of five.

With `RadianceUnit.PHOTO` E and P are radiance in the photo's exposure and Y is the printed one, and without
`solid_angle_weight` every texel counts one: the paper to the letter.
"""

import math

import torch
from torch import Tensor

from lightprobe.core.config.distillation import LossSpace, RadianceUnit
from lightprobe.light.photometry import luma


def sample_weight(sampled: Tensor, total: Tensor) -> Tensor:
    """Return D_s/D_t (M,), and 0 where no pixel of the object looks."""
    return torch.where(total > 0, sampled / total.clamp_min(1e-12), torch.zeros_like(total))


def intensity_weight(target: Tensor, unit: RadianceUnit = RadianceUnit.LEVEL) -> Tensor:
    """Return Y (M,) of radiance (M, 3): in [.5, 1] where it is relative, from .5 up where it is the photo's."""
    if unit is RadianceUnit.PHOTO:
        return (luma(target) - 0.5).abs() + 0.5
    brightness = (luma(target) / 2).clamp(0, 1)
    return (brightness - 0.5).abs() + 0.5


def weighted_l2(
    predicted: Tensor, target: Tensor, weight: Tensor, solid_angle: Tensor, space: LossSpace
) -> Tensor:
    """Return the loss () of `predicted` against `target` (M, 3), both relative; `weight`, solid angles (M,)."""
    if space is LossSpace.LOG:
        predicted, target = torch.log1p(predicted), torch.log1p(target)
    squared = (predicted - target).square().sum(-1)
    return (squared * weight * solid_angle).sum() / (4 * math.pi)
