"""A material that is fitted on a fixed surface for a short time, with lights of its own."""

import functools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from lightprobe.core.device import draw_rows, generator
from lightprobe.light.photometry import displayed_error
from lightprobe.reconstruction.lattice_model import LatticeModel
from lightprobe.reconstruction.lights import Lights, LightSolver
from lightprobe.reconstruction.material_field import MATERIAL_RATE, ScaledMaterial
from lightprobe.reconstruction.photos import Target, evenly_spaced
from lightprobe.reconstruction.surface_model import SurfaceModel
from lightprobe.reconstruction.trials.disagreement import SPLITS, disagreement
from lightprobe.reconstruction.trials.plausibility import (
    BackgroundLevel,
    MetalReflectance,
    ViewLightCorrelation,
)
from lightprobe.render.gbuffer import GBuffer
from lightprobe.render.split_sum import shade_under
from lightprobe.scene.camera import mean_up
from lightprobe.training import Descent, ParameterGroup

PHOTOS = 32  # that a trial learns from
_PIXELS = 1536  # of each photo
_RATE = 2.0  # of the pass's material, as the trial is short
_JUDGES = 8  # of the photos, or up to twice as many where their number is no multiple of it


@dataclass(frozen=True)
class Sample:
    """Some pixels of a photo on the present surface."""

    name: str
    pixels: GBuffer  # P pixels
    color: Tensor  # (P, 3) linear
    clipped: Tensor  # (P, 3) bool
    covered: float  # share of the photo that the object covers
    up: Tensor  # (3,) the camera's upward axis
    background_level: float | None = None  # as `Target.background_level`

    @staticmethod
    def of(target: Target, gbuffer: GBuffer, seed: int) -> "Sample":
        """Return pixels of a photo that lie wholly inside its mask, drawn at random."""
        inside = target.inside(gbuffer.pixel)
        rows = draw_rows(inside, _PIXELS, generator(seed, f"trial/{target.name}"))
        pixels = gbuffer.select(rows)
        covered = len(gbuffer.pixel) / (gbuffer.height * gbuffer.width)
        color, clipped = target.color[pixels.pixel], target.clipped[pixels.pixel]
        up, background = target.view.rotation[:, 1], target.background_level
        return Sample(target.name, pixels, color, clipped, covered, up, background)

    def of_material(self, material: Tensor) -> GBuffer:
        """Return the pixels with a material (P, 8), its normal offsets left out."""
        return replace(
            self.pixels, base_color=material[:, :3], roughness=material[:, 3], metallic=material[:, 4]
        )


@dataclass(frozen=True)
class TrialPhotos:
    """What all trials of a surface start from: pixels of photos, and the photos' present lights."""

    samples: Sequence[Sample]
    lights: Lights
    seed: int


@dataclass(frozen=True)
class PassPhotos:
    """The photos and their lights at some time in a pass."""

    targets: Sequence[Target]
    lights: Lights
    fraction: float  # share of the pass that is done
    seed: int

    def evenly(self, count: int) -> "PassPhotos":
        """Return some of the photos, spread evenly over all."""
        return replace(self, targets=evenly_spaced(self.targets, count))

    def shown(self, model: LatticeModel | SurfaceModel) -> Iterator[tuple[Target, GBuffer]]:
        """Yield each photo with the model's G-buffer in it, one at a time."""
        views = [target.view for target in self.targets]
        yield from zip(self.targets, model.gbuffers(views, self.fraction), strict=True)

    def of_trial(self, model: LatticeModel) -> TrialPhotos:
        """Return the pixels that `PHOTOS` of the photos show of the model, without photos too small to halve."""
        samples = [Sample.of(*shown, self.seed) for shown in self.evenly(PHOTOS).shown(model)]
        return TrialPhotos([sample for sample in samples if len(sample.color) > 1], self.lights, self.seed)


class Trial:
    """A material fitted on a fixed surface, and its lights."""

    def __init__(self, material: ScaledMaterial, photos: TrialPhotos, steps: int, factor: float = 1.0):
        """Fit a material, which is changed, from the photos' lights divided by `factor`; one photo a step.

        What the samples see of the object keeps its present colours, whatever the material's brightness:
        docs/decisions/brightness-once-more.md.
        """
        samples, lights = photos.samples, photos.lights
        self.material, self.samples, self.seed, self._pass_lights = material, samples, photos.seed, lights
        self.lights = {s.name: lights.maps[lights.index[s.name]].detach() / factor for s in samples}
        device = lights.maps[0].device
        self._solver = LightSolver(material.config, device, _PIXELS // 2)
        descent = Descent(
            [ParameterGroup(dict(material.named_parameters()), _RATE * MATERIAL_RATE)],
            self._loss,
            schedule=lambda rate, step: rate * 0.1 ** (step / steps),
            betas=(0.9, 0.99),
            epsilon=1e-12,
            fused=True,
        )
        for step in range(steps):
            descent.step(step, samples[step % len(samples)], step)
        descent.end()

    def _loss(self, sample: Sample, step: int) -> Tensor:
        material = self.material(sample.pixels.position)
        pixels, color, clipped = sample.of_material(material), sample.color, sample.clipped
        random = generator(self.seed, f"trial-halves/{sample.name}", step)
        order = torch.randperm(len(color), generator=random)
        solved, fitted = order.to(color.device).tensor_split(2)
        pull = self._pass_lights.pull(sample.name, self.lights)
        light = self._solver(color, clipped, pixels, solved, self.lights[sample.name], pull)
        self.lights[sample.name] = light
        image = displayed_error(shade_under(pixels.select(fitted), light), color[fitted], clipped[fitted])
        return image + self.material.loss(sample.pixels.position, material, step, sample.covered)

    @torch.no_grad()
    def disagreements(self, photos: int = _JUDGES) -> Tensor:
        """Return by how much halves of the object disagree about the lights of some photos, (J, SPLITS)
        float64.

        It is nan for photos that show too little of the object to be halved.
        """
        judges = self.samples[:: max(1, len(self.samples) // photos)]
        found = torch.full((len(judges), SPLITS), torch.nan, dtype=torch.float64)
        for row, sample in zip(found, judges, strict=True):
            pixels = sample.of_material(self.material(sample.pixels.position))
            random = generator(self.seed, f"halves/{sample.name}")
            light = self.lights[sample.name]
            own = disagreement(pixels, sample.color, sample.clipped, light, self.material.config, random)
            if own is not None:
                row.copy_(own)
        return found

    @functools.cached_property
    def disagreement(self) -> Tensor:
        """The disagreement of halves in each photo, (J,) float64; it takes long to find."""
        return self.disagreements(len(self.samples)).sum(1)

    @torch.no_grad()
    def part_error(self, sample: Sample, rows: Tensor) -> float:
        """Return the displayed error of the rows (K,) int64 of a sample's pixels."""
        pixels = sample.of_material(self.material(sample.pixels.position)).select(rows)
        image = shade_under(pixels, self.lights[sample.name])
        return float(displayed_error(image, sample.color[rows], sample.clipped[rows]))

    def lights_nll(self) -> float:
        """Return how implausible the lights are with these cameras and backgrounds, in -ln probability."""
        lights = [self.lights[sample.name] for sample in self.samples]
        up = torch.from_numpy(mean_up([sample.up.cpu().numpy() for sample in self.samples])).float()
        towards = [sample.pixels.view.mean(0) for sample in self.samples]
        correlation = ViewLightCorrelation.of(lights, towards, up)
        background = BackgroundLevel.of(lights, [sample.background_level for sample in self.samples])
        return sum(evidence.nll for evidence in (correlation, background) if evidence is not None)

    @torch.no_grad()
    def metals(self) -> MetalReflectance:
        """Return how much of what the samples show is metal, and how plausible its colours are."""
        material = self.material(torch.cat([sample.pixels.position for sample in self.samples]))
        return MetalReflectance.of(material[:, :3], material[:, 4])
