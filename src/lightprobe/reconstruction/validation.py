"""How well an asset explains photos, held-out ones as a rule: choice of a pass, final lights, verdict."""

from dataclasses import replace

import torch
from torch import Tensor

from lightprobe.core.config import DecomposeConfig
from lightprobe.core.device import draw_rows, generator
from lightprobe.imaging import srgb_encode
from lightprobe.light.photometry import one_sided
from lightprobe.light.resize import magnify_light
from lightprobe.models.object_verdict import ObjectVerdict
from lightprobe.reconstruction.lights import FINAL_REGULARISATION, NO_PULL, LightPull, solve_target_light
from lightprobe.reconstruction.photos import Target
from lightprobe.reconstruction.trials.disagreement import disagreement
from lightprobe.reconstruction.trials.plausibility import BackgroundLevel, ViewLightCorrelation
from lightprobe.render.asset import Asset, asset_gbuffer
from lightprobe.render.gbuffer import GBuffer
from lightprobe.render.split_sum import shade_under
from lightprobe.render.surface import visible_surface

_JUDGED = 1536  # pixels of each photo that an object is judged by
_ROUNDS = 3  # solves from scratch, each pulled towards the mean of the one before
_BRIGHTEST, _LEAST = 0.5, 1e-6  # of the grey light they start from, which too few steps dim to a dark photo


@torch.no_grad()
def fit_light(
    asset: Asset,
    target: Target,
    resolution: int,
    config: DecomposeConfig,
    seed: int,
    start: Tensor | None = None,
    pull: LightPull = NO_PULL,
) -> tuple[GBuffer, Tensor]:
    """Return the G-buffer of the asset in a photo and the light (6, R, R, 3) solved for it.

    From scratch, or from a light `start` (6, r, r, 3) that needs only a few more steps. pull: as in
    `solve_target_light`, of resolution r.
    """
    surface = visible_surface(asset.mesh.vertices, asset.mesh.faces, target.view)
    gbuffer = asset_gbuffer(asset, surface, target.view)
    inside = target.inside(gbuffer.pixel)
    draw = torch.randperm(len(inside), generator=generator(seed, f"explain/{target.name}"))
    rows = inside[draw[: 2 * config.light_solve_pixels].to(inside.device)]
    rounds = _ROUNDS if start is None else 1
    grey = torch.full((6, resolution, resolution, 3), _BRIGHTEST, device=gbuffer.normal.device)
    light = grey if start is None else magnify_light(start, resolution)
    if len(rows) == 0:
        return gbuffer, light
    at = gbuffer.pixel[rows]
    if start is None:
        white = shade_under(gbuffer.select(rows), torch.ones_like(grey)).mean()
        light = grey.minimum((target.color[at].mean() / white.clamp(min=_LEAST)).clamp(min=_LEAST))
    solved = solve_target_light(
        target.color[at],
        target.clipped[at],
        gbuffer,
        light,
        rows,
        config,
        rounds,
        regularisation=FINAL_REGULARISATION,
        pull=pull.magnified(resolution),
    )
    return gbuffer, solved


@torch.no_grad()
def validate(asset: Asset, targets: list[Target], config: DecomposeConfig, seed: int) -> float:
    """Return the mean masked sRGB PSNR in dB of photos that show the object, under lights solved for them."""
    scores = []
    for target in targets:
        gbuffer, light = fit_light(asset, target, config.light_resolution, config, seed)
        image = torch.zeros_like(target.color)
        image[gbuffer.pixel] = shade_under(gbuffer, light)
        inside = target.covered
        ours = one_sided(image[inside], target.color[inside], target.clipped[inside]).clamp(0, 1)
        error = (srgb_encode(ours) - srgb_encode(target.color[inside].clamp(0, 1))).square().mean()
        scores.append(float(-10 * torch.log10(error.clamp(min=1e-10))))
    return sum(scores) / len(scores)


@torch.no_grad()
def judge_object(
    asset: Asset,
    targets: list[Target],
    correlation: ViewLightCorrelation | None,
    background: BackgroundLevel | None,
    config: DecomposeConfig,
    seed: int,
    *,
    held_out: bool = True,
) -> ObjectVerdict | None:
    """Return the verdict on an asset from photos; None when they show too little.

    correlation, background: of the lights of all training photos, where there are enough of them. held_out:
    whether the asset was not fitted to the photos; those it was fitted to flatter it
    (docs/decisions/object-verdict.md).
    """
    errors = []
    for target in targets:
        gbuffer, light = fit_light(asset, target, config.light_resolution, config, seed)
        inside = target.inside(gbuffer.pixel)
        pixels = gbuffer.select(draw_rows(inside, _JUDGED, generator(seed, f"judge/{target.name}")))
        color, clipped = target.color[pixels.pixel], target.clipped[pixels.pixel]
        random = generator(seed, f"judge-halves/{target.name}")
        halves = disagreement(pixels, color, clipped, light, config, random)
        if halves is not None:
            errors.append(float(halves[0]))  # of the darker and the brighter surfaces
    if not errors:
        return None
    verdict = ObjectVerdict(sum(errors) / len(errors), len(errors), held_out=held_out)
    if correlation is not None:
        verdict = replace(verdict, front_bias=correlation.mean, surprise=correlation.nll)
    if background is not None:
        verdict = replace(verdict, excess=background.excess, excess_surprise=background.nll)
    return verdict
