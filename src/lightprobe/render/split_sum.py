"""Split-sum shading: the light's averages by lobe and by cosine, times what the surface reflects.

    L = c_diff (1 - F0) (1 - C) * irradiance(n) / pi  +  (F0 A + B) * S

with the symbols of `render.brdf` and S the light's average under the specular lobe, for which a mixture of
prefiltered lobes stands (`render.specular_lobes`). Exact under a constant light.

Where the object blocks its own view, `visibility` tells: the diffuse light is the cosine average over what is
open, the specular one is dimmed by the lobe's open share, and both get one bounce off the blocking surfaces
in return.
"""

from dataclasses import dataclass

import torch
from torch import Tensor

from lightprobe.kernels import weighted_gather
from lightprobe.light.prefilter import Prefilter, cached
from lightprobe.render import brdf
from lightprobe.render.gbuffer import GBuffer
from lightprobe.render.specular_lobes import LOBES, SpecularLobes, dielectric_part, specular_lobes
from lightprobe.render.surface import from_center
from lightprobe.render.visibility import PointVisibility


@dataclass(frozen=True)
class Reflectance:
    """How P pixels reflect, all >= 0; the diffuse factor also carries the specular lobe's cosine share."""

    specular: Tensor  # (P, 3) energy of the whole specular lobe
    share: Tensor  # (P, 1) of it that the sharp lobes carry
    diffuse: Tensor  # (P, 3)
    mirror: Tensor  # (P, 3) unit
    lobes: SpecularLobes


def reflectance(gbuffer: GBuffer) -> Reflectance:
    """Return the reflectance of every pixel; differentiable in the G-buffer's attributes."""
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
    diffuse = gbuffer.base_color * (1.0 - f0) * transmitted[:, None] + reflected * cosine_share
    return Reflectance(reflected, 1.0 - cosine_share, diffuse, mirror, lobes)


def specular_taps(r: Reflectance, gbuffer: GBuffer, prefilter: Prefilter) -> tuple[Tensor, Tensor]:
    """Return index (P, 16) int32 and weight (P, 16) of the sharp lobes' look-ups, summing to their share."""
    normal = gbuffer.normal
    bent = [normal + bend[:, None] * (r.mirror - normal) for bend in r.lobes.bend.unbind(-1)]
    direction = [towards_seen(gbuffer, towards) for towards in bent]
    roughness, share = r.lobes.roughness.T.flatten(), r.lobes.share.T.flatten()
    index, weight = prefilter.specular_taps(torch.cat(direction), roughness, share)
    return torch.cat(index.chunk(LOBES), dim=-1), torch.cat(weight.chunk(LOBES), dim=-1)


def towards_seen(gbuffer: GBuffer, direction: Tensor) -> Tensor:
    """Return where from the object's centre lies what each pixel sees towards `direction` (P, 3), not normalised.

    Without a known support everything is far away.
    """
    if gbuffer.support is None:
        return direction
    return from_center(direction, gbuffer.position.detach(), gbuffer.support)


@dataclass(frozen=True)
class Shading:
    """All of P pixels' `shade` that does not depend on the light; no autograd."""

    taps: list[tuple[Tensor, Tensor]]  # of the specular lobe and, with nothing in the way, of the diffuse one
    factors: Tensor  # (2 or 3, P, 3) what is reflected of the specular, the diffuse and the bounced light
    normal: Tensor  # (P, 3)
    visibility: PointVisibility | None
    first_block: int  # of the prefiltered levels

    @staticmethod
    @torch.no_grad()
    def of(gbuffer: GBuffer, prefilter: Prefilter) -> "Shading":
        """Return the factors and look-ups of all pixels of a G-buffer."""
        r = reflectance(gbuffer)
        taps, factors = [specular_taps(r, gbuffer, prefilter)], [r.specular, r.diffuse]
        if gbuffer.visibility is None:
            taps.append(prefilter.diffuse_taps(gbuffer.normal))
        else:
            lobe, bounce = occlude(gbuffer, r, gbuffer.visibility.share(gbuffer.normal))
            factors = [lobe * r.specular, r.diffuse, bounce]
        return Shading(taps, torch.stack(factors), gbuffer.normal, gbuffer.visibility, prefilter.first_block)

    def apply(self, levels: Tensor) -> Tensor:
        """Return what `shade` returns, (P, 3), under prefiltered `levels` (T, 3)."""
        arriving = [weighted_gather(levels, *taps) for taps in self.taps]
        if self.visibility is not None:
            arriving += self.visibility.light(levels[self.first_block :], self.normal)[:, :6].split(3, dim=1)
        return (self.factors * torch.stack(arriving)).sum(0)


def shade(gbuffer: GBuffer, prefilter: Prefilter, levels: Tensor) -> Tensor:
    """Return outgoing linear radiance (P, 3) under prefiltered `levels` (T, 3) = prefilter.apply(env).

    Differentiable in the G-buffer's normal, view, base colour, roughness and metallic and in the levels.
    """
    r = reflectance(gbuffer)
    specular = weighted_gather(levels, *specular_taps(r, gbuffer, prefilter))
    if gbuffer.visibility is None:
        diffuse = weighted_gather(levels, *prefilter.diffuse_taps(gbuffer.normal))
        return r.specular * specular + r.diffuse * diffuse
    arriving = gbuffer.visibility.light(levels[prefilter.first_block :], gbuffer.normal)
    diffuse, ambient, opened = arriving[:, :3], arriving[:, 3:6], arriving[:, 6]
    lobe, bounce = occlude(gbuffer, r, opened)
    return r.specular * lobe * specular + r.diffuse * diffuse + bounce * ambient


def shade_under(gbuffer: GBuffer, light: Tensor) -> Tensor:
    """Return what `shade` does, (P, 3), under a light (6, R, R, 3) that is not prefiltered yet."""
    prefilter = cached(light.shape[1], light.device)
    return shade(gbuffer, prefilter, prefilter.apply(light))


def occlude(gbuffer: GBuffer, r: Reflectance, opened: Tensor) -> tuple[Tensor, Tensor]:
    """Return the open share (P, 1) of the specular lobe, and the light (P, 3) off what blocks the rest.

    The lobe is as open as its axis for a mirror, as the cosine's hemisphere, `opened` (P,), when matte. Blocking
    surfaces have the mean base colour of all blockers, and are taken to stand in the mean light of the pixel's
    open directions.
    """
    if gbuffer.visibility is None:
        raise ValueError("The G-buffer has no visibility.")
    matte = gbuffer.roughness.detach().square()
    axis = gbuffer.visibility.towards(r.mirror)
    lobe = (axis + matte * (opened.detach() - axis))[:, None]
    blocked = r.diffuse * (1.0 - opened[:, None]) + r.specular * r.share * (1.0 - lobe)
    return lobe, gbuffer.visibility.occluder_color() * blocked


@torch.no_grad()
def furnace(gbuffer: GBuffer) -> Tensor:
    """Return the radiance (P, 3) under a constant environment of radiance 1."""
    r = reflectance(gbuffer)
    if gbuffer.visibility is None:
        return r.specular * r.share + r.diffuse
    opened = gbuffer.visibility.share(gbuffer.normal)
    lobe, bounce = occlude(gbuffer, r, opened)
    return r.specular * r.share * lobe + r.diffuse * opened[:, None] + bounce
