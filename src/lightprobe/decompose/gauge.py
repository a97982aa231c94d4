"""How bright the surface is: the factor that light and base colour share, found by trying.

A photo under an unknown light leaves it nearly open; only reflections that do not take the surface's colour tell. The
gradient cannot be trusted with it: at a light that is not perfectly solved it points along the light's own errors (too
dim a light asks for brighter colours), and visit by visit the two drift off together. So the mean base colour is held,
and now and then a common factor is chosen by solving lights for several and comparing what the photos say, in parts
that the lights have not seen: there the best factor is less dark. (With a true object and lights pulled by 0.1, 0.02
and 0.005 to their mean it is 0.62, 0.72 and 0.97; on the parts that lights were fitted to 0.52, 0.64 and 0.88.)
"""

import math
from collections.abc import Callable
from dataclasses import replace

import torch
from torch import Tensor

from lightprobe.core.config import DecomposeConfig
from lightprobe.decompose.lights import Lights, solve_target_light
from lightprobe.decompose.losses import one_sided, tone_map
from lightprobe.decompose.photos import Target
from lightprobe.render.gbuffer import GBuffer
from lightprobe.render.split_sum import shade

_PHOTOS = 8
_STEP = math.log(1.4)  # factors tried: one over, none and once this
_REACH = 1.5  # of it, at most, in one choice
_TILE = 16  # pixels along the sides of the tiles that a photo is cut into: half of them fit the light, half judge it
_ROUNDS = 2  # solves of a trial, because the light on the map is that of another state of the asset


@torch.no_grad()
def choose_brightness(
    see: Callable[[Target], GBuffer], targets: list[Target], lights: Lights, config: DecomposeConfig, step: int
) -> float:
    """Return the factor on all base colours under which evenly chosen photos re-render best, lights solved anew.

    `see` gives the G-buffer of the present asset in a photo. Deterministic.
    """
    chosen = [targets[int((k + 0.5) * len(targets) / _PHOTOS)] for k in range(min(_PHOTOS, len(targets)))]
    errors = torch.zeros(3, dtype=torch.float64)
    for target in chosen:
        gbuffer = see(target)
        rows = lights.rows(target, gbuffer, step, 2 * config.light_solve_pixels)
        fitted, judged = _tiles(gbuffer, rows)
        if len(fitted) > 0 and len(judged) > 0:
            light = lights.maps[lights.index[target.name]]
            for i in range(3):
                factor = math.exp((i - 1) * _STEP)
                pixels = replace(gbuffer, base_color=(gbuffer.base_color * factor).clamp(max=1))
                errors[i] += _error(target, pixels, fitted, judged, light / factor, lights)
    below, here, above = errors.tolist()
    curvature = below - 2 * here + above
    if curvature <= 0:
        return math.exp(math.copysign(_STEP, below - above)) if below != above else 1.0
    best = 0.5 * (below - above) / curvature
    return math.exp(_STEP * min(max(best, -_REACH), _REACH))


def _tiles(gbuffer: GBuffer, rows: Tensor) -> tuple[Tensor, Tensor]:
    """Return the rows of the G-buffer in the black and in the white tiles of a chessboard."""
    pixel = gbuffer.pixel[rows]
    y, x = torch.div(pixel, gbuffer.width, rounding_mode="floor"), pixel % gbuffer.width
    black = (torch.div(y, _TILE, rounding_mode="floor") + torch.div(x, _TILE, rounding_mode="floor")) % 2 == 0
    return rows[black], rows[~black]


def _error(target: Target, gbuffer: GBuffer, fitted: Tensor, judged: Tensor, light: Tensor, lights: Lights) -> float:
    """Return the mean displayed error of the rows `judged` under the light that the rows `fitted` ask for.

    The solve starts from `light` (6, R, R, 3).
    """
    photo = target.color[gbuffer.pixel]
    for _ in range(_ROUNDS):
        light = solve_target_light(
            photo[fitted], gbuffer, light, fitted, regularisation=lights.config.light_regularisation,
            iterations=lights.config.light_solve_iterations,
        )  # fmt: skip
    render = shade(gbuffer.select(judged), lights.prefilter, lights.prefilter.apply(light))
    render = one_sided(render, photo[judged], torch.ones_like(photo[judged, 0]))
    return float((tone_map(render) - tone_map(photo[judged])).abs().mean())
