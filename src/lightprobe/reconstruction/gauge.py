"""How bright the surface is: the factor that light and base colour share, found by trying.

A photo under an unknown light leaves it nearly open; only reflections that do not take the surface's colour
tell. The gradient cannot be trusted with it: at a light that is not perfectly solved it points along the
light's own errors (too dim a light asks for brighter colours), and visit by visit the two drift off together.
So the mean base colour is held, and now and then a common factor is chosen by solving lights for several and
comparing what the photos say.

A factor changes nothing but the base colours, to which roughness and metallic have fitted themselves, so it
finds only the nearest good one. Twice the material is therefore fitted from several brightnesses
(`reconstruction.material_trials`): a new one when the shape is roughly known, as a wrong brightness misleads
the shape as well, and the present one when the shape is nearly done, as on a rough one several can seem
equally good.

Only the first checkpoints choose a factor, and none after the first trial. Later the materials have grown
used to what was chosen, and a choice follows their errors: a bottle of gilt and leather and a lacquered vase
went on darkening at every one. The first trial starts from a material without a past; the second changes it
only for what is clearly better, unless it has just come out what is metal (`reconstruction.metal_trials`):
what was grown used to then was wrong.
"""

import math
from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import TypeVar

import torch

from lightprobe.core.config import DecomposeConfig, SdfMode
from lightprobe.light.photometry import displayed_error
from lightprobe.reconstruction.lights import Lights, solve_target_light
from lightprobe.reconstruction.photos import Target
from lightprobe.render.gbuffer import GBuffer
from lightprobe.render.split_sum import shade_under

CHOICES = 2  # checkpoints that choose a factor
_FIRST_TRIAL = 2  # the checkpoint that fits the material anew before it chooses
_SECOND_TRIAL = (
    0.7  # share of the first pass after which that is done again: the rest adapts shape and detail to it
)
START = 0.45  # mean linear base colour that Phase I starts with
DARKEST, BRIGHTEST = 0.02, 0.8  # mean linear base colours that no choice goes beyond
_Photo = TypeVar("_Photo")  # whatever stands for one
_PHOTOS = 8  # that a choice looks at
_STEP = math.log(1.4)  # factors tried: one over, none and once this
_REACH = 1.5  # of it, at most, in one choice


def trials_at(config: DecomposeConfig) -> frozenset[int]:
    """Return the steps of the first pass, checkpoints all, at which other brightnesses of the material are
    tried.
    """
    if config.trial_steps == 0:
        return frozenset()
    every, end = config.checkpoint_every, config.pass1_iterations
    steps = (_FIRST_TRIAL * every, round(_SECOND_TRIAL * end / every) * every)
    return frozenset(
        step for step in steps if step < end
    )  # what comes after the last step is the second pass's


def lids_tried(config: DecomposeConfig) -> bool:
    """Return whether the second trial of the first pass opens lids, if it finds any that may be over a
    cavity.

    A network of distances cannot be opened.
    """
    tried = config.brightness_anchor > 0 and len(trials_at(config)) > 1
    return tried and config.sdf is SdfMode.DIRECT


def metals_tried(config: DecomposeConfig, step: int) -> bool:
    """Return whether by a step of the phase it has been tried what is metal, as it is with the second trial.

    Fewer photos than `change_evidence.FEWEST_PHOTOS` speak for no change there, and what is no metal stays
    none.
    """
    trials = trials_at(config)
    return config.brightness_anchor > 0 and len(trials) > 1 and step >= max(trials)


def evenly_spaced(photos: Sequence[_Photo], count: int = _PHOTOS) -> list[_Photo]:
    """Return `count` photos spread evenly over the sequence, all where there are fewer."""
    count = min(count, len(photos))
    return [photos[int((k + 0.5) * len(photos) / count)] for k in range(count)]


@torch.no_grad()
def choose_brightness(
    shown: Iterable[tuple[Target, GBuffer]], lights: Lights, step: int, mean: float
) -> float:
    """Return the factor on all base colours under which photos re-render best, lights solved anew;
    deterministic.

    `shown`: photos, and the present asset's G-buffers in them; `mean`: its mean base colour.
    """
    errors = torch.zeros(3, dtype=torch.float64)
    for target, gbuffer in shown:
        rows = lights.rows(target, gbuffer, step, lights.config.light_solve_pixels)
        if len(rows) > 0:
            pixels = gbuffer.select(rows)
            for i in range(3):
                errors[i] += _error(target, pixels, lights, math.exp((i - 1) * _STEP))
    return min(max(_least(*errors.tolist()), DARKEST / mean), BRIGHTEST / mean)


def _error(target: Target, pixels: GBuffer, lights: Lights, factor: float) -> float:
    """Return the mean displayed error of pixels with base colours times `factor`."""
    pixels = brightened(pixels, factor)
    light = lights.maps[lights.index[target.name]].detach() / factor
    observed, clipped = target.color[pixels.pixel], target.clipped[pixels.pixel]
    # Twice, as the light so far is that of another state of the asset.
    light = solve_target_light(observed, clipped, pixels, light, None, lights.config, times=2)
    return float(displayed_error(shade_under(pixels, light), observed, clipped))


def brightened(pixels: GBuffer, factor: float) -> GBuffer:
    """Return the pixels with base colours times `factor`, at most 1, also of what they see of the object."""
    visibility = None if pixels.visibility is None else pixels.visibility.brightened(factor)
    return replace(pixels, base_color=(pixels.base_color * factor).clamp(max=1), visibility=visibility)


def _least(below: float, here: float, above: float) -> float:
    """Return the factor with the least error, by the parabola through the errors of the three that were
    tried.
    """
    curvature = below - 2 * here + above
    if curvature <= 0:
        return math.exp(math.copysign(_STEP, below - above)) if below != above else 1.0
    best = 0.5 * (below - above) / curvature
    return math.exp(_STEP * min(max(best, -_REACH), _REACH))
