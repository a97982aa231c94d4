"""Phase I from start to end: visual hull, first pass, bake, second and third pass, final lights, verdict."""

import functools
import statistics
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import torch
from torch import Tensor

from lightprobe.core.config import DecomposeConfig, StartShape
from lightprobe.core.device import full_precision
from lightprobe.light.environment import Environment
from lightprobe.models.decomposition import Decomposition
from lightprobe.reconstruction.bake import bake, fill_unseen
from lightprobe.reconstruction.image_task import ImageTask
from lightprobe.reconstruction.lattice_model import LatticeModel
from lightprobe.reconstruction.lights import Lights
from lightprobe.reconstruction.photos import Target, evenly_spaced, load_targets
from lightprobe.reconstruction.start import BOX, Start, start_from_box, start_from_hull
from lightprobe.reconstruction.surface_model import SurfaceModel
from lightprobe.reconstruction.texture_task import PhotoPixels, TextureTask
from lightprobe.reconstruction.trials.plausibility import (
    BackgroundLevel,
    ViewLightCorrelation,
    background_level,
)
from lightprobe.reconstruction.validation import fit_light, judge_object, validate
from lightprobe.render.asset import Asset
from lightprobe.scene import carved_hull
from lightprobe.scene.camera import up_of
from lightprobe.scene.photo import Photo, Scene
from lightprobe.training import Progress, Resumed, Stage, Training
from lightprobe.training.descent import exponential

_JUDGES = 8  # photos that an object is judged by where none was held out
_EPSILON = 1e-12  # that Adam adds to the root of the mean of squared gradients
_LIGHTS = "lights"  # beside the asset's tensors, of what a pass starts from


@dataclass(frozen=True)
class _Phase:
    """What every step of Phase I needs to know."""

    scene: Scene
    config: DecomposeConfig
    device: torch.device
    seed: int
    training: Training

    def tell(self, message: str) -> None:
        """Report something worth a line in the log."""
        self.training.progress.tell(message)

    def targets(self, photos: list[Photo], side: int) -> list[Target]:
        """Return photos as tensors of at most `side` pixels."""
        return load_targets(self.scene, photos, side, self.device)

    @functools.cached_property
    def backgrounds(self) -> dict[str, float | None]:
        """The level of each training photo's background, by name."""
        return {photo.name: background_level(photo) for photo in self.scene.train}


@dataclass(frozen=True)
class AssetAndLights:
    """What a pass starts from, or ends with."""

    asset: Asset
    lights: Tensor  # (N, 6, R, R, 3), one for each fitted photo

    def tensors(self) -> dict[str, Tensor]:
        """Return all of it by name."""
        return {**self.asset.tensors(), _LIGHTS: self.lights}

    @staticmethod
    def of(tensors: dict[str, Tensor], device: torch.device) -> "AssetAndLights":
        """Return it from its `tensors`; raise `KeyError` or `InputError` where they make none."""
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
    training = Training(
        "Phase I", asdict(config), seed, passes, config.checkpoint_every, progress or Progress()
    )
    phase = _Phase(scene, config, device, seed, training)
    fitted, held_out = split_validation(scene.train, config.validation_photos)
    resumed = training.latest()
    if resumed is None or resumed.stage == first.name:
        start, resumed = _first_pass(phase, fitted, resumed), None
        training.begin(second, start.tensors())
    else:
        start = _resumed_start(phase, fitted, resumed)
    if resumed is None or resumed.stage == second.name:
        start, resumed = _second_pass(phase, fitted, held_out, start, resumed), None
        training.begin(third, start.tensors())
    end = _third_pass(phase, fitted, held_out, start, resumed)
    lights = _final_lights(phase, end.asset, _lights(phase, fitted, end.lights))
    every = [lights[photo.name] for photo in scene.train]
    up = torch.from_numpy(up_of(photo.camera for photo in scene.train)).float()
    correlation = ViewLightCorrelation.of(every, [_towards(photo, scene) for photo in scene.train], up)
    background = BackgroundLevel.of(every, [phase.backgrounds[photo.name] for photo in scene.train])
    judges = phase.targets(held_out or evenly_spaced(fitted, _JUDGES), config.pass1_side)
    verdict = judge_object(end.asset, judges, correlation, background, config, seed, held_out=bool(held_out))
    if verdict is not None:
        phase.tell(verdict.sentence)
    environments = {name: Environment(light) for name, light in lights.items()}
    return Decomposition(end.asset, environments, scene.similarity, verdict=verdict)


def _towards(photo: Photo, scene: Scene) -> Tensor:
    """Return where a photo's camera is, (3,) in object radii from the object's centre."""
    return torch.from_numpy(photo.camera.normalised(scene.similarity).position).float()


def _resumed_start(phase: _Phase, photos: list[Photo], resumed: Resumed) -> AssetAndLights:
    """Return what the pass of a checkpoint started from; raise `InputError` when it is another training's."""
    with phase.training.restoring(resumed.step):
        start = AssetAndLights.of(resumed.start, phase.device)
        _lights(phase, photos, start.lights)
    return start


def _lights(phase: _Phase, photos: list[Photo], stacked: Tensor | None = None) -> Lights:
    """Return the photos' lights, grey or those given; raise `ValueError` when one is missing."""
    lights = Lights([photo.name for photo in photos], phase.config, phase.device, phase.seed)
    if stacked is not None:
        lights.load(stacked)
    return lights


def _first_pass(phase: _Phase, photos: list[Photo], resumed: Resumed | None) -> AssetAndLights:
    """Fit lattice and field, bake them, and return what the second pass starts from."""
    config, stage = phase.config, phase.training.stages[0]
    targets = [
        replace(target, background_level=phase.backgrounds[target.name])
        for target in phase.targets(photos, config.pass1_side)
    ]
    start = start_shape(phase.scene, config, phase.seed, photos, targets)
    model = LatticeModel(start, config, phase.device, phase.seed)
    lights = _lights(phase, photos)
    phase.training.run(ImageTask(model, targets, lights, stage, config, phase.seed), stage, resumed)
    fill_unseen(model, [target.view for target in targets])
    # Baking ends the first pass for good: the unwrapper's time limit must not change a resumed run.
    return AssetAndLights(bake(model, config, phase.device, phase.tell), lights.stacked())


def start_shape(
    scene: Scene, config: DecomposeConfig, seed: int, photos: list[Photo], targets: list[Target]
) -> Start:
    """Return the lattice and the distances that the first pass starts from, of photos with their pixels."""
    if config.start is not StartShape.HULL:
        return start_from_box(config.start, config.lattice_cells, seed)
    cameras = [
        photo.camera.resized(target.view.width, target.view.height).normalised(scene.similarity)
        for photo, target in zip(photos, targets, strict=True)
    ]
    masks = [t.alpha.reshape(t.view.height, t.view.width).cpu().numpy() for t in targets]
    # The box leaves the surface room to grow beyond the hull, whose radius is 1 only up to a voxel.
    hull = carved_hull(cameras, masks, config.hull_voxels, lo=(-BOX,) * 3, hi=(BOX,) * 3)
    return start_from_hull(hull, config.lattice_cells)


def _second_pass(
    phase: _Phase, photos: list[Photo], held_out: list[Photo], start: AssetAndLights, resumed: Resumed | None
) -> AssetAndLights:
    """Refine the baked asset, vertices and textures, and return what the third pass starts from."""
    config, stage = phase.config, phase.training.stages[1]
    if config.pass2_iterations == 0:
        return start
    lights = _lights(phase, photos, start.lights)
    model = SurfaceModel(start.asset, config, phase.seed)
    targets = phase.targets(photos, config.pass2_side)
    task = ImageTask(model, targets, lights, stage, config, phase.seed)
    phase.training.run(task, stage, resumed, start.tensors())
    return _best(phase, stage, held_out, start, [model.asset()], lights)


def _third_pass(
    phase: _Phase, photos: list[Photo], held_out: list[Photo], start: AssetAndLights, resumed: Resumed | None
) -> AssetAndLights:
    """Refine the textures at the photos' full size, where that shows more."""
    config, stage = phase.config, phase.training.stages[2]
    if config.pass3_iterations == 0 or not _has_detail(photos, config):
        return start
    lights, asset = _lights(phase, photos, start.lights), start.asset
    pixels = [
        PhotoPixels.of(asset, phase.targets([photo], config.pass3_side)[0], phase.seed) for photo in photos
    ]
    pixels = [photo for photo in pixels if len(photo.color) > 0]
    before = asset.textures.resized(max(config.pass3_texture_size, asset.textures.size))
    model = SurfaceModel(replace(asset, textures=before), config, phase.seed)
    task = TextureTask(model, pixels, lights, stage, config, phase.seed)
    phase.training.run(task, stage, resumed, start.tensors())
    refined = model.asset()
    # Detail that only explains errors of the lights is worse than none; halfway is often better than either.
    halfway = replace(refined, textures=before.halfway(refined.textures))
    return _best(phase, stage, held_out, start, [halfway, refined], lights)


def _best(
    phase: _Phase,
    stage: Stage,
    held_out: list[Photo],
    start: AssetAndLights,
    assets: list[Asset],
    lights: Lights,
) -> AssetAndLights:
    """Return the asset that explains held-out photos best, with its lights; the last one without such photos.

    Where the asset from before the stage, `start`, is the best one, so are its lights.
    """
    # At this size a photo may show too little of the object to judge by.
    judges = [
        target for target in phase.targets(held_out, phase.config.pass2_side) if bool(target.covered.any())
    ]
    if not judges:
        return AssetAndLights(assets[-1], lights.stacked())
    scores = [validate(asset, judges, phase.config, phase.seed) for asset in (start.asset, *assets)]
    listed = ", ".join(f"{score:.2f}" for score in scores[1:])
    phase.tell(f"held-out photos: {scores[0]:.2f} dB before {stage.name}, {listed} after it")
    best = scores.index(max(scores))
    phase.training.progress.score(stage.name, scores[0], max(scores[1:]))
    return start if best == 0 else AssetAndLights(assets[best - 1], lights.stacked())


def _has_detail(photos: list[Photo], config: DecomposeConfig) -> bool:
    """Return whether the photos hold more than the second pass could see."""
    sides = [min(max(photo.camera.width, photo.camera.height), config.pass3_side) for photo in photos]
    return statistics.median(sides) > config.pass2_side


def _final_lights(phase: _Phase, asset: Asset, lights: Lights) -> dict[str, Tensor]:
    """Return the environments of all training photos for the finished asset, photo name -> (6, R, R, 3).

    Lights fitted by gradients stay as they are (paper); solved ones are solved once more, at the teacher's
    resolution.
    """
    final = {}
    for photo in phase.scene.train:
        if lights.gradient and photo.name in lights.index:
            final[photo.name] = lights.maps[lights.index[photo.name]].detach()
            continue
        (target,) = phase.targets([photo], phase.config.pass1_side)
        resolution = phase.config.light_resolution if lights.gradient else phase.config.teacher_resolution
        start = (
            lights.maps[lights.index[photo.name]]
            if photo.name in lights.index and not lights.gradient
            else None
        )
        final[photo.name] = fit_light(asset, target, resolution, phase.config, phase.seed, start)[1]
        phase.training.progress.step("lights", len(final), len(phase.scene.train), 0.0)
    return final
