"""Which of an object's materials are metal: each becomes metal, or no metal, and stays so where photos ask
for it.

No small step leads from paint to metal or back, and the price of metal holds back what is not sure. So once
the surface is nearly finished its points are sorted into a few materials by colour, roughness and metallic.
For each in turn a copy of the present material is made metal there, or no longer metal, and held so while
everything else, lights included, fits itself to it. Changes that are wrong in truth are worse by both
measures of `evidence` by far.
"""

import copy
import functools
import warnings
from dataclasses import dataclass

import scipy
import torch
from torch import Tensor

from lightprobe.core.device import draw_rows, generator
from lightprobe.reconstruction.material_field import ScaledMaterial
from lightprobe.reconstruction.trials.evidence import FEWEST_PHOTOS, Evidence
from lightprobe.reconstruction.trials.schedule import refit_steps
from lightprobe.reconstruction.trials.trial import Sample, Trial, TrialPhotos
from lightprobe.training import Descent, ParameterGroup

COUNT = 4  # materials that an object is sorted into; an object of fewer has some without points
_ROUNDS = 30  # of sorting
_ALIKE = 0.7, 2.0, 2.0  # weights of the logarithm of colours, of roughness and of metallic
_DARKEST = 0.02  # linear colour below which all are alike
_POINTS = 24_576  # of the surface, that are sorted into materials
_SMALLEST = 0.04  # share of the points that makes a material
_METAL, _NO_METAL = 0.95, 0.0  # what metallic is held at
_BRIGHTER = 1.5  # a metal has no diffuse light to help its colour
_SHARPEST = 0.4  # roughness of a new metal at most: a rougher one could not be told from paint
_FEWEST_PIXELS = 80  # of a material in a photo that judges it
_COPY_STEPS, _COPY_POINTS, _COPY_RATE = 250, 4096, 5e-3  # of fitting a field to another, in Adam's unit


@dataclass(frozen=True)
class Materials:
    """The few materials that an object is made of, as groups of surface points that are alike."""

    reference: ScaledMaterial  # as it was when they were found
    centres: Tensor  # (COUNT, 5) of the points' features

    @staticmethod
    @torch.no_grad()
    def of(material: ScaledMaterial, points: Tensor, seed: int) -> "Materials":
        """Sort points (N, 3) by colour, roughness and metallic; deterministic."""
        reference = copy.deepcopy(material)
        features = _features(reference(points)).cpu().numpy()
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # materials without points are no harm
            centres = scipy.cluster.vq.kmeans2(features, COUNT, iter=_ROUNDS, minit="++", seed=seed)[0]
        return Materials(reference, torch.from_numpy(centres).to(points))

    @torch.no_grad()
    def at(self, points: Tensor) -> Tensor:
        """Return which material points (N, 3) are of, (N,) int64 below COUNT."""
        return torch.cdist(_features(self.reference(points)), self.centres).argmin(1)

    def shares(self, points: Tensor) -> list[float]:
        """Return the share of points (N, 3) that each material has."""
        return (torch.bincount(self.at(points), minlength=COUNT) / len(points)).tolist()


def _features(material: Tensor) -> Tensor:
    """Return what materials (N, >= 5) are compared by, (N, 5)."""
    color, roughness, metallic = material[:, :3], material[:, 3:4], material[:, 4:5]
    of_color, of_roughness, of_metallic = _ALIKE
    features = [of_color * (color + _DARKEST).log(), of_roughness * roughness, of_metallic * metallic]
    return torch.cat(features, 1)


@dataclass(frozen=True)
class HeldMetallic:
    """The metallic of one material, given and not fitted: one of `ScaledMaterial.held`."""

    materials: Materials
    number: int
    metallic: float

    def __call__(self, points: Tensor, material: Tensor) -> Tensor:
        """Return the material (N, 8) of points (N, 3) with the given value."""
        here = (self.materials.at(points) == self.number)[:, None]
        metallic = torch.where(here, self.metallic, material[:, 4:5])
        return torch.cat([material[:, :4], metallic, material[:, 5:]], 1)


def best_metals(photos: TrialPhotos, material: ScaledMaterial) -> Trial | None:
    """Return the trial of the `material` with metal where photos ask for it, None where it stays as it is.

    Deterministic. The trial's lights belong to its material, whose metallic is held no longer.
    """
    if len(photos.samples) < FEWEST_PHOTOS:
        return None
    every, seed = torch.cat([sample.pixels.position for sample in photos.samples]), photos.seed
    rows = draw_rows(torch.arange(len(every), device=every.device), _POINTS, generator(seed, "metals/points"))
    points = every[rows]
    materials = Materials.of(material, points, seed)
    steps, accepted = refit_steps(material.config), []
    present = Trial(copy.deepcopy(material), photos, steps)
    for number, share in enumerate(materials.shares(points)):
        if share < _SMALLEST:
            continue
        part = functools.partial(_of_material, materials, number)
        before = Evidence.of(present, part, _FEWEST_PIXELS)
        trial = Trial(_changed(material, materials, number, points, seed), photos, steps)
        if Evidence.of(trial, part, _FEWEST_PIXELS).speaks_for_change(before):
            accepted.append(number)
    if not accepted:
        return None
    # All the changes are made together, fitted, and then held no longer. Normal offsets stay those of the
    # `material`: a trial's pictures have none, and its priors flatten them.
    changed = material
    for number in accepted:
        changed = _changed(changed, materials, number, points, seed)
    trial = Trial(changed, photos, steps)
    with torch.no_grad():
        fitted = trial.material(points)  # held values among them, which the field does not know
        fitted[:, 5:] = material(points)[:, 5:]
    trial.material.held = []
    _fit_field(trial.material, points, fitted, seed)
    return trial


def _of_material(materials: Materials, number: int, sample: Sample) -> Tensor:
    """Return the rows (K,) int64 of a sample's pixels that are of one of the materials."""
    return (materials.at(sample.pixels.position) == number).nonzero()[:, 0]


def _changed(
    material: ScaledMaterial, materials: Materials, number: int, points: Tensor, seed: int
) -> ScaledMaterial:
    """Return a copy that is metal in the material `number` where `material` is none there, or the other way."""
    with torch.no_grad():
        here, wanted = materials.at(points) == number, material(points)
        metal = float(wanted[here, 4].mean()) < 0.5
        held = HeldMetallic(materials, number, _METAL if metal else _NO_METAL)
        wanted[here, 4] = held.metallic
        wanted[here, :3] = (wanted[here, :3] * (_BRIGHTER if metal else 1 / _BRIGHTER)).clamp(max=0.95)
        if metal:
            wanted[here, 3] = wanted[here, 3].clamp(max=_SHARPEST)
    changed = copy.deepcopy(material)
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
