"""A light's first nine spherical harmonics, plain or windowed.

Notation: the real orthonormal basis of Ramamoorthi and Hanrahan (2001), no Condon-Shortley signs, in the
order of `BASIS`, of a direction (x, y, z) in the light's own axes, z up:

    Y_00 = .282095    Y_1-1, Y_10, Y_11 = .488603 (y, z, x)
    Y_2-2, Y_2-1, Y_21 = 1.092548 (xy, yz, xz)    Y_20 = .315392 (3 z^2 - 1)    Y_22 = .546274 (x^2 - y^2)

    c_lm = w_l  integral of L Y_lm over the sphere,     L(d) is about  sum c_lm Y_lm(d)

The window w_l = (1 + cos(pi l / 3)) / 2 = 1, 3/4, 1/4 (Hann's; Sloan, Stupid Spherical Harmonics Tricks,
2008) keeps a small bright lamp from ringing. Irradiance over pi of a normal n is sum A_l / pi c_lm Y_lm(n),
A_l / pi = 1, 2/3, 1/4; divide by w_l first for the unwindowed one.
"""

import math

import torch
from torch import Tensor

from lightprobe.light import cubemap

BASIS = ("Y00", "Y1-1", "Y10", "Y11", "Y2-2", "Y2-1", "Y20", "Y21", "Y22")
WINDOW = tuple(0.5 * (1 + math.cos(math.pi * level / 3)) for level in range(3))
_LEVEL = (0, 1, 1, 1, 2, 2, 2, 2, 2)  # l of each


def basis(directions: Tensor) -> Tensor:
    """Return the nine functions (..., 9) at unit directions (..., 3)."""
    x, y, z = directions.unbind(-1)
    one, pi = torch.ones_like(x), math.pi
    first, second = math.sqrt(3 / (4 * pi)), math.sqrt(15 / (4 * pi))
    linear = [first * y, first * z, first * x]
    zonal, sectoral = math.sqrt(5 / (16 * pi)) * (3 * z * z - 1), math.sqrt(15 / (16 * pi)) * (x * x - y * y)
    quadratic = [second * x * y, second * y * z, zonal, second * x * z, sectoral]
    return torch.stack([math.sqrt(1 / (4 * pi)) * one, *linear, *quadratic], -1)


def harmonics(light: Tensor) -> Tensor:
    """Return the windowed coefficients (9, 3) of a light (6, R, R, 3)."""
    window = torch.tensor([WINDOW[level] for level in _LEVEL], dtype=torch.float64, device=light.device)
    return (window[:, None] * plain_harmonics(light).double()).float()


def plain_harmonics(light: Tensor, axes: Tensor | None = None) -> Tensor:
    """Return the coefficients (9, 3) of a light (6, R, R, 3), w_l = 1: those whose irradiance is the nearest.

    axes (3, 3): of the frame that they are for, each row one axis in the light's own frame; by default that frame.
    """
    resolution = light.shape[1]
    angle = cubemap.exact_solid_angles(resolution, light.device)[..., None]
    directions = cubemap.exact_directions(resolution, light.device)
    functions = basis(directions if axes is None else directions @ axes.to(directions).T)
    return torch.einsum("frcb,frck->bk", functions, light.double() * angle).float()
