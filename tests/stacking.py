"""Pixels for the tests of culled stacking, in the kernel and on a cubemap."""

import math

import torch
from torch import Tensor


def unit(count: int, random: torch.Generator) -> Tensor:
    return torch.nn.functional.normalize(torch.randn(count, 3, generator=random), dim=1)


def pixels(
    roughness: Tensor, *, seed: int = 0, tilt: float | None = None
) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    """Return colours, normals, views and alpha^2; `tilt` is the cosine between normal and view, random by
    default.
    """
    random = torch.Generator().manual_seed(seed)
    count = len(roughness)
    normals, views = unit(count, random), unit(count, random)
    if tilt is None:
        views = views * (normals * views).sum(dim=1, keepdim=True).sign()
    else:
        across = torch.nn.functional.normalize(torch.linalg.cross(normals, views), dim=1)
        views = tilt * normals + math.sqrt(1 - tilt * tilt) * across
    colors = torch.eye(3)[torch.arange(count) % 3] * 4 * torch.rand(count, 1, generator=random)
    return colors, normals, views, roughness**4
