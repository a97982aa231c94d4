"""The first pass's material fitted from several brightnesses, and the one kept under which parts agree best.

Bright and matte, or dark and glossy: either explains most photos when roughness, metallic and lights have
fitted themselves to it, so that no small step leads from one to the other. So each is fitted for a short time
on the surface as it is, which costs a fraction of as many steps of the pass, and judged by
`reconstruction.agreement`. On a rough surface the material is fitted from nothing; on one that is nearly
finished the present one is brightened or darkened and fitted on, as what it has learnt tells brightnesses
apart better than a material without detail can. There a change needs to be clearly better: errors of shape,
as between a chair's bars, favour a wrong brightness by a little.

Parts of an object whose reflections all take the surface's colour agree at any brightness. Then the lights of
all photos tell: they must not know where the camera stands (`reconstruction.front_bias`), and be about as
bright as what photos show around the object (`reconstruction.surroundings`). What these leave open is decided
by what is usual: the mean base colours of most objects lie within a factor of e of .2
(docs/decisions/brightness-in-doubt.md).

A light bends to the pixels that it is solved from, the more so the sharper the lobes are that look into it; a
material fitted to the same pixels turns into a mirror. So each step solves the light from one half of a
photo's pixels, drawn at random, and fits the material to the other.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from lightprobe.core.device import draw_rows, generator
from lightprobe.light.photometry import displayed_error
from lightprobe.reconstruction.agreement import SPLITS, disagreement, part_solver
from lightprobe.reconstruction.front_bias import FrontBias
from lightprobe.reconstruction.gauge import BRIGHTEST, DARKEST
from lightprobe.reconstruction.lights import Lights, LightSolver
from lightprobe.reconstruction.photos import Target
from lightprobe.reconstruction.scaled_material import ScaledMaterial
from lightprobe.reconstruction.surroundings import Surroundings
from lightprobe.render.gbuffer import GBuffer
from lightprobe.render.split_sum import shade_under
from lightprobe.scene.camera import mean_up
from lightprobe.training import Descent, ParameterGroup

PHOTOS = 32  # that a trial learns from
STARTS = (0.5, 0.2, 0.08, 0.03)  # mean linear base colours that a new material is tried with
FACTORS = (
    4.0,
    2.0,
    1.0,
    0.5,
    0.25,
)  # that the present material's are tried times, as far as they stay plausible
_PIXELS = 1536  # of each photo
_RATE = 2.0  # of the pass's material, as the trial is short
_JUDGES = 8  # of the photos, or up to twice as many where their number is no multiple of it
_ALIKE = 1.3  # a brightness within this factor of the present one is no reason to start over
_CLEAR = (
    0.03  # share by which parts must agree better before a nearly finished material changes its brightness
)
_SURE = 2.0  # standard errors over the photos that this gain must have as well
_USUAL, _SPREAD = 0.2, 1.0  # mean linear base colour of objects, and the standard deviation of its logarithm
_UNLIKELY = 2.0  # in ln probability: lights that are less likely than others by less are no evidence


@dataclass(frozen=True)
class Sample:
    """Some pixels of a photo on the present surface."""

    name: str
    pixels: GBuffer  # P pixels
    color: Tensor  # (P, 3) linear
    clipped: Tensor  # (P, 3) bool
    covered: float  # share of the photo that the object covers
    up: Tensor  # (3,) the camera's upward axis
    shown: float | None = None  # as `Target.shown`

    @staticmethod
    def of(target: Target, gbuffer: GBuffer, seed: int) -> "Sample":
        """Return pixels of a photo that lie wholly inside its mask, drawn at random."""
        inside = target.inside(gbuffer.pixel)
        rows = draw_rows(inside, _PIXELS, generator(seed, f"trial/{target.name}"))
        pixels = gbuffer.select(rows)
        covered = len(gbuffer.pixel) / (gbuffer.height * gbuffer.width)
        color, clipped = target.color[pixels.pixel], target.clipped[pixels.pixel]
        return Sample(target.name, pixels, color, clipped, covered, target.view.rotation[:, 1], target.shown)

    def of_material(self, material: Tensor) -> GBuffer:
        """Return the pixels with a material (P, 8), its normal offsets left out."""
        return replace(
            self.pixels, base_color=material[:, :3], roughness=material[:, 3], metallic=material[:, 4]
        )


class Trial:
    """A material on a fixed surface, and its lights."""

    def __init__(
        self, material: ScaledMaterial, samples: Sequence[Sample], lights: Lights, factor: float, seed: int
    ):
        """Start from a material, which is changed, and from the `lights` divided by `factor`.

        What the samples see of the object keeps its present colours, whatever the material's brightness:
        docs/decisions/brightness-once-more.md.
        """
        self.material, self.samples, self.config, self.seed = material, samples, material.config, seed
        self.lights = {s.name: lights.maps[lights.index[s.name]].detach() / factor for s in samples}
        device = lights.maps[0].device
        self._solver = LightSolver(self.config, device, _PIXELS // 2)
        self._part_solver = part_solver(self.config, device, _PIXELS // 2)

    def fit(self, steps: int) -> None:
        """Fit the material to the samples, one photo a step, each photo's light solved at each visit."""
        descent = Descent(
            [
                ParameterGroup(
                    dict(self.material.named_parameters()), _RATE * self.config.learning_rate_material
                )
            ],
            self._loss,
            schedule=lambda rate, step: rate * 0.1 ** (step / steps),
            betas=(0.9, 0.99),
            epsilon=1e-12,
            fused=True,
        )
        for step in range(steps):
            descent.step(step, self.samples[step % len(self.samples)], step)
        descent.end()

    def _loss(self, sample: Sample, step: int) -> Tensor:
        material = self.material(sample.pixels.position)
        pixels, color, clipped = sample.of_material(material), sample.color, sample.clipped
        order = torch.randperm(
            len(color), generator=generator(self.seed, f"trial-halves/{sample.name}", step)
        )
        solved, fitted = order.to(color.device).tensor_split(2)
        light = self._solver(color, clipped, pixels, solved, self.lights[sample.name])
        self.lights[sample.name] = light
        image = displayed_error(shade_under(pixels.select(fitted), light), color[fitted], clipped[fitted])
        return image + self.material.loss(sample.pixels.position, material, step, sample.covered)

    @torch.no_grad()
    def errors(self, photos: int = _JUDGES) -> Tensor:
        """Return how much parts of the object disagree about the lights of some photos, (J, SPLITS) float64.

        It is nan for photos that show too little of it to be halved.
        """
        judges = self.samples[:: max(1, len(self.samples) // photos)]
        errors = torch.full((len(judges), SPLITS), torch.nan, dtype=torch.float64)
        for row, sample in zip(errors, judges, strict=True):
            pixels = sample.of_material(self.material(sample.pixels.position))
            random = generator(self.seed, f"halves/{sample.name}")
            light = self.lights[sample.name]
            found = disagreement(pixels, sample.color, sample.clipped, light, self._part_solver, random)
            if found is not None:
                row.copy_(found)
        return errors

    def surprise(self) -> float:
        """Return how unlikely such lights are with these cameras and surroundings, in ln probability; 0 is
        likely.
        """
        lights = [self.lights[sample.name] for sample in self.samples]
        up = torch.from_numpy(mean_up([sample.up.cpu().numpy() for sample in self.samples])).float()
        bias = FrontBias.of(lights, [sample.pixels.view.mean(0) for sample in self.samples], up)
        around = Surroundings.of(lights, [sample.shown for sample in self.samples])
        return sum(evidence.surprise for evidence in (bias, around) if evidence is not None)


def best_new(
    samples: Sequence[Sample], lights: Lights, material: ScaledMaterial, seed: int
) -> tuple[Trial, float] | None:
    """Return the trial of a new material under which parts agree best, and the best factor on its base
    colours.

    None when the brightness of the present `material` is as good, or when no sample has pixels;
    deterministic.
    """
    config, device, mean = material.config, lights.maps[0].device, float(material.mean_color)
    trials = [(start, ScaledMaterial(start, config, device, seed)) for start in STARTS]
    return _best(samples, lights, mean, trials, config.trial_steps, seed)


def best_rescaled(
    samples: Sequence[Sample], lights: Lights, material: ScaledMaterial, seed: int, *, settled: bool
) -> tuple[Trial, float] | None:
    """Return the same of the present `material` with brighter and darker base colours, fitted for half as
    long.

    settled: whether the present brightness was fitted together with the present metals; then it is kept, and
    None returned, where it is not clearly worse.
    """
    mean = float(material.mean_color)
    factors = [factor for factor in FACTORS if factor == 1 or DARKEST <= mean * factor <= BRIGHTEST]
    trials = [(mean * factor, material.rescaled(factor)) for factor in factors]
    steps = (material.config.trial_steps + 1) // 2
    return _best(samples, lights, mean, trials, steps, seed, rival=factors.index(1.0) if settled else None)


def _best(
    samples: Sequence[Sample],
    lights: Lights,
    mean: float,
    materials: Sequence[tuple[float, ScaledMaterial]],
    steps: int,
    seed: int,
    rival: int | None = None,
) -> tuple[Trial, float] | None:
    """Return the trial of the best of the `materials` and the best factor on it.

    None where it is as bright as the present one (`mean`), or not clearly better than the `rival`, one of
    them. materials: each with its mean linear base colour.
    """
    samples = [sample for sample in samples if len(sample.color) > 1]  # which halve
    if not samples:
        return None
    trials, found, surprises, starts = [], [], [], [start for start, _ in materials]
    for start, material in materials:
        trial = Trial(material, samples, lights, start / mean, seed)
        trial.fit(steps)
        trials.append(trial)
        found.append(trial.errors())
        surprises.append(trial.surprise())
    scores = [_score(errors) for errors in found]
    best = _likeliest(found, scores, surprises, starts)
    if rival is not None:
        defended = surprises[rival] - surprises[best] <= _UNLIKELY
        if defended and not _clearly_less(found[best], found[rival]):
            return None
    factor = _vertex(starts, scores, best) if scores[best] == min(scores) else 1.0
    ratio = starts[best] * factor / mean
    return None if 1 / _ALIKE <= ratio <= _ALIKE else (trials[best], factor)


def _score(errors: Tensor) -> float:
    """Return the logarithm of the disagreement (J, SPLITS) of all photos together, mean over splits."""
    return float(errors.nansum(0).clamp(min=1e-9).log().mean())


def _likeliest(
    found: Sequence[Tensor], scores: Sequence[float], surprises: Sequence[float], starts: Sequence[float]
) -> int:
    """Return which trial is most probable, by what parts disagree by, how unlikely its lights are, and what
    is usual.

    found: the disagreement (J, SPLITS) of each, scores: its `_score`; starts: its mean base colour. Lights
    that are unlikelier than others by less than `_UNLIKELY` are no evidence.
    """
    least = found[min(range(len(scores)), key=scores.__getitem__)]
    excess = [surprise - min(surprises) for surprise in surprises]
    costs = [
        _doubt(errors, least)
        + (more if more > _UNLIKELY else 0.0)
        + 0.5 * (math.log(start / _USUAL) / _SPREAD) ** 2
        for errors, more, start in zip(found, excess, starts, strict=True)
    ]
    return min(range(len(costs)), key=costs.__getitem__)


def _doubt(errors: Tensor, least: Tensor) -> float:
    """Return how unlikely it is, in ln probability, that parts disagree by (J, SPLITS) where the `least` is
    right.

    That of Student's t over the photos, to whose chance an error comes that all photos share, as of a wrong
    shape.
    """
    gain = _gains(least, errors)
    uncertainty = math.hypot(_CLEAR, standard_error(gain)) if len(gain) > 1 else _CLEAR
    if len(gain) == 0:
        return 0.0
    t = max(float(gain.mean()), 0.0) / uncertainty
    return 0.5 * len(gain) * math.log1p(t**2 / max(len(gain) - 1, 1))


def _clearly_less(errors: Tensor, rival: Tensor) -> bool:
    """Return whether disagreements (J, SPLITS) are less than the rival's by more than chance and a wrong
    shape make.
    """
    gain = _gains(errors, rival)
    uncertainty = standard_error(gain) if len(gain) > 1 else 0.0
    return float(gain.mean()) > max(_CLEAR, _SURE * uncertainty)


def _gains(errors: Tensor, rival: Tensor) -> Tensor:
    """Return how much less than the rival's disagreements (J, SPLITS) are, (K,), as shares of its mean over K
    photos.

    The K are those that both judge.
    """
    judged = ~(rival.isnan() | errors.isnan()).any(1)
    errors, rival = errors[judged], rival[judged]
    return (rival - errors).sum(1) / rival.sum(1).mean().clamp(min=1e-9)


def standard_error(values: Tensor) -> float:
    """Return the standard error of the mean of values (K,)."""
    return float(values.std()) / len(values) ** 0.5


def _vertex(starts: Sequence[float], errors: Sequence[float], best: int) -> float:
    """Return where the parabola through the least error and its neighbours is lowest, relative to the least
    one.
    """
    if not 0 < best < len(errors) - 1:
        return 1.0
    left, here, right = (math.log(starts[k]) for k in (best - 1, best, best + 1))
    below, least, above = (errors[k] for k in (best - 1, best, best + 1))
    first, second = (least - below) / (here - left), (above - least) / (right - here)
    slope = (second - first) / (right - left)
    return math.exp(0.5 * (left + here) - 0.5 * first / slope - here) if slope > 0 else 1.0
