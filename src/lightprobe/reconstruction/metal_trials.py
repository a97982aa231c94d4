"""Which of an object's materials are metal: each is tried the other way, and kept so where that explains
photos better.

No small step leads from paint to metal or back, and the price of metal holds back what is not sure. So once
the surface is nearly finished its points are sorted into a few materials by colour, roughness and metallic.
For each in turn a copy of the present material is made metal there, or no longer metal, and held so while
everything else, lights included, fits itself to it for a short time, as the present material does.

Two things must speak for the change over the photos: the material's own pixels are explained better, by more
than chance; and each half of the object is explained no worse by the other half's light
(`reconstruction.agreement`), as a metal under a light that is free to bend explains its own pixels only too
well. Wrong changes are worse in both by far.
"""

import copy
import functools
from collections.abc import Sequence

import torch
from torch import Tensor

from lightprobe.core.device import draw_rows, generator
from lightprobe.reconstruction.change_evidence import FEWEST_PHOTOS, Evidence, disagreement_of
from lightprobe.reconstruction.lights import Lights
from lightprobe.reconstruction.material_trials import Sample, Trial
from lightprobe.reconstruction.materials import HeldMetallic, Materials
from lightprobe.reconstruction.scaled_material import ScaledMaterial
from lightprobe.training import Descent, ParameterGroup

_POINTS = 24_576  # of the surface, that are sorted into materials
_SMALLEST = 0.04  # share of the points that makes a material
_METAL, _NO_METAL = 0.95, 0.0  # what metallic is held at
_BRIGHTER = 1.5  # a metal has no diffuse light to help its colour
_SHARPEST = 0.4  # roughness of a new metal at most: a rougher one could not be told from paint
_FEWEST_PIXELS = 80  # of a material in a photo that judges it
_COPY_STEPS, _COPY_POINTS, _COPY_RATE = 250, 4096, 5e-3  # of fitting a field to another, in Adam's unit


def best_metals(
    samples: Sequence[Sample], lights: Lights, material: ScaledMaterial, seed: int
) -> Trial | None:
    """Return the trial of the `material` with metal where photos ask for it, None where it stays as it is.

    Deterministic. Its lights belong to it; its metallic is held no longer.
    """
    samples = [sample for sample in samples if len(sample.color) > 1]
    if len(samples) < FEWEST_PHOTOS:
        return None
    points = _drawn(samples, seed)
    materials = Materials.of(material, points, seed)
    steps, accepted = (material.config.trial_steps + 1) // 2, []
    present = Trial(copy.deepcopy(material), samples, lights, 1.0, seed)
    present.fit(steps)
    disagreement = disagreement_of(present)
    for number, share in enumerate(materials.shares(points)):
        if share < _SMALLEST:
            continue
        held = _changed(material, materials, number, points, seed)
        trial = Trial(held, samples, lights, 1.0, seed)
        trial.fit(steps)
        part = functools.partial(_of_material, materials, number)
        before = Evidence.of(present, part, _FEWEST_PIXELS, disagreement)
        if Evidence.of(trial, part, _FEWEST_PIXELS).speaks_for_change(before):
            accepted.append(number)
    return _with_all(accepted, material, materials, points, samples, lights, seed)


def _drawn(samples: Sequence[Sample], seed: int) -> Tensor:
    """Return points (N, 3) of the surface, drawn from all photos' pixels."""
    every = torch.cat([sample.pixels.position for sample in samples])
    rows = draw_rows(torch.arange(len(every), device=every.device), _POINTS, generator(seed, "metals/points"))
    return every[rows]


def _changed(
    material: ScaledMaterial, materials: Materials, number: int, points: Tensor, seed: int
) -> ScaledMaterial:
    """Return a copy of the material that is metal in one of the materials where it was none, or the other
    way.
    """
    with torch.no_grad():
        here = materials.at(points) == number
        metal = float(material(points)[here, 4].mean()) < 0.5
    held = HeldMetallic(materials, number, _METAL if metal else _NO_METAL)

    def target(values: Tensor, where: Tensor) -> Tensor:
        values = values.clone()
        values[where, 4] = held.metallic
        values[where, :3] = (values[where, :3] * (_BRIGHTER if metal else 1 / _BRIGHTER)).clamp(max=0.95)
        if metal:
            values[where, 3] = values[where, 3].clamp(max=_SHARPEST)
        return values

    changed = copy.deepcopy(material)
    with torch.no_grad():
        wanted = target(material(points), here)
    _fit_field(changed, points, wanted, seed)
    changed.held = [*changed.held, held]
    return changed


def _fit_field(material: ScaledMaterial, points: Tensor, wanted: Tensor, seed: int) -> None:
    """Fit a field to materials (N, 8) at points (N, 3), normal offsets included, as one network has them all."""
    descent = Descent(
        [ParameterGroup(dict(material.field.named_parameters()), _COPY_RATE)],
        lambda rows: (material(points[rows]) - wanted[rows]).square().mean(),
        betas=(0.9, 0.99),
        epsilon=1e-12,
        fused=True,
    )
    every = torch.arange(len(points), device=points.device)
    for step in range(_COPY_STEPS):
        descent.step(step, draw_rows(every, _COPY_POINTS, generator(seed, "metals/copy", step)))
    descent.end()


def _of_material(materials: Materials, number: int, sample: Sample) -> Tensor:
    """Return the rows (K,) int64 of a sample's pixels that are of one of the materials."""
    return (materials.at(sample.pixels.position) == number).nonzero()[:, 0]


def _with_all(
    numbers: Sequence[int],
    material: ScaledMaterial,
    materials: Materials,
    points: Tensor,
    samples: Sequence[Sample],
    lights: Lights,
    seed: int,
) -> Trial | None:
    """Return the trial in which all the changes are made together, fitted, and then let go.

    Normal offsets are those of the `material`: a trial's pictures have none, and its priors flatten them.
    """
    if not numbers:
        return None
    changed = material
    for number in numbers:
        changed = _changed(changed, materials, number, points, seed)
    trial = Trial(changed, samples, lights, 1.0, seed)
    trial.fit((material.config.trial_steps + 1) // 2)
    with torch.no_grad():
        fitted = trial.material(points)  # held values among them, which the field does not know
        fitted[:, 5:] = material(points)[:, 5:]
    trial.material.held = []
    _fit_field(trial.material, points, fitted, seed)
    return trial
