"""A transport that is a matrix of numbers, for tests of what inverts one."""

import functools

import torch
from torch import Tensor

from lightprobe.render.transport import Transport


class DenseTransport(Transport):
    """The operator of matrices (3, P, 6 R^2), one per channel."""

    def __init__(self, matrix: Tensor):
        self.matrix = matrix
        self.resolution = round((matrix.shape[2] / 6) ** 0.5)

    @staticmethod
    def random(pixels: int, resolution: int, seed: int = 0) -> "DenseTransport":
        """Return one of float64 whose pixels look at a few texels each, most of them at the first faces."""
        random = torch.Generator().manual_seed(seed)
        texels = 6 * resolution**2
        entries = torch.rand(3, pixels, texels, generator=random, dtype=torch.float64) ** 6
        return DenseTransport(entries * torch.linspace(1.0, 0.1, texels, dtype=torch.float64) / resolution)

    def apply(self, env: Tensor) -> Tensor:
        """Return the radiance (P, 3) under the light env (6, R, R, 3)."""
        return torch.einsum("cpk,kc->pc", self.matrix, env.reshape(-1, 3))

    def adjoint(self, radiance: Tensor) -> Tensor:
        """Return the transpose of `apply` on (P, 3): (6, R, R, 3)."""
        texels = torch.einsum("cpk,pc->kc", self.matrix, radiance)
        return texels.reshape(6, self.resolution, self.resolution, 3)

    @functools.cached_property
    def white(self) -> Tensor:
        """The radiance (P, 3) under a light of 1 everywhere."""
        return self.matrix.sum(2).T
