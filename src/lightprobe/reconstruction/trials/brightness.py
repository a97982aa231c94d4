"""How bright the surface is: the light/albedo scale, the factor that light and base colour share.

A photo under an unknown light leaves the factor nearly open; only reflections that do not take the surface's
colour tell. The gradient cannot be trusted with it: at a light that is not perfectly solved it points along
the light's own errors (too dim a light asks for brighter colours), and visit by visit the two drift off
together. So the mean base colour is held, and now and then another one is chosen.

`choose_brightness` changes nothing but the base colours, to which roughness and metallic have fitted
themselves, so it finds only the nearest good factor. Bright and matte, or dark and glossy: either explains
most photos when all else has fitted itself to it. So `best_new` and `best_rescaled` fit the material from
several brightnesses. On a rough surface it is a new material, without a past; on one that is nearly finished
it is the present material, brightened or darkened, as what it has learnt tells brightnesses apart better than
a material without detail can. There a change needs to be clearly better: errors of shape, as between a
chair's bars, favour a wrong brightness by a little.
"""

import math
from collections.abc import Iterable, Sequence
from dataclasses import replace

import torch
from torch import Tensor

from lightprobe.light.photometry import displayed_error
from lightprobe.reconstruction.lights import Lights, solve_target_light
from lightprobe.reconstruction.material_field import ScaledMaterial
from lightprobe.reconstruction.photos import Target
from lightprobe.reconstruction.trials.evidence import Bar, standard_error
from lightprobe.reconstruction.trials.plausibility import NO_METAL, MetalReflectance
from lightprobe.reconstruction.trials.schedule import refit_steps
from lightprobe.reconstruction.trials.trial import Trial, TrialPhotos
from lightprobe.render.gbuffer import GBuffer
from lightprobe.render.split_sum import shade_under

DARKEST, BRIGHTEST = 0.02, 0.8  # mean linear base colours that no choice goes beyond
STARTS = (0.5, 0.2, 0.08, 0.03)  # mean linear base colours that a new material is tried with
FACTORS = (4.0, 2.0, 1.0, 0.5, 0.25)  # on the present material, as far as its base colours stay plausible
CHOICE_PHOTOS = 8  # that `choose_brightness` looks at
_STEP = math.log(1.4)  # factors that `choose_brightness` tries: one over, none and once this
_REACH = 1.5  # of that step, at most, in one choice
_ALIKE = 1.3  # a brightness within this factor of the present one is no reason to start over
_BAR = Bar(
    sure=2.0, least=0.03
)  # for leaving a nearly finished material; the gain is a share of the disagreement
_USUAL, _SPREAD = 0.2, 1.0  # mean linear base colour of objects, and the standard deviation of its logarithm
_UNLIKELY = 2.0  # in -ln probability: lights that are less plausible than others by less are no evidence


@torch.no_grad()
def choose_brightness(
    shown: Iterable[tuple[Target, GBuffer]], lights: Lights, step: int, mean: float
) -> float:
    """Return the factor on all base colours under which photos re-render best, lights solved anew.

    `shown`: photos, and the present asset's G-buffers in them; `mean`: its mean base colour. Deterministic.
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
    pull = lights.pull(target.name)
    light = solve_target_light(observed, clipped, pixels, light, None, lights.config, times=2, pull=pull)
    return float(displayed_error(shade_under(pixels, light), observed, clipped))


def brightened(pixels: GBuffer, factor: float) -> GBuffer:
    """Return the pixels with base colours times `factor`, at most 1, also of what they see of the object."""
    visibility = None if pixels.visibility is None else pixels.visibility.brightened(factor)
    return replace(pixels, base_color=(pixels.base_color * factor).clamp(max=1), visibility=visibility)


def _least(below: float, here: float, above: float) -> float:
    """Return the factor with the least error, by the parabola through those of three factors."""
    curvature = below - 2 * here + above
    if curvature <= 0:
        return math.exp(math.copysign(_STEP, below - above)) if below != above else 1.0
    best = 0.5 * (below - above) / curvature
    return math.exp(_STEP * min(max(best, -_REACH), _REACH))


def best_new(photos: TrialPhotos, material: ScaledMaterial) -> tuple[Trial, float] | None:
    """Return the trial of the most probable new material, and the best factor on its base colours.

    None when it is about as bright as the present `material`, or when there are no photos; deterministic.
    """
    config, device, mean = material.config, photos.lights.maps[0].device, float(material.mean_color)
    materials = [(start, ScaledMaterial(start, config, device, photos.seed)) for start in STARTS]
    return _best(photos, mean, materials, config.trial_steps, metals_known=False)


def best_rescaled(
    photos: TrialPhotos, material: ScaledMaterial, *, settled: bool
) -> tuple[Trial, float] | None:
    """Return what `best_new` does, of the present `material` with brighter and darker base colours.

    settled: whether the present brightness was fitted together with the present metals; then it is kept, and
    None returned, where no other is clearly better.
    """
    mean = float(material.mean_color)
    factors = [factor for factor in FACTORS if factor == 1 or DARKEST <= mean * factor <= BRIGHTEST]
    materials = [(mean * factor, material.rescaled(factor)) for factor in factors]
    present = factors.index(1.0) if settled else None
    return _best(photos, mean, materials, refit_steps(material.config), present, metals_known=True)


def _best(
    photos: TrialPhotos,
    mean: float,
    materials: Sequence[tuple[float, ScaledMaterial]],
    steps: int,
    present: int | None = None,
    *,
    metals_known: bool,
) -> tuple[Trial, float] | None:
    """Return the trial of the most probable of the `materials` and the best factor on its base colours.

    None where that makes it about as bright as the mean base colour `mean`, or where it is not clearly better
    than the material number `present`. materials: each with its mean linear base colour.
    metals_known: whether trials have decided what is metal, so that metals tell their brightness.
    """
    if not photos.samples:
        return None
    starts = [start for start, _ in materials]
    trials = [Trial(made, photos, steps, start / mean) for start, made in materials]
    found = [trial.disagreements() for trial in trials]
    nlls = [trial.lights_nll() for trial in trials]
    metals = [trial.metals() if metals_known else NO_METAL for trial in trials]
    scores = [_score(errors) for errors in found]
    best = _most_probable(found, scores, nlls, metals, starts)
    if (
        present is not None
        and nlls[present] + metals[present].nll - nlls[best] - metals[best].nll <= _UNLIKELY
        and not _BAR.cleared_by(_gains(found[best], found[present]))
    ):
        return None
    factor = _vertex(starts, scores, best) if scores[best] == min(scores) else 1.0
    ratio = starts[best] * factor / mean
    return None if 1 / _ALIKE <= ratio <= _ALIKE else (trials[best], factor)


def _score(errors: Tensor) -> float:
    """Return the logarithm of the disagreement (J, SPLITS) of all photos together, mean over splits."""
    return float(errors.nansum(0).clamp(min=1e-9).log().mean())


def _most_probable(
    found: Sequence[Tensor],
    scores: Sequence[float],
    nlls: Sequence[float],
    metals: Sequence[MetalReflectance],
    starts: Sequence[float],
) -> int:
    """Return which trial is most probable: the one with the least sum of four -ln probabilities.

    found: the disagreement (J, SPLITS) of each trial, scores: its `_score`; nlls: of its lights, which count
    where they exceed the least by more than `_UNLIKELY`; metals: its metals; starts: its mean base colour, whose
    logarithm is normally distributed over objects, but for metals (docs/decisions/brightness-in-doubt.md).
    """
    least = found[min(range(len(scores)), key=scores.__getitem__)]
    excess = [nll - min(nlls) for nll in nlls]
    costs = [
        _disagreement_nll(errors, least)
        + (more if more > _UNLIKELY else 0.0)
        + metal.nll
        + (1 - metal.share) * 0.5 * (math.log(start / _USUAL) / _SPREAD) ** 2
        for errors, more, metal, start in zip(found, excess, metals, starts, strict=True)
    ]
    return min(range(len(costs)), key=costs.__getitem__)


def _disagreement_nll(errors: Tensor, least: Tensor) -> float:
    """Return how improbable a material with the disagreements (J, SPLITS) is, in -ln probability.

    If it were right, its disagreements would exceed those of the trial with the `least` by chance alone. The
    K photos that both judge give K differences with a mean m and a standard error s, and m/s is distributed
    as Student's t with K - 1 degrees of freedom, whose density falls as (1 + t²/(K - 1))^(-K/2). A wrong
    shape shifts all photos' differences alike, which their spread does not show: its standard deviation is
    added to s, in squares.
    """
    gain = _gains(least, errors)
    if len(gain) == 0:
        return 0.0
    t = max(float(gain.mean()), 0.0) / math.hypot(_BAR.least, standard_error(gain))
    return 0.5 * len(gain) * math.log1p(t**2 / max(len(gain) - 1, 1))


def _gains(errors: Tensor, rival: Tensor) -> Tensor:
    """Return by how much disagreements (J, SPLITS) are less than the rival's, (K,), as shares of the rival's
    mean.

    The K photos are those that have both.
    """
    judged = ~(rival.isnan() | errors.isnan()).any(1)
    errors, rival = errors[judged], rival[judged]
    return (rival - errors).sum(1) / rival.sum(1).mean().clamp(min=1e-9)


def _vertex(starts: Sequence[float], errors: Sequence[float], best: int) -> float:
    """Return where the parabola through the least error and its neighbours is lowest, over the least."""
    if not 0 < best < len(errors) - 1:
        return 1.0
    left, here, right = (math.log(starts[k]) for k in (best - 1, best, best + 1))
    below, least, above = (errors[k] for k in (best - 1, best, best + 1))
    first, second = (least - below) / (here - left), (above - least) / (right - here)
    slope = (second - first) / (right - left)
    return math.exp(0.5 * (left + here) - 0.5 * first / slope - here) if slope > 0 else 1.0
