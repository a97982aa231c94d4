"""Inputs of the kernels at the sizes that matter; the tests' benchmarks and SPEED.md share them."""

import math

import torch
from torch import Tensor

from lightprobe.light import cubemap


def unit(count: int) -> Tensor:
    """Return random unit vectors (N, 3)."""
    return torch.nn.functional.normalize(torch.randn(count, 3), dim=1)


def probes(pixels: int = 1024, resolution: int = 64) -> tuple[Tensor, ...]:
    """Return colours, normals, views, alpha2 of pixels and 6 R^2 directions: 25 million pairs by default."""
    torch.manual_seed(0)
    normals, views = unit(pixels), unit(pixels)
    views = views * (normals * views).sum(dim=1, keepdim=True).sign()
    alpha2 = (0.08 + 0.92 * torch.rand(pixels)) ** 4
    return torch.rand(pixels, 3), normals, views, alpha2, unit(6 * resolution**2)


def sphere_pixels(across: int = 73) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    """Return colours, normals, views and alpha2 of a sphere's pixels in the order of a photo, mirrors to
    matte.
    """
    y, x = torch.meshgrid(torch.linspace(-1, 1, across), torch.linspace(-1, 1, across), indexing="ij")
    inside = x * x + y * y < 0.98
    x, y = x[inside], y[inside]
    normals = torch.stack([x, y, (1 - x * x - y * y).sqrt()], dim=1)
    views = torch.nn.functional.normalize(torch.tensor([0.0, 0.0, 4.0]) - normals, dim=1)
    roughness = (0.35 + 0.3 * torch.sin(5 * x) * torch.cos(4 * y)).clamp(0.08, 1)
    return torch.rand(len(x), 3), normals, views, roughness**4


def bumpy_sphere(rings: int = 143, size: int = 512) -> tuple[Tensor, Tensor]:
    """Return screen points (V, 3) and 81 796 faces (F, 3) that fill most of size x size pixels."""
    polar, around = (
        torch.linspace(0, math.pi, rings + 1)[:, None],
        torch.arange(2 * rings)[None] * math.pi / rings,
    )
    radius = 1 + 0.1 * torch.sin(5 * polar) * torch.cos(4 * around)
    x, y, z = radius * polar.sin() * around.cos(), radius * polar.cos(), radius * polar.sin() * around.sin()
    points = torch.stack([x, y, 3 - z], dim=2).reshape(-1, 3)
    screen = torch.cat([size / 2 + 1.15 * size * points[:, :2] / points[:, 2:], points[:, 2:]], dim=1)
    i, j = torch.meshgrid(torch.arange(rings), torch.arange(2 * rings), indexing="ij")
    below = 2 * rings
    a, b = i * below + j, i * below + (j + 1) % below
    faces = torch.cat([torch.stack([a, b, a + below], dim=2), torch.stack([b, b + below, a + below], dim=2)])
    return screen, faces.reshape(-1, 3).int()


def grid(points: int = 65_536) -> tuple[Tensor, Tensor, Tensor]:
    """Return points, a table of 8 levels of 2^17 rows of 2 features, and the levels' cells along each edge."""
    torch.manual_seed(0)
    cells = torch.tensor([int(12 * (256 / 12) ** (level / 7) + 1e-6) for level in range(8)])
    return torch.rand(points, 3), torch.randn(8, 2**17, 2), cells


def taps(queries: int = 65_536) -> tuple[Tensor, Tensor, Tensor]:
    """Return 32 768 rows of 3 channels, and index and weight of 8 of them for each query."""
    torch.manual_seed(0)
    index = torch.randint(0, 32768, (queries, 8), dtype=torch.int32)
    return torch.randn(32768, 3), index, torch.rand(queries, 8)


def shadowed(pixels: int = 12_288, rows: int = 10_242, corners: int = 3) -> tuple[Tensor, ...]:
    """Return light, normals, visibility, index, weight, directions and angles of `kernels.occluded_light`."""
    torch.manual_seed(0)
    directions, angles = cubemap.directions(8).reshape(-1, 3), cubemap.solid_angles(8).reshape(-1)
    visibility = torch.randint(0, 256, (rows, len(directions)), dtype=torch.uint8)
    index = torch.randint(0, rows, (pixels, corners), dtype=torch.int32)
    weight = torch.rand(pixels, corners)
    weight = weight / weight.sum(1, keepdim=True)
    return torch.rand(len(directions), 3), unit(pixels), visibility, index, weight, directions, angles
