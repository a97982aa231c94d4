"""Directional integrals of the reflectance model, tabulated once and looked up with gradients.

The model is glTF's metallic-roughness one, single-scattering:

    f = (1 - F) c_diff / pi + F D V,   F = F0 + (1 - F0) (1 - v.h)^5
    c_diff = base (1 - m),   F0 = 0.04 (1 - m) + base m
    D = GGX of alpha = r^2,  V = height-correlated Smith visibility

n normal, v direction to the camera, l to the light, h their half vector; all unit. Under a light of constant
radiance 1 the specular part reflects F0 A + B and the diffuse part c_diff (1 - F0) (1 - C):

    A = int (1 - (1 - v.h)^5) D V n.l dl,   B = int (1 - v.h)^5 D V n.l dl,   C = int (1 - v.h)^5 n.l / pi dl

A and B depend on (n.v, r), C on n.v alone. Their table is bundled, as it takes a new process most of a second
(`tools/make_brdf_table.py`).
"""

import functools
import math
from pathlib import Path

import torch
from torch import Tensor

from lightprobe.core.checkpoint import load_tensors
from lightprobe.kernels import weighted_gather

DIELECTRIC_F0 = 0.04  # glTF 2.0, appendix B: index of refraction 1.5
MIN_COS = 1e-3  # views that graze more, or look from behind a shading normal, count as this
SIZE = 64  # table nodes per axis; cos_view is spaced by its square root, as A and B turn quickly where views graze
_SAMPLES = (64, 24)  # strata of the micro-normal's elevation and azimuth
TABLE = Path(__file__).parents[1] / "assets" / "brdf_integrals.safetensors"


def environment_brdf(cos_view: Tensor, roughness: Tensor) -> tuple[Tensor, Tensor]:
    """Return A (N,) and B (N,) of the module's notation, differentiable in both arguments (N,)."""
    return integrals_at(view_taps(cos_view, roughness))[:2]


def view_taps(cos_view: Tensor, roughness: Tensor) -> tuple[Tensor, Tensor]:
    """Return index (N, 4) and weight (N, 4) that look up tables (64 * 64, C) over (roughness,
    sqrt(cos_view)).

    Bilinear; the weight is differentiable in both arguments (N,).
    """
    x, fx = _cell(cos_view.clamp(MIN_COS, 1.0).sqrt())
    y, fy = _cell(roughness)
    first = y * SIZE + x
    index = torch.stack([first, first + 1, first + SIZE, first + SIZE + 1], dim=-1)
    gx, gy = 1.0 - fx, 1.0 - fy
    return index, torch.stack([gx * gy, fx * gy, gx * fy, fx * fy], dim=-1)


def integrals_at(taps: tuple[Tensor, Tensor]) -> tuple[Tensor, Tensor, Tensor]:
    """Return A, B and C, each (N,), of the module's notation at `view_taps`."""
    index, weight = taps
    a, b, c = weighted_gather(_table(weight.device, weight.dtype), index, weight).unbind(-1)
    return a, b, c


def diffuse_fresnel(cos_view: Tensor) -> Tensor:
    """Return C (N,) of the module's notation, differentiable in cos_view (N,)."""
    x, fx = _cell(cos_view.clamp(MIN_COS, 1.0).sqrt())
    table = _table(cos_view.device, cos_view.dtype)[:SIZE, 2:]
    return weighted_gather(table, torch.stack([x, x + 1], dim=-1), torch.stack([1.0 - fx, fx], dim=-1))[:, 0]


def base_reflectance(base_color: Tensor, metallic: Tensor) -> Tensor:
    """Return F0 (N, 3) of base colour (N, 3) linear and metallic (N,)."""
    metallic = metallic[:, None]
    return DIELECTRIC_F0 * (1.0 - metallic) + base_color * metallic


def _cell(value: Tensor) -> tuple[Tensor, Tensor]:
    """Return the table node below each value in [0, 1] and the fraction, differentiable, towards the next."""
    position = value.clamp(0.0, 1.0) * (SIZE - 1)
    node = position.detach().long().clamp(0, SIZE - 2)
    return node, position - node


@functools.lru_cache(maxsize=8)
def _table(device: torch.device, dtype: torch.dtype) -> Tensor:
    """Return (A, B, C) as (64 * 64, 3): rows run over roughness, columns over cos_view."""
    return load_tensors(TABLE)["integrals"].to(device, dtype)


def integrals() -> Tensor:
    """Return the table of A, B and C, (64 * 64, 3) float64, by integration: what the bundled file holds."""
    rows = [_integrate_row(roughness) for roughness in torch.linspace(0.0, 1.0, SIZE, dtype=torch.float64)]
    return torch.cat([torch.cat(rows), _diffuse_integral().repeat(SIZE, 1)], dim=-1)


def _integrate_row(roughness: Tensor) -> Tensor:
    """Return (A, B) for all cos_view at one roughness, (64, 2), by importance sampling.

    Micro-normals h are drawn on a regular grid from the distribution of normals visible from v (a spherical
    cap around the stretched view, Dupuy and Benyoub 2023); the estimator of int F D V n.l is then the mean of
    F G2 / G1(v). The azimuth covers half a turn, as the other half is its mirror image.
    """
    alpha = max(float(roughness) ** 2, 1e-4)
    cos_view = (torch.linspace(0.0, 1.0, SIZE, dtype=torch.float64) ** 2).clamp(min=MIN_COS)[:, None]
    sin_view = (1.0 - cos_view**2).clamp(min=0.0).sqrt()
    elevation, azimuth = (((torch.arange(n, dtype=torch.float64) + 0.5) / n) for n in _SAMPLES)
    u, phi = (grid.flatten() for grid in torch.meshgrid(elevation, math.pi * azimuth, indexing="ij"))

    length = torch.sqrt((alpha * sin_view) ** 2 + cos_view**2)
    view_x, view_z = alpha * sin_view / length, cos_view / length
    z = (1.0 - u) * (1.0 + view_z) - view_z
    sin_z = (1.0 - z * z).clamp(min=0.0).sqrt()
    h = torch.stack([alpha * (sin_z * phi.cos() + view_x), alpha * sin_z * phi.sin(), z + view_z], dim=-1)
    h = h / h.norm(dim=-1, keepdim=True)
    cos_half = sin_view * h[..., 0] + cos_view * h[..., 2]
    cos_light = 2.0 * cos_half * h[..., 2] - cos_view

    fresnel = (1.0 - cos_half).clamp(0.0, 1.0) ** 5
    visible = torch.where(cos_light > 0.0, _smith_ratio(cos_view, cos_light.clamp(min=1e-9), alpha), 0.0)
    return torch.stack([((1.0 - fresnel) * visible).mean(-1), (fresnel * visible).mean(-1)], dim=-1)


def _smith_ratio(cos_view: Tensor, cos_light: Tensor, alpha: float) -> Tensor:
    """Return G2 / G1(v) = (1 + lambda(v)) / (1 + lambda(v) + lambda(l)), height-correlated (Heitz 2014)."""
    lambda_view, lambda_light = (
        0.5 * (torch.sqrt(1.0 + alpha**2 * (1.0 - c * c) / (c * c)) - 1.0) for c in (cos_view, cos_light)
    )
    return (1.0 + lambda_view) / (1.0 + lambda_view + lambda_light)


def _diffuse_integral() -> Tensor:
    """Return C for all cos_view, (64, 1): the mean of (1 - v.h)^5 over cosine-distributed light directions."""
    n = 96
    u = (torch.arange(n, dtype=torch.float64) + 0.5) / n
    radius2, phi = (grid.flatten() for grid in torch.meshgrid(u, math.pi * u, indexing="ij"))
    light_x, light_z = radius2.sqrt() * phi.cos(), (1.0 - radius2).sqrt()
    cos_view = (torch.linspace(0.0, 1.0, SIZE, dtype=torch.float64) ** 2)[:, None]
    cos_between = (1.0 - cos_view**2).sqrt() * light_x + cos_view * light_z
    cos_half = torch.sqrt(
        (0.5 * (1.0 + cos_between)).clamp(min=0.0)
    )  # v.h = cos(half the angle between v and l)
    return ((1.0 - cos_half) ** 5).mean(-1, keepdim=True)
