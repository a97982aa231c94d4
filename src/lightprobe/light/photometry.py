"""What photos say about light, each formula once: tone curve, weights of errors, clipping, brightness.

Colours are linear radiance, float tensors whose last axis is red, green, blue unless a function says
otherwise.

The tone curve T(x) = sRGB(log(1 + x)) keeps highlights from owning a sum of errors (Munkberg et al. 2022,
section 3.4). Weights of linear errors are made of (x + .02)^-.55, which has the shape of its slope within a
factor of six from 0 to 1 and falls less steeply.
"""

import functools

import torch
from torch import Tensor

from lightprobe.imaging.color import srgb_encode

USUAL_MEAN = 0.22  # linear mean of a well-exposed object
_LUMA = (0.299, 0.587, 0.114)  # the paper's weights (Equation 6)
_TOE, _SLOPE = 0.02, -0.55  # of the tone curve's slope
_DARK = 0.05  # relative to the light level: darker pixels weigh no more


def tone_map(linear: Tensor) -> Tensor:
    """Return T(x) = sRGB(log(1 + x)) of linear values of any shape; negative values count as zero."""
    return srgb_encode(torch.log1p(linear.clamp(min=0)))


def tone_slope(linear: Tensor) -> Tensor:
    """Return about the slope of `tone_map` at linear values of any shape, up to a common factor."""
    return (linear.clamp(min=0) + _TOE) ** _SLOPE


def tone_weight(linear: Tensor) -> Tensor:
    """Return the square of `tone_slope` at linear values of any shape: the weight of a squared linear error."""
    return (linear.clamp(min=0) + _TOE) ** (2 * _SLOPE)


def relative_tone_weight(color: Tensor, light_level: Tensor) -> Tensor:
    """Return weights (N,) of squared linear errors of colours (N, 3), of about one size at any exposure.

    They make errors count as in a tone-mapped picture. light_level (): grey radiance that lights the photo as
    brightly.
    """
    return (color.mean(-1) / light_level + _DARK).reciprocal()


def beyond_clipping(render: Tensor, photo: Tensor, clipped: Tensor) -> Tensor:
    """Return where (bool) the render is brighter than a photo `clipped` (bool); all of any one shape.

    A saturated pixel only says that the light was at least this strong.
    """
    return clipped & (render > photo)


def one_sided(render: Tensor, photo: Tensor, clipped: Tensor) -> Tensor:
    """Replace `render` by `photo` where it is beyond clipping; `clipped` (bool); all of any one shape."""
    return torch.where(beyond_clipping(render, photo, clipped), photo, render)


def one_sided_residual(render: Tensor, photo: Tensor, clipped: Tensor) -> Tensor:
    """Return render - photo, zero where the render is beyond clipping; all of any one shape, `clipped` bool."""
    return one_sided(render, photo, clipped) - photo


def displayed_error(render: Tensor, photo: Tensor, clipped: Tensor) -> Tensor:
    """Return the mean absolute tone-mapped difference () of colours (N, 3), one-sided where `clipped`."""
    return (tone_map(one_sided(render, photo, clipped)) - tone_map(photo)).abs().mean()


def exposure_unit(color: Tensor) -> Tensor:
    """Return the radiance () by which linear colours (N, 3) are divided to look well exposed."""
    return color.mean().clamp(min=1e-9) / USUAL_MEAN


def luma(rgb: Tensor) -> Tensor:
    """Return .299 R + .587 G + .114 B of (..., 3), as (...)."""
    return (rgb * _luma_weights(rgb.device, rgb.dtype)).sum(-1)


@functools.lru_cache(maxsize=8)
def _luma_weights(device: torch.device, dtype: torch.dtype) -> Tensor:
    return torch.tensor(_LUMA, dtype=dtype, device=device)
