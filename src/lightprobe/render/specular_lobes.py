"""The prefiltered lobes that together stand for the specular lobe of a view.

Prefiltered light is averaged under lobes for v = n, symmetric about their direction. The true lobe F D V n.l is not: it
is bent towards the normal where the surface is rough, cut off at the horizon, narrow across the plane of incidence
where the view grazes, and there a dielectric's leans towards the horizon, as F does. Stood for by the one lobe around
the mirror direction, as is common, rough metal is 20 to 40 % off (RMS); by

    share_0 lobe_0 + share_1 lobe_1 + (1 - share_0 - share_1) max(n.l, 0) / pi,   lobe_k around n + bend_k (mirror - n),

a few per cent. The cosine's share costs nothing: shading looks that average up anyway, as the irradiance. The
parameters are tables over (n.v, r) for F0 = 1 and for a dielectric, fitted once for all lights by
`tools/fit_specular_lobes.py`.

The lobe of another F0 is a blend of these two: as F is linear in F0, F D V n.l at F0 is

    (F0 - d) / (1 - d) * (F D V n.l at 1) + (1 - F0) / (1 - d) * (F D V n.l at d),   d = 0.04

and with A and B of `render.brdf` the second term's part of the whole is (1 - F0) / (1 - d) * (d A + B) / (F0 A + B).
The parameters are blended by that part, as blending the lobes would take four look-ups.
"""

import functools
from dataclasses import dataclass
from pathlib import Path

import torch
from torch import Tensor

from lightprobe.core.files import read_json
from lightprobe.kernels import weighted_gather
from lightprobe.render import brdf

LOBES = 2  # prefiltered ones in the mixture
_TABLE = Path(__file__).parents[1] / "assets" / "specular_lobes.json"


@dataclass(frozen=True)
class SpecularLobes:
    """The lobes of N views."""

    bend: Tensor  # (N, 2) where a lobe lies between the normal (0) and the mirror direction (1)
    roughness: Tensor  # (N, 2) of its prefiltered lobe; may exceed 1
    share: Tensor  # (N, 2) >= 0, sums to at most 1; the rest is the cosine's


def specular_lobes(taps: tuple[Tensor, Tensor], roughness: Tensor, dielectric: Tensor) -> SpecularLobes:
    """Return the lobes at `brdf.view_taps` of N views; differentiable in everything.

    roughness (N,); dielectric (N,): the part of the dielectric's lobe as `dielectric_part` has it.
    """
    index, weight = taps
    looked_up = weighted_gather(_table(weight.device, weight.dtype), index, weight)
    metal, change = looked_up.split(3 * LOBES, dim=-1)
    bend, factor, share = (metal + dielectric[:, None] * change).split(LOBES, dim=-1)
    return SpecularLobes(bend, roughness[:, None] * factor, share)


def dielectric_part(f0: Tensor, a: Tensor, b: Tensor) -> Tensor:
    """Return the dielectric lobe's part (N,), in [0, 1], of the lobe of f0 (N,), given A (N,) and B (N,)."""
    d = brdf.DIELECTRIC_F0
    return ((1.0 - f0) * (d * a + b) / ((1.0 - d) * (f0 * a + b))).clamp(max=1.0)


@functools.lru_cache(maxsize=8)
def _table(device: torch.device, dtype: torch.dtype) -> Tensor:
    """Return the table (64 * 64, 12) of parameters at F0 = 1 and their change to the dielectric.

    The parameters are two bends, two factors on the roughness, two shares.
    """
    metal, dielectric = torch.tensor(read_json(_TABLE), dtype=torch.float64).permute(0, 3, 1, 2)
    nodes = torch.cat([metal, dielectric - metal])[None]
    grid = torch.nn.functional.interpolate(nodes, (brdf.SIZE, brdf.SIZE), mode="bilinear", align_corners=True)
    return grid[0].flatten(1).T.to(device, dtype).contiguous()
