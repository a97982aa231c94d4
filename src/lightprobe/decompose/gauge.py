"""How bright the surface is: the factor that light and base colour share, found by trying.

A photo under an unknown light leaves it nearly open; only reflections that do not take the surface's colour tell. The
gradient cannot be trusted with it: at a light that is not perfectly solved it points along the light's own errors (too
dim a light asks for brighter colours), and visit by visit the two drift off together. So the mean base colour is held,
and now and then a common factor is chosen by solving lights for several and comparing what the photos say.

Only the first checkpoints choose. Later the materials have grown used to what was chosen, and a choice follows their
errors: a bottle of gilt and leather went on darkening by a tenth each time, to half its brightness.

It starts bright and is never chosen brighter. A surface taken for too bright is found out, because its reflections are
too weak beside it; one taken for too dark explains its photos by wider lobes, and stays dark. A metal, all reflection,
says nothing about it, and would drift to where every colour is white.
"""

import math
from collections.abc import Iterable
from dataclasses import replace

import torch
from torch import Tensor

from lightprobe.core.config import DecomposeConfig
from lightprobe.decompose.lights import Lights, solve_target_light
from lightprobe.decompose.losses import one_sided, tone_map
from lightprobe.decompose.photos import Target
from lightprobe.render.gbuffer import GBuffer
from lightprobe.render.split_sum import shade

CHOICES = 3  # checkpoints that choose
BRIGHTEST = 0.45  # mean linear base colour that Phase I starts with, and that no choice goes beyond
_PHOTOS = 8
_STEP = math.log(1.4)  # factors tried: one over, none and once this
_REACH = 1.5  # of it, at most, in one choice


def spread(targets: list[Target]) -> list[Target]:
    """Return photos spread evenly over the list, as many as a choice looks at."""
    count = min(_PHOTOS, len(targets))
    return [targets[int((k + 0.5) * len(targets) / count)] for k in range(count)]


@torch.no_grad()
def choose_brightness(
    shown: Iterable[tuple[Target, GBuffer]], lights: Lights, config: DecomposeConfig, step: int, mean: float
) -> float:
    """Return the factor on all base colours under which photos re-render best, lights solved anew; deterministic.

    `shown`: photos, and the present asset's G-buffers in them; `mean`: its mean base colour.
    """
    errors = torch.zeros(3, dtype=torch.float64)
    for target, gbuffer in shown:
        rows = lights.rows(target, gbuffer, step, config.light_solve_pixels)
        if len(rows) > 0:
            for i in range(3):
                errors[i] += _error(target, gbuffer, rows, lights, math.exp((i - 1) * _STEP), config)
    return min(_least(*errors.tolist()), max(1.0, BRIGHTEST / mean))


def _least(below: float, here: float, above: float) -> float:
    """Return the factor with the least error, by the parabola through the errors of the three that were tried."""
    curvature = below - 2 * here + above
    if curvature <= 0:
        return math.exp(math.copysign(_STEP, below - above)) if below != above else 1.0
    best = 0.5 * (below - above) / curvature
    return math.exp(_STEP * min(max(best, -_REACH), _REACH))


def _error(
    target: Target, gbuffer: GBuffer, rows: Tensor, lights: Lights, factor: float, config: DecomposeConfig
) -> float:
    """Return the mean displayed error of the pixels `rows` with base colours times `factor`."""
    pixels = gbuffer.select(rows)
    around = None if pixels.openness is None else pixels.openness.brightened(factor)
    pixels = replace(pixels, base_color=(pixels.base_color * factor).clamp(max=1), openness=around)
    light = lights.maps[lights.index[target.name]] / factor
    photo, clipped = target.color[pixels.pixel], target.clipped[pixels.pixel]
    every = torch.arange(len(rows), device=rows.device)
    for _ in range(2):  # the light on the map is that of another state of the asset
        light = solve_target_light(photo, clipped, pixels, light, every, config)
    render = shade(pixels, lights.prefilter, lights.prefilter.apply(light))
    render = one_sided(render, photo, clipped)
    return float((tone_map(render) - tone_map(photo)).abs().mean())
