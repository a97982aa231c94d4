"""Points to be shaded, a sky to shade them with, and their shading by the plain integral."""

import math

import torch

from lightprobe.light import cubemap
from lightprobe.render.gbuffer import GBuffer

R = 16


def sphere_gbuffer(
    count=1500, *, roughness=0.3, metallic=0.0, base=(0.7, 0.5, 0.3), dtype=torch.float32
) -> GBuffer:
    """Points of a unit sphere seen from far along +x."""
    disc = torch.rand(4 * count, 2, generator=torch.Generator().manual_seed(0), dtype=torch.float64) * 2 - 1
    disc = disc[disc.norm(dim=1) < 0.995][:count]  # uniform in the picture, as pixels are
    normal = torch.cat([(1 - disc.square().sum(1, keepdim=True)).sqrt(), disc], 1).to(dtype)
    ids = torch.arange(count)
    return GBuffer(
        height=1,
        width=count,
        pixel=ids,
        face=ids,
        position=normal,
        normal=normal,
        view=torch.tensor([1.0, 0, 0], dtype=dtype).expand(count, 3),
        base_color=torch.tensor(base, dtype=dtype).expand(count, 3),
        roughness=torch.full((count,), roughness, dtype=dtype),
        metallic=torch.full((count,), metallic, dtype=dtype),
    )


def any_gbuffer(count: int, dtype: torch.dtype = torch.float32) -> GBuffer:
    """Points of every material and view angle."""
    random = torch.Generator().manual_seed(2)
    normal, view = torch.nn.functional.normalize(
        torch.randn(2, count, 3, generator=random, dtype=dtype), dim=-1
    )
    view = view * (normal * view).sum(-1, keepdim=True).sign()
    material = torch.rand(count, 5, generator=random, dtype=dtype)
    ids = torch.arange(count)
    return GBuffer(
        height=1,
        width=count,
        pixel=ids,
        face=ids,
        position=normal,
        normal=normal,
        view=view,
        base_color=material[:, :3],
        roughness=0.08 + 0.92 * material[:, 3],
        metallic=material[:, 4],
    )


def sky(resolution: int) -> torch.Tensor:
    """A sky with a broad sun, a warm horizon and a dark ground: high contrast, no feature below a texel."""
    d = cubemap.directions(resolution)
    sun = torch.nn.functional.normalize(torch.tensor([0.6, 0.4, 0.5]), dim=0)
    glow = 20 * torch.exp(80 * ((d @ sun) - 1))
    up = torch.sigmoid(8 * d[..., 2])
    return (0.1 + up)[..., None] * torch.tensor([0.5, 0.7, 1.0]) + glow[..., None] * torch.tensor(
        [1.0, 0.9, 0.7]
    )


def turned(angle: float) -> torch.Tensor:
    """The rotation (3, 3) by an angle about the vertical."""
    cos, sin = math.cos(angle), math.sin(angle)
    return torch.tensor([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])


def brute_force(gbuffer: GBuffer, light: torch.Tensor) -> torch.Tensor:
    """The reflection integral of the exact BRDF by summation over a fine light (6, N, N, 3)."""
    resolution = light.shape[1]
    light_in = cubemap.directions(resolution).reshape(-1, 3).double()
    weight = cubemap.solid_angles(resolution).reshape(-1).double()
    radiance = light.reshape(-1, 3).double()
    out = []
    for i in range(len(gbuffer.pixel)):
        n, v, base = gbuffer.normal[i].double(), gbuffer.view[i].double(), gbuffer.base_color[i].double()
        m, alpha = float(gbuffer.metallic[i]), float(gbuffer.roughness[i]) ** 2
        nl, nv = (light_in @ n).clamp(min=0), float(n @ v)
        h = torch.nn.functional.normalize(light_in + v, dim=1)
        d = alpha**2 / (math.pi * ((h @ n) ** 2 * (alpha**2 - 1) + 1) ** 2)
        smith = (
            nl * math.sqrt(alpha**2 + (1 - alpha**2) * nv**2)
            + nv * (alpha**2 + (1 - alpha**2) * nl**2).sqrt()
        )
        f0 = 0.04 * (1 - m) + base * m
        f = f0 + (1 - f0) * ((1 - (h @ v).clamp(0, 1)) ** 5)[:, None]
        brdf = (1 - f) * base * (1 - m) / math.pi + f * (d * 0.5 / smith.clamp(min=1e-9))[:, None]
        out.append((brdf * (nl * weight)[:, None] * radiance).sum(0))
    return torch.stack(out)
