"""Split-sum shading: the light's two averages, by lobe and by cosine, times what the surface reflects of them.

    L = c_diff (1 - F0) (1 - C) * irradiance(n) / pi  +  (F0 A + B) * S

with the symbols of `render.brdf` and S the light's average under the specular lobe, for which a mixture of prefiltered
lobes stands (`render.specular_lobes`). Exact under a constant light. No occlusion and no inter-reflection.
"""

from dataclasses import dataclass

import torch
from torch import Tensor

from lightprobe.kernels import weighted_gather
from lightprobe.light.prefilter import Prefilter
from lightprobe.render import brdf
from lightprobe.render.gbuffer import GBuffer
from lightprobe.render.specular_lobes import LOBES, SpecularLobes, dielectric_part, specular_lobes


@dataclass(frozen=True)
class Response:
    """How P pixels depend on the prefiltered levels: sums of taps times factors. All but the indices are >= 0.

    The diffuse look-up also serves the cosine's share of the specular lobe.
    """

    specular_index: Tensor  # (P, 16) int32
    specular_weight: Tensor  # (P, 16), sums to what the cosine leaves
    specular_factor: Tensor  # (P, 3)
    diffuse_index: Tensor  # (P, 4) int32
    diffuse_weight: Tensor  # (P, 4)
    diffuse_factor: Tensor  # (P, 3)


def response(gbuffer: GBuffer, prefilter: Prefilter) -> Response:
    """Return the taps and factors of every pixel; differentiable in the G-buffer's attributes."""
    normal, view = gbuffer.normal, gbuffer.view
    cosine = (normal * view).sum(-1)
    mirror = 2.0 * cosine[:, None] * normal - view
    cosine = cosine.clamp(brdf.MIN_COS, 1.0)
    f0 = brdf.base_reflectance(gbuffer.base_color, gbuffer.metallic)
    taps = brdf.view_taps(cosine, gbuffer.roughness)
    a, b, c = brdf.integrals_at(taps)
    reflected = f0 * a[:, None] + b[:, None]
    transmitted = (1.0 - gbuffer.metallic) * (1.0 - c)
    lobes = specular_lobes(taps, gbuffer.roughness, dielectric_part(f0.mean(-1), a, b))
    cosine_share = (1.0 - lobes.share.sum(-1, keepdim=True)).clamp(min=0.0)  # rounding could bring it below
    return Response(
        *_specular_taps(lobes, normal, mirror, prefilter),
        reflected,
        *prefilter.diffuse_taps(normal),
        gbuffer.base_color * (1.0 - f0) * transmitted[:, None] + reflected * cosine_share,
    )


def _specular_taps(lobes: SpecularLobes, normal: Tensor, mirror: Tensor, prefilter: Prefilter) -> tuple[Tensor, Tensor]:
    """Return index (P, 16) and weight (P, 16) of the look-ups of both lobes; weights sum to their shares."""
    direction = [normal + bend[:, None] * (mirror - normal) for bend in lobes.bend.unbind(-1)]
    index, weight = prefilter.specular_taps(torch.cat(direction), lobes.roughness.T.flatten(), lobes.share.T.flatten())
    return torch.cat(index.chunk(LOBES), dim=-1), torch.cat(weight.chunk(LOBES), dim=-1)


def shade(gbuffer: GBuffer, prefilter: Prefilter, levels: Tensor) -> Tensor:
    """Return outgoing radiance (P, 3), linear, of each pixel under prefiltered `levels` (T, 3) = prefilter.apply(env).

    Differentiable in the G-buffer's normal, view, base colour, roughness and metallic and in the levels.
    """
    r = response(gbuffer, prefilter)
    specular = weighted_gather(levels, r.specular_index, r.specular_weight)
    diffuse = weighted_gather(levels, r.diffuse_index, r.diffuse_weight)
    return r.specular_factor * specular + r.diffuse_factor * diffuse
