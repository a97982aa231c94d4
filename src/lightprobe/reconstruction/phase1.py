"""Phase I from start to end: visual hull, first pass, bake, second and third pass, final lights, verdict."""

import statistics
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import torch
from torch import Tensor

from lightprobe.core.config import DecomposeConfig
from lightprobe.core.device import full_precision
from lightprobe.light.environment import Environment
from lightprobe.models.decomposition import Decomposition
from lightprobe.reconstruction.bake import bake, fill_unseen
from lightprobe.reconstruction.image_objective import ImageObjective
from lightprobe.reconstruction.lattice_model import LatticeModel
from lightprobe.reconstruction.lights import NO_PULL, LightPull, Lights
from lightprobe.reconstruction.photos import Target, evenly_spaced, load_targets
from lightprobe.reconstruction.start import start_shape
from lightprobe.reconstruction.surface_model import SurfaceModel
from lightprobe.reconstruction.texture_objective import PhotoPixels, TextureObjective
from lightprobe.reconstruction.trials.plausibility import (
    BackgroundLevel,
    ViewLightCorrelation,
    background_level,
)
from lightprobe.reconstruction.validation import fit_light, judge_object, validate
from lightprobe.render.asset import Asset
from lightprobe.render.seen_light import SeenLight, seen_together
from lightprobe.scene.background import load_background
from lightprobe.scene.camera import up_of
from lightprobe.scene.photo import Photo, Scene
from lightprobe.training import Progress, Resumed, Stage, Training
from lightprobe.training.descent import exponential

_JUDGES = 8  # photos that an object is judged by where none was held out
_EPSILON = 1e-12  # that Adam adds to the root of the mean of squared gradients
_LIGHTS = "lights"  # beside the asset's tensors, of what a pass starts from


@dataclass(frozen=True)
class AssetAndLights:
    """What a pass starts from, or ends with."""

    asset: Asset
    lights: Tensor  # (N, 6, R, R, 3), one for each fitted photo

    def tensors(self) -> dict[str, Tensor]:
        """Return the asset's tensors and the lights by name."""
        return {**self.asset.tensors(), _LIGHTS: self.lights}

    @staticmethod
    def of(tensors: dict[str, Tensor], device: torch.device) -> "AssetAndLights":
        """Return asset and lights from their `tensors`; raise `KeyError` or `InputError` for other tensors."""
        parts = {name: tensor for name, tensor in tensors.items() if name != _LIGHTS}
        asset = Asset.from_tensors(parts, Path("the object of this pass"), "begin anew with --restart")
        return AssetAndLights(asset.to(device), tensors[_LIGHTS].to(device))


def stages(config: DecomposeConfig) -> tuple[Stage, Stage, Stage]:
    """Return the three passes, each with its place in the phase's count of steps."""
    lengths = config.pass1_iterations, config.pass2_iterations, config.pass3_iterations
    found, first = [], 0
    for number, length in enumerate(lengths, start=1):
        schedule = exponential(length, config.warm_up_steps if number == 2 else 0)
        found.append(Stage(f"pass{number}", first, length, schedule, (0.9, config.adam_decay), _EPSILON))
        first += length
    return found[0], found[1], found[2]


def split_validation(photos: tuple[Photo, ...], count: int) -> tuple[list[Photo], list[Photo]]:
    """Return (fitted, held out) photos; at most an eighth is held out, spread evenly over the list."""
    chosen = evenly_spaced(range(len(photos)), min(count, len(photos) // 8))
    return [p for i, p in enumerate(photos) if i not in chosen], [photos[i] for i in chosen]


def decompose(
    scene: Scene,
    config: DecomposeConfig | None = None,
    device: torch.device | None = None,
    seed: int = 0,
    progress: Progress | None = None,
) -> Decomposition:
    """Return mesh, textures and one environment per training photo of a scene (paper, section 3.1).

    With `progress.checkpoints`, an interrupted call goes on from the newest one and ends with the same bits
    on a CPU. Raises `ConvergenceError` when nothing usable comes out.
    """
    config, device = config or DecomposeConfig(), full_precision(device or torch.device("cpu"))
    first, second, third = passes = stages(config)
    progress = progress or Progress()
    training = Training("Phase I", asdict(config), seed, passes, config.checkpoint_every, progress)
    resumed = training.latest()
    # Before a checkpoint is used: a photo that cannot be read is no fault of it.
    surroundings = _Surroundings.of(scene, config, device)
    photos = split_validation(scene.train, config.validation_photos)
    phase = _Phase(scene, config, device, seed, training, surroundings, *photos)
    if resumed is None or resumed.stage == first.name:
        start, resumed = phase.first_pass(first, resumed), None
        training.begin(second, start.tensors())
    else:
        with training.restoring(resumed.step):
            start = AssetAndLights.of(resumed.start, device)
            phase.lights(start.lights)  # raises where they are another training's
    if resumed is None or resumed.stage == second.name:
        start, resumed = phase.second_pass(second, start, resumed), None
        training.begin(third, start.tensors())
    return phase.finished(phase.third_pass(third, start, resumed))


@dataclass(frozen=True)
class _Surroundings:
    """What training photos show around the object, by name."""

    levels: dict[str, float | None]  # as `background_level` has them
    seen: dict[str, SeenLight]  # of their lights; empty where the plane that the object stands on is unknown

    @staticmethod
    def of(scene: Scene, config: DecomposeConfig, device: torch.device) -> "_Surroundings":
        """Read the photos, each once, as they may be large."""
        similarity = scene.similarity
        plane = None if scene.support is None else scene.support.normalised(similarity)
        resolution = max(config.light_resolution, config.teacher_resolution)
        levels: dict[str, float | None] = {}
        places: dict[tuple[str | None, str], dict[str, SeenLight]] = {}
        for photo in scene.train:
            background = load_background(photo)
            levels[photo.name] = background_level(background)
            if background is not None and plane is not None:
                background = replace(background, camera=background.camera.normalised(similarity))
                shown = SeenLight.of(background, resolution, device, plane)
                place = photo.light_group, "" if photo.light_group else photo.name
                places.setdefault(place, {})[photo.name] = shown
        seen = {
            name: light
            for photos in places.values()
            for name, light in zip(photos, seen_together(list(photos.values())), strict=True)
        }
        return _Surroundings(levels, seen)


@dataclass(frozen=True)
class _Phase:
    """What every step of Phase I needs to know, and these steps."""

    scene: Scene
    config: DecomposeConfig
    device: torch.device
    seed: int
    training: Training
    surroundings: _Surroundings
    fitted: list[Photo]
    held_out: list[Photo]

    def targets(self, photos: list[Photo], side: int) -> list[Target]:
        """Return photos as tensors of at most `side` pixels."""
        return load_targets(self.scene, photos, side, self.device)

    def lights(self, stacked: Tensor | None = None) -> Lights:
        """Return the fitted photos' lights, grey or those given; raise `ValueError` when one is missing."""
        names, groups = [p.name for p in self.fitted], [p.light_group for p in self.fitted]
        lights = Lights(names, self.config, self.device, self.seed, groups, self.surroundings.seen)
        if stacked is not None:
            lights.load(stacked)
        return lights

    def first_pass(self, stage: Stage, resumed: Resumed | None) -> AssetAndLights:
        """Fit lattice and field, bake them, and return what the second pass starts from."""
        config, levels = self.config, self.surroundings.levels
        targets = self.targets(self.fitted, config.pass1_side)
        targets = [replace(target, background_level=levels[target.name]) for target in targets]
        start = start_shape(self.scene, config, self.seed, self.fitted, targets)
        model, lights = LatticeModel(start, config, self.device, self.seed), self.lights()
        self.training.run(ImageObjective(model, targets, lights, stage, config, self.seed), stage, resumed)
        fill_unseen(model, [target.view for target in targets])
        # Baking ends the first pass for good: the unwrapper's time limit must not change a resumed run.
        return AssetAndLights(bake(model, config, self.device, self.training.progress.tell), lights.stacked())

    def second_pass(self, stage: Stage, start: AssetAndLights, resumed: Resumed | None) -> AssetAndLights:
        """Refine the baked asset, vertices and textures, and return what the third pass starts from."""
        if self.config.pass2_iterations == 0:
            return start
        model, lights = SurfaceModel(start.asset, self.config, self.seed), self.lights(start.lights)
        targets = self.targets(self.fitted, self.config.pass2_side)
        objective = ImageObjective(model, targets, lights, stage, self.config, self.seed)
        self.training.run(objective, stage, resumed, start.tensors())
        return self._best(stage, start, [model.asset()], lights)

    def third_pass(self, stage: Stage, start: AssetAndLights, resumed: Resumed | None) -> AssetAndLights:
        """Refine the textures at the photos' full size, where that shows more than the second pass could see."""
        config, asset = self.config, start.asset
        longest = (max(photo.camera.width, photo.camera.height) for photo in self.fitted)
        side = statistics.median(min(side, config.pass3_side) for side in longest)
        if config.pass3_iterations == 0 or side <= config.pass2_side:
            return start
        loaded = (self.targets([photo], config.pass3_side)[0] for photo in self.fitted)
        pixels = [PhotoPixels.of(asset, target, self.seed) for target in loaded]
        before = asset.textures.resized(max(config.pass3_texture_size, asset.textures.size))
        model = SurfaceModel(replace(asset, textures=before), config, self.seed)
        lights, pixels = self.lights(start.lights), [photo for photo in pixels if len(photo.color) > 0]
        objective = TextureObjective(model, pixels, lights, stage, config, self.seed)
        self.training.run(objective, stage, resumed, start.tensors())
        refined = model.asset()
        # Detail that only explains errors of the lights is worse than none; halfway is often better than either.
        halfway = replace(refined, textures=before.halfway(refined.textures))
        return self._best(stage, start, [halfway, refined], lights)

    def _best(
        self, stage: Stage, start: AssetAndLights, assets: list[Asset], lights: Lights
    ) -> AssetAndLights:
        """Return the asset that explains held-out photos best, with its lights; the last one without such photos.

        Where the asset from before the stage, `start`, is the best one, so are its lights.
        """
        targets = self.targets(self.held_out, self.config.pass2_side)
        # At this size a photo may show too little of the object to judge by.
        judges = [target for target in targets if bool(target.covered.any())]
        if not judges:
            return AssetAndLights(assets[-1], lights.stacked())
        scores = [validate(asset, judges, self.config, self.seed) for asset in (start.asset, *assets)]
        listed, progress = ", ".join(f"{score:.2f}" for score in scores[1:]), self.training.progress
        progress.tell(f"held-out photos: {scores[0]:.2f} dB before {stage.name}, {listed} after it")
        best = scores.index(max(scores))
        progress.score(stage.name, scores[0], max(scores[1:]))
        return start if best == 0 else AssetAndLights(assets[best - 1], lights.stacked())

    def finished(self, end: AssetAndLights) -> Decomposition:
        """Return the object with the lights of all training photos, and the verdict on the object."""
        config, train = self.config, self.scene.train
        lights = self._final_lights(end.asset, self.lights(end.lights))
        up = torch.from_numpy(up_of(photo.camera for photo in train)).float()
        cameras = [photo.camera.normalised(self.scene.similarity) for photo in train]
        towards = [torch.from_numpy(camera.position).float() for camera in cameras]
        correlation = ViewLightCorrelation.of(lights, towards, up)
        background = BackgroundLevel.of(lights, [self.surroundings.levels[photo.name] for photo in train])
        judges = self.targets(self.held_out or evenly_spaced(self.fitted, _JUDGES), config.pass1_side)
        held_out = bool(self.held_out)
        verdict = judge_object(
            end.asset, judges, correlation, background, config, self.seed, held_out=held_out
        )
        if verdict is not None:
            self.training.progress.tell(verdict.sentence)
        named = {photo.name: Environment(light) for photo, light in zip(train, lights, strict=True)}
        return Decomposition(end.asset, named, self.scene.similarity, verdict=verdict)

    def _final_lights(self, asset: Asset, lights: Lights) -> list[Tensor]:
        """Return the lights (6, R, R, 3) of all training photos for the finished asset.

        Lights fitted by gradients stay as they are (paper); solved ones are solved once more, at
        `teacher_resolution`, those of one place pulled to each other.
        """
        final: list[Tensor] = []
        config, train = self.config, self.scene.train
        resolution = config.light_resolution if lights.gradient else config.teacher_resolution
        for photo in train:
            start = lights.maps[lights.index[photo.name]] if photo.name in lights.index else None
            if lights.gradient and start is not None:
                final.append(start.detach())
                continue
            (target,) = self.targets([photo], config.pass1_side)
            pull = NO_PULL
            if not lights.gradient:
                shape = lights.shape_of(photo.name, photo.light_group)
                pull = LightPull(shape, self.surroundings.seen.get(photo.name))
            final.append(fit_light(asset, target, resolution, config, self.seed, start, pull)[1])
            self.training.progress.step("lights", len(final), len(train), 0.0)
        return final
