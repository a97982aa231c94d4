"""Split-sum shading: the light's two averages, by lobe and by cosine, times what the surface reflects of them.

    L = c_diff (1 - F0) (1 - C) * irradiance(n) / pi  +  (F0 A + B) * S(reflect(v, n), r)

with the symbols of `render.brdf` and S the prefiltered radiance of `light.prefilter`. Exact under a constant light.
No occlusion and no inter-reflection.
"""

from dataclasses import dataclass

from torch import Tensor

from lightprobe.kernels import weighted_gather
from lightprobe.light.prefilter import Prefilter
from lightprobe.render import brdf
from lightprobe.render.gbuffer import GBuffer


@dataclass(frozen=True)
class Response:
    """How P pixels depend on the prefiltered levels: sum of taps times a factor, for the two lobes."""

    specular_index: Tensor  # (P, 8) int32
    specular_weight: Tensor  # (P, 8)
    specular_factor: Tensor  # (P, 3)
    diffuse_index: Tensor  # (P, 4) int32
    diffuse_weight: Tensor  # (P, 4)
    diffuse_factor: Tensor  # (P, 3)


def response(gbuffer: GBuffer, prefilter: Prefilter) -> Response:
    """Return the taps and factors of every pixel; differentiable in the G-buffer's attributes."""
    normal, view = gbuffer.normal, gbuffer.view
    cosine = (normal * view).sum(-1)
    reflected = 2.0 * cosine[:, None] * normal - view
    cosine = cosine.clamp(brdf.MIN_COS, 1.0)
    f0 = brdf.base_reflectance(gbuffer.base_color, gbuffer.metallic)
    a, b = brdf.environment_brdf(cosine, gbuffer.roughness)
    transmitted = (1.0 - gbuffer.metallic) * (1.0 - brdf.diffuse_fresnel(cosine))
    return Response(
        *prefilter.specular_taps(reflected, gbuffer.roughness),
        f0 * a[:, None] + b[:, None],
        *prefilter.diffuse_taps(normal),
        gbuffer.base_color * (1.0 - f0) * transmitted[:, None],
    )


def shade(gbuffer: GBuffer, prefilter: Prefilter, levels: Tensor) -> Tensor:
    """Return outgoing radiance (P, 3), linear, of each pixel under prefiltered `levels` (T, 3) = prefilter.apply(env).

    Differentiable in the G-buffer's normal, view, base colour, roughness and metallic and in the levels.
    """
    r = response(gbuffer, prefilter)
    specular = weighted_gather(levels, r.specular_index, r.specular_weight)
    diffuse = weighted_gather(levels, r.diffuse_index, r.diffuse_weight)
    return r.specular_factor * specular + r.diffuse_factor * diffuse
