"""The first two passes' objective: whole photos, silhouettes included, one per step."""

from collections.abc import Mapping
from dataclasses import dataclass

import torch
from torch import Tensor

from lightprobe.core.checkpoint import copy_stored
from lightprobe.core.config import DecomposeConfig, ImageLoss
from lightprobe.core.device import generator, to_device
from lightprobe.reconstruction.lattice_model import LatticeModel, RasterisedView
from lightprobe.reconstruction.lights import Lights
from lightprobe.reconstruction.losses import frame_loss, grey_world, image_loss, metal_parsimony
from lightprobe.reconstruction.photos import Target
from lightprobe.reconstruction.surface_model import SurfaceModel
from lightprobe.reconstruction.trials.brightness import (
    CHOICE_PHOTOS,
    best_new,
    best_rescaled,
    choose_brightness,
)
from lightprobe.reconstruction.trials.cavities import best_opening, has_doubtful_lid
from lightprobe.reconstruction.trials.metals import best_metals
from lightprobe.reconstruction.trials.schedule import CHOICES, lids_tried, trials_at
from lightprobe.reconstruction.trials.trial import PassPhotos, Trial
from lightprobe.render.gbuffer import GBuffer
from lightprobe.render.silhouette import coverage, silhouette_crossings, spread_color
from lightprobe.render.split_sum import shade
from lightprobe.training import ParameterGroup, Stage
from lightprobe.training.loop import visited

_PARSIMONY = 0.02  # weight of the entropy of the metals' base colours
_POINTS = 512  # whose materials are compared for it in a step


class PassObjective:
    """What the tasks of all passes share: what a checkpoint holds beside parameters, and valid ranges."""

    model: LatticeModel | SurfaceModel
    lights: Lights

    def buffers(self) -> dict[str, Tensor]:
        """Return what the model has chosen, and the lights that are solved."""
        solved = {} if self.lights.gradient else {"lights": self.lights.stacked()}
        return {**self.model.chosen(), **solved}

    def load_buffers(self, tensors: Mapping[str, Tensor]) -> None:
        """Take over buffers; raise `KeyError` or `ValueError` where they do not fit."""
        copy_stored(tensors, self.model.chosen())
        if not self.lights.gradient:
            self.lights.load(tensors["lights"])

    def project(self) -> None:
        """Bring the model's parameters and the lights back into their valid ranges."""
        self.model.project()
        self.lights.clamp()


@dataclass
class ImageObjective(PassObjective):
    """Fit a model and the lights to photos, one after the other."""

    recordable = False  # each photo covers another number of pixels
    model: LatticeModel | SurfaceModel
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
        """Renew the shadows; in the first pass also try changes, and brightnesses that the lights make up for."""
        self.model.update_visibility()
        if iteration == 0 or not self.config.priors:
            return
        photos = PassPhotos(self.targets, self.lights, fraction, self.seed)
        if isinstance(self.model, LatticeModel) and iteration in (trials := trials_at(self.config)):
            self._try_changes(self.model, photos, first=iteration == min(trials))
        step = self.stage.first_step + iteration
        if step <= CHOICES * self.config.checkpoint_every:
            shown = photos.evenly(CHOICE_PHOTOS).shown(self.model)
            factor = choose_brightness(shown, self.lights, step, float(self.model.mean_color))
            self.model.brighten(factor)
            self.lights.dim(factor)

    def _try_changes(self, model: LatticeModel, every: PassPhotos, *, first: bool) -> None:
        """Make the first or the second trial's changes that photos ask for (`reconstruction.trials`)."""
        if first:
            if model.lid_in_doubt:
                model.lid_in_doubt.fill_(has_doubtful_lid(model, every))
        else:
            model.lid_in_doubt.fill_(False)
            if lids_tried(self.config) and (opening := best_opening(model, every)) is not None:
                model.reshape(opening.distance)
                self._take_over(model, opening.trial)
        mean, photos = float(model.mean_color), every.of_trial(model)
        if first:
            best = best_new(photos, model.material)
        else:
            metals = best_metals(photos, model.material)
            if metals is not None:
                self._take_over(model, metals)
            # A brightness that the wrong metals had grown used to is not defended.
            best = best_rescaled(photos, model.material, settled=metals is None)
        if best is None:
            return
        trial, factor = best
        self.lights.dim(float(trial.material.mean_color) / mean)
        self._take_over(model, trial)
        model.brighten(factor)
        self.lights.dim(factor)

    def _take_over(self, model: LatticeModel, trial: Trial) -> None:
        """Give the model a trial's material and lights."""
        for name, light in trial.lights.items():
            self.lights.replace(name, light)
        model.material.take_over(trial.material)
        model.update_visibility()

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
        random = generator(self.seed, "background", step)
        background = to_device(torch.rand(3, generator=random), radiance.device)
        kind, weight = self.config.image_loss, self.config.coverage_weight
        if kind is ImageLoss.OBJECT:
            loss = image_loss(image, cover, target, background, weight)
        else:
            loss = frame_loss(image, cover, target, background, weight, kind)
        loss = loss + seen.regularisation
        if self.config.priors:
            loss = loss + grey_world(seen.gbuffer.base_color, self.lights.color_cast())
            loss = loss + self._few_metals(seen.gbuffer, step)
        return loss

    def _few_metals(self, gbuffer: GBuffer, step: int) -> Tensor:
        """Return the weighted entropy of the metals at some of the points of a G-buffer.

        It sets in over the first pass's second quarter; the third pass has none.
        """
        weight = _PARSIMONY * min(1.0, max(0.0, step / (0.25 * self.config.pass1_iterations) - 1))
        if weight == 0 or len(gbuffer.pixel) == 0:
            return gbuffer.base_color.new_zeros(())
        random = generator(self.seed, "parsimony", step)
        drawn = torch.randint(0, len(gbuffer.pixel), (_POINTS,), generator=random)
        rows = to_device(drawn, gbuffer.pixel.device)
        material = (gbuffer.base_color, gbuffer.roughness, gbuffer.metallic)
        return weight * metal_parsimony(*(channel.index_select(0, rows) for channel in material))

    def target(self, iteration: int) -> Target:
        """Return the photo of a step."""
        return self.targets[visited(self.seed, f"order/{self.stage.name}", len(self.targets), iteration)]
