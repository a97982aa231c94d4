"""Brightness and contrast, at several scales, of a solved light: fitted once more without its prior.

A regularised least-squares light is too dim and too flat: it is pulled towards its mean, the more the finer a detail
is, and its pixel weights, taken from the photo, favour pixels that happen to be dark. While the material is being
fitted that matters, as these errors push it on, visit by visit: to brighter colours (on a chair with true material,
light 13 % too dim and contrast 29 % too low), and to sharper lobes, which make up for details the light has lost.
"""

import torch
from torch import Tensor

from lightprobe.light.resize import magnify_light, resize_light
from lightprobe.render.transport import Transport

_SCALES = (4, 8)  # texels along each edge of the cubemaps between whose details the contrast may differ
_ROUNDS = 6  # of iteratively reweighted least squares
_USUAL_MEAN = 0.22  # linear mean of a well-exposed object: errors are compared as if the photo were exposed so
_FLOOR = 0.005  # displayed error below which all pixels count alike
_LEAST, _MOST = 0.5, 2.0  # a light is never changed by more
_RIDGE = 1e-6  # of the brightness' curvature: what the photo says nothing about stays


@torch.no_grad()
def refit_contrast(transport: Transport, light: Tensor, observed: Tensor, clipped: Tensor) -> Tensor:
    """Return the light sum_k a_k E_k >= 0 of the parts of E = `light` (6, R, R, 3): its mean, and details by scale.

    The a_k, per channel, minimise the sum of absolute displayed errors of the pixels `observed` (P, 3) linear; where
    `clipped` (P, 3) bool, a brighter render is no error. Scales with the photo's exposure.
    """
    unit = observed.mean().clamp(min=1e-9) / _USUAL_MEAN
    parts = _by_scale(light)
    renders = torch.stack([transport.apply(part) for part in parts]) / unit  # (K, P, 3)
    target = observed / unit
    factors = torch.ones(len(parts), 3, device=light.device)
    for _ in range(_ROUNDS):
        render = (factors[:, None] * renders).sum(0).clamp(min=0)
        slope = (render + 0.02) ** -0.55  # of the tone curve, as in the image loss of Phase I
        weight = slope.square() / (slope * (render - target).abs() + _FLOOR)
        weight = torch.where(clipped & (render > target), 0.0, weight)
        factors = _least_squares(renders, target, weight)
    return sum(f * part for f, part in zip(factors, parts, strict=True)).clamp(min=0)


def _by_scale(light: Tensor) -> list[Tensor]:
    """Return the mean of a light and its details, coarse to fine; they sum to the light."""
    coarser = [light.mean((0, 1, 2)).expand_as(light)]
    coarser += [magnify_light(resize_light(light, side), light.shape[1]) for side in _SCALES if side < light.shape[1]]
    return [coarser[0], *(fine - coarse for coarse, fine in zip(coarser, [*coarser[1:], light], strict=True))]


def _least_squares(renders: Tensor, wanted: Tensor, weight: Tensor) -> Tensor:
    """Return the bounded factors (K, 3) of `renders` (K, P, 3) whose sum comes closest to `wanted` (P, 3)."""
    normal = torch.einsum("kpc,pc,lpc->ckl", renders, weight, renders)
    right = torch.einsum("kpc,pc,pc->ck", renders, weight, wanted)
    # The ridge pulls to 1, and makes a light without details solvable.
    ridge = _RIDGE * normal[:, :1, 0].clamp(min=1e-12)
    normal = normal + torch.diag_embed(ridge.expand_as(right))
    return torch.linalg.solve(normal, right + ridge).clamp(_LEAST, _MOST).T
