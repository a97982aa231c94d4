"""Directional integrals of the reflectance model, tabulated once and looked up with gradients.

The model is glTF's metallic-roughness one, single-scattering:

    f = (1 - F) c_diff / pi + F D V,   F = F0 + (1 - F0) (1 - v.h)^5
    c_diff = base (1 - m),   F0 = 0.04 (1 - m) + base m
    D = GGX of alpha = r^2,  V = height-correlated Smith visibility

n normal, v direction to the camera, l to the light, h their half vector; all unit. Under a light of constant
radiance 1 the specular part reflects F0 A + B and the diffuse part c_diff (1 - F0) (1 - C):

    A = int (1 - (1 - v.h)^5) D V n.l dl,   B = int (1 - v.h)^5 D V n.l dl,   C = int (1 - v.h)^5 n.l / pi dl

A and B depend on (n.v, r), C on n.v alone. Their table is bundled; `tools/make_brdf_table.py` integrates them.
"""

import functools
from pathlib import Path

import torch
from torch import Tensor

from lightprobe.core.checkpoint import load_tensors
from lightprobe.kernels import weighted_gather

DIELECTRIC_F0 = 0.04  # glTF 2.0, appendix B: index of refraction 1.5
MIN_COS = 1e-3  # views that graze more, or look from behind a shading normal, count as this
SIZE = 64  # table nodes per axis; cos_view is spaced by its square root, as A and B turn quickly where views graze
TABLE = Path(__file__).parents[1] / "assets" / "brdf_integrals.safetensors"


def environment_brdf(cos_view: Tensor, roughness: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """Return A, B and C, each (N,), of the module's notation, differentiable in both arguments (N,)."""
    return integrals_at(view_taps(cos_view, roughness))


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
