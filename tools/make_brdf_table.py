"""Writes the table of the reflectance model's directional integrals that the package bundles.

    python tools/make_brdf_table.py        # rewrites src/lightprobe/assets/brdf_integrals.safetensors, a second

`lightprobe.render.brdf` says what they are and looks them up. Same machine, same table.
"""

import math

import torch
from torch import Tensor

from lightprobe.core.checkpoint import save_tensors
from lightprobe.render.brdf import MIN_COS, SIZE, TABLE

_SAMPLES = (64, 24)  # strata of the micro-normal's elevation and azimuth


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


def main() -> None:
    """Integrate and write."""
    save_tensors(TABLE, {"integrals": integrals()})
    print(f"Table: {TABLE}")


if __name__ == "__main__":
    main()
