"""Brightness and contrast of a solved light, fitted once more without its prior and in displayed values.

A regularised least-squares light is too dim and too flat, as it is pulled towards its mean. While the
material is being fitted that matters: too dim a light pushes on to brighter colours and too flat a one to
sharper lobes, visit by visit.
"""

import torch
from torch import Tensor

from lightprobe.light.photometry import beyond_clipping, exposure_unit, tone_slope
from lightprobe.render.transport import LitPixels, Transport

_ROUNDS = 6  # of iteratively reweighted least squares
_FLOOR = 0.005  # displayed error below which all pixels count alike
_LEAST, _MOST = 0.5, 2.0  # a light is never changed by more


@torch.no_grad()
def refit_contrast(transport: Transport, solved: LitPixels, observed: Tensor, clipped: Tensor) -> Tensor:
    """Return the light a m + b (E - m) >= 0 of the `solved` one E (6, R, R, 3) with m its mean colour.

    a per channel, and one b for all three, minimise the sum of absolute displayed errors of the pixels
    `observed` (P, 3) linear; where `clipped` (P, 3) bool, a brighter render is no error. Scales with the
    photo's exposure.
    """
    unit = exposure_unit(observed)  # errors are compared as if the photo were well exposed
    light, color = solved.light, solved.light.mean((0, 1, 2))
    mean = color * transport.white / unit
    varying = solved.radiance / unit - mean
    target = observed / unit
    a, b = torch.ones(3, device=light.device), torch.ones((), device=light.device)
    for _ in range(_ROUNDS):
        render = (a * mean + b * varying).clamp(min=0)
        slope = tone_slope(render)
        weight = slope.square() / (slope * (render - target).abs() + _FLOOR)
        weight = torch.where(beyond_clipping(render, target, clipped), 0.0, weight)
        color_factor, contrast = _least_squares(mean, varying, target, weight)
        told = weight.sum(0) > 0  # (3,): where all is clipped as it should be, nothing asks for a change
        a, b = torch.where(told, color_factor, a), torch.where(told.any(), contrast, b)
    return (a * color + b * (light - color)).clamp(min=0)


def _least_squares(mean: Tensor, varying: Tensor, wanted: Tensor, weight: Tensor) -> tuple[Tensor, Tensor]:
    """Return the bounded factors of `mean`, (3,), and `varying`, (), that explain `wanted`, all (P, 3)."""
    mm, mv = (weight * mean.square()).sum(0).clamp(min=1e-12), (weight * mean * varying).sum(0)
    vv = (weight * varying.square()).sum(0) + 1e-4 * mm  # a constant light has no contrast to fit
    mt, vt = (weight * mean * wanted).sum(0), (weight * varying * wanted).sum(0) + 1e-4 * mm
    # For any b the best a is (mt - b mv) / mm; put in, each channel's error is a parabola in b, and these add
    # up.
    steepness = (vv - mv.square() / mm).sum().clamp(min=1e-12)
    b = ((vt - mv * mt / mm).sum() / steepness).clamp(_LEAST, _MOST)
    return ((mt - b * mv) / mm).clamp(_LEAST, _MOST), b
