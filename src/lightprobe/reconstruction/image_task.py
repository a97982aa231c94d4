"""The first two passes' task: whole photos, silhouettes included, one per step."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Protocol

import torch
from torch import Tensor

from lightprobe.core.config import DecomposeConfig, ImageLoss
from lightprobe.core.device import generator, to_device
from lightprobe.reconstruction.cavity_trials import best_opening, has_doubtful_lid
from lightprobe.reconstruction.frame_loss import frame_loss
from lightprobe.reconstruction.gauge import CHOICES, choose_brightness, evenly_spaced, lids_tried, trials_at
from lightprobe.reconstruction.lattice_model import LatticeModel, RasterisedView
from lightprobe.reconstruction.lights import Lights
from lightprobe.reconstruction.losses import color_gauge, image_loss, metal_parsimony
from lightprobe.reconstruction.material_trials import PHOTOS, Sample, Trial, best_new, best_rescaled
from lightprobe.reconstruction.metal_trials import best_metals
from lightprobe.reconstruction.pass_task import PassTask, Unknowns
from lightprobe.reconstruction.photos import Target
from lightprobe.render.gbuffer import GBuffer
from lightprobe.render.silhouette import coverage, silhouette_crossings, spread_color
from lightprobe.render.split_sum import shade
from lightprobe.render.surface import View
from lightprobe.training import ParameterGroup, Stage
from lightprobe.training.loop import visited

_POINTS = 512  # whose materials are compared in a step


class Model(Unknowns, Protocol):
    """The unknowns of a pass."""

    @property
    def mean_color(self) -> Tensor:
        """The mean () that base colours are held at."""

    def groups(self) -> list[ParameterGroup]:
        """Return the trained parameters and their rates."""

    def rasterise(self, view: View, step: int, progress: float) -> RasterisedView:
        """Return what a camera sees, and the regularisation loss."""

    def gbuffers(self, views: Sequence[View], progress: float) -> Iterator[GBuffer]:
        """Yield the G-buffers of the present surface in several views, without gradient."""

    def update_visibility(self) -> None:
        """Update what follows the surface only now and then: its shadows, and the colours it sees around it."""

    def brighten(self, factor: float) -> None:
        """Multiply all base colours, and the mean they are held at, by `factor`."""


@dataclass
class ImageTask(PassTask):
    """Fit a model and the lights to photos, one after the other."""

    model: Model
    targets: list[Target]
    lights: Lights
    stage: Stage
    config: DecomposeConfig
    seed: int

    def groups(self) -> list[ParameterGroup]:
        """Return the parameters of the model, and the lights that are fitted by gradients."""
        return [*self.model.groups(), *self.lights.groups()]

    def photos(self, iteration: int) -> str:
        """Return the name of the photo of a step, in quotes."""
        return f"'{self.target(iteration).name}'"

    def refresh(self, iteration: int, fraction: float) -> None:
        """Renew the shadows; in the first pass also choose the brightness, its product with each light kept."""
        self.model.update_visibility()
        if iteration == 0 or self.config.brightness_anchor == 0:
            return
        if isinstance(self.model, LatticeModel) and iteration in (trials := trials_at(self.config)):
            self._try_materials(self.model, fraction, anew=iteration == min(trials))
        step = self.stage.first_step + iteration
        if step <= CHOICES * self.config.checkpoint_every:
            self._choose_brightness(step, fraction)

    def _choose_brightness(self, step: int, fraction: float) -> None:
        """Multiply the base colours by the best factor near 1, and divide the lights by it."""
        chosen = evenly_spaced(self.targets)
        shown = zip(chosen, self.model.gbuffers([target.view for target in chosen], fraction), strict=True)
        mean = float(self.model.mean_color)
        factor = choose_brightness(shown, self.lights, step, mean)
        self.model.brighten(factor)
        self.lights.dim(factor)

    def _try_materials(self, model: LatticeModel, fraction: float, *, anew: bool) -> None:
        """Give the model the material of another brightness, new or rescaled, where parts agree better under
        it.

        A new one also finds out whether there are lids in doubt, a rescaled one opens them first.
        """
        if anew:
            self._look_for_lids(model, fraction)
        else:
            self._open_cavities(model, fraction)
        chosen, mean = evenly_spaced(self.targets, PHOTOS), float(model.mean_color)
        shown = zip(chosen, model.gbuffers([target.view for target in chosen], fraction), strict=True)
        samples = [Sample.of(target, gbuffer, self.seed) for target, gbuffer in shown]
        if anew:
            best = best_new(samples, self.lights, model.material, self.seed)
        else:
            metals = best_metals(samples, self.lights, model.material, self.seed)
            if metals is not None:
                self._take_over(model, metals)
            best = best_rescaled(samples, self.lights, model.material, self.seed, settled=metals is None)
        if best is None:
            return
        trial, factor = best
        self.lights.dim(float(trial.material.mean_color) / mean)
        self._take_over(model, trial)
        model.brighten(factor)
        self.lights.dim(factor)

    def _look_for_lids(self, model: LatticeModel, fraction: float) -> None:
        """Tell a model that waits for it whether it has a lid that may have to be opened."""
        if model.lid_in_doubt:
            model.lid_in_doubt.fill_(has_doubtful_lid(model, self.targets, self.lights, fraction, self.seed))

    def _open_cavities(self, model: LatticeModel, fraction: float) -> None:
        """Give the model the cavities that photos ask for; a network of distances cannot be given any."""
        model.lid_in_doubt.fill_(False)
        if not lids_tried(self.config):
            return
        opening = best_opening(model, self.targets, self.lights, fraction, self.seed)
        if opening is not None:
            model.reshape(opening.distance)
            self._take_over(model, opening.trial)

    def _take_over(self, model: LatticeModel, trial: Trial) -> None:
        """Give the model a trial's material and lights."""
        for name, light in trial.lights.items():
            self.lights.replace(name, light)
        model.material.take_over(trial.material)
        model.update_visibility()

    @property
    def recordable(self) -> bool:
        """Whether a step depends on what it is given alone: no, each photo covers another number of pixels."""
        return False

    def given(self, iteration: int) -> tuple[Tensor, ...]:
        """Return nothing, as `loss` finds its photo by itself."""
        return ()

    def loss(self, iteration: int, fraction: float, *given: Tensor) -> Tensor:
        """Return the loss () of one photo: image, coverage, light and model regularisation."""
        target, step = self.target(iteration), self.stage.first_step + iteration
        seen = self.model.rasterise(target.view, step, fraction)
        levels, light_loss = self.lights.levels(target, seen.gbuffer, step)
        radiance = shade(seen.gbuffer, self.lights.prefilter, levels)
        return self.compare(target, seen, radiance, step) + light_loss

    def compare(self, target: Target, seen: RasterisedView, radiance: Tensor, step: int) -> Tensor:
        """Return the loss of a photo shaded to `radiance` (K, 3), all but the light's own."""
        pixel, view = seen.gbuffer.pixel, target.view
        crossings = silhouette_crossings(seen.screen, seen.faces, seen.edges, pixel, view)
        cover = coverage(pixel, crossings, view.height * view.width)
        image = spread_color(radiance, pixel, crossings, cover)
        background = to_device(
            torch.rand(3, generator=generator(self.seed, "background", step)), radiance.device
        )
        kind, weight = self.config.image_loss, self.config.coverage_weight
        if kind is ImageLoss.OBJECT:
            loss = image_loss(image, cover, target, background, weight)
        else:
            loss = frame_loss(image, cover, target.color, target.alpha, background, weight, kind)
        loss = loss + seen.regularisation
        if self.config.color_gauge > 0:  # the cast takes a look at every light
            loss = loss + self.config.color_gauge * color_gauge(
                seen.gbuffer.base_color, self.lights.color_cast()
            )
        return loss + self._few_metals(seen.gbuffer, step)

    def _few_metals(self, gbuffer: GBuffer, step: int) -> Tensor:
        """Return the weighted entropy of the metals at some of the points of a G-buffer."""
        weight = self.config.parsimony * min(1.0, max(0.0, step / (0.25 * self.config.pass1_iterations) - 1))
        if weight == 0 or len(gbuffer.pixel) == 0:
            return gbuffer.base_color.new_zeros(())
        random = generator(self.seed, "parsimony", step)
        rows = to_device(
            torch.randint(0, len(gbuffer.pixel), (_POINTS,), generator=random), gbuffer.pixel.device
        )
        material = (gbuffer.base_color, gbuffer.roughness, gbuffer.metallic)
        return weight * metal_parsimony(*(channel.index_select(0, rows) for channel in material))

    def target(self, iteration: int) -> Target:
        """Return the photo of a step."""
        return self.targets[visited(self.seed, f"order/{self.stage.name}", len(self.targets), iteration)]
