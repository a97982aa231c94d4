"""Phase I from start to end: visual hull, first pass, bake, second and third pass with their guards, final lights."""

import statistics
from dataclasses import dataclass, replace
from pathlib import Path

import torch
from torch import Tensor

from lightprobe.core.config import DecomposeConfig, StartShape
from lightprobe.core.device import full_precision
from lightprobe.models.decomposition import Decomposition
from lightprobe.reconstruction.bake import bake
from lightprobe.reconstruction.image_task import ImageTask
from lightprobe.reconstruction.lattice_model import LatticeModel
from lightprobe.reconstruction.lights import Lights
from lightprobe.reconstruction.optimisation import Progress, Stage, optimise
from lightprobe.reconstruction.photos import Target, load_targets
from lightprobe.reconstruction.start import BOX, Start, start_from_box, start_from_hull
from lightprobe.reconstruction.surface_model import SurfaceModel
from lightprobe.reconstruction.texture_task import PhotoPixels, TextureTask
from lightprobe.reconstruction.validation import explain, validate
from lightprobe.render.asset import Asset
from lightprobe.scene import carved_hull
from lightprobe.scene.photo import Photo, Scene

_START = "start."  # prefix, in a checkpoint, of the asset that a pass started from
_BEFORE = "before.lights"  # of a pass


@dataclass(frozen=True)
class Job:
    """What every step of Phase I needs to know."""

    scene: Scene
    config: DecomposeConfig
    device: torch.device
    seed: int
    progress: Progress

    def targets(self, photos: list[Photo], side: int) -> list[Target]:
        """Return photos as tensors of at most `side` pixels."""
        return load_targets(self.scene, photos, side, self.device)


def split_validation(photos: tuple[Photo, ...], count: int) -> tuple[list[Photo], list[Photo]]:
    """Return (fitted, held out) photos; at most an eighth is held out, spread evenly over the list."""
    count = min(count, len(photos) // 8)
    chosen = {int((k + 0.5) * len(photos) / count) for k in range(count)}
    return [p for i, p in enumerate(photos) if i not in chosen], [p for i, p in enumerate(photos) if i in chosen]


def decompose(scene: Scene, config: DecomposeConfig | None = None, device: torch.device | None = None, seed: int = 0,
              progress: Progress | None = None) -> Decomposition:  # fmt: skip
    """Return mesh, textures and one environment per training photo of a scene (paper, section 3.1).

    With `progress.checkpoints`, an interrupted call goes on from the newest one and ends with the same bits on a
    CPU. Raises `ConvergenceError` when nothing usable comes out.
    """
    device = full_precision(device or torch.device("cpu"))
    job = Job(scene, config or DecomposeConfig(), device, seed, progress or Progress())
    fitted, held_out = split_validation(scene.train, job.config.validation_photos)
    found = _found(job, fitted)
    if found is None or found.stage == "pass1":
        tensors = _first_pass(job, fitted, found.tensors if found else None, found.done if found else 0)
        stage, done = "pass2", 0
    else:
        tensors, stage, done = found.tensors, found.stage, found.done
    if stage == "pass2":
        tensors, done = _second_pass(job, fitted, held_out, tensors, done), 0
    asset, lights = _third_pass(job, fitted, held_out, tensors, done)
    return Decomposition(asset, _final_lights(job, asset, lights), scene.similarity)


@dataclass(frozen=True)
class _Found:
    """The newest checkpoint."""

    tensors: dict[str, Tensor]
    stage: str
    done: int  # steps of the stage


def _found(job: Job, photos: list[Photo]) -> _Found | None:
    """Return the newest checkpoint, None without one; raise `InputError` when it is not one of this training's."""
    checkpoints, config = job.progress.checkpoints, job.config
    latest = checkpoints.latest() if checkpoints else None
    if latest is None:
        return None
    step, tensors, state = latest
    lengths = {"pass1": config.pass1_iterations, "pass2": config.pass2_iterations, "pass3": config.pass3_iterations}
    with job.progress.restoring(step):
        stage, done = state["stage"], state["iteration"]
        if not isinstance(stage, str) or stage not in lengths:
            raise ValueError("its state names no pass")
        before = sum(lengths[name] for name in lengths if name < stage)
        if type(done) is not int or not 0 <= done <= lengths[stage] or step != before + done:
            raise ValueError(f"its state names step {done} of {stage}")
        if stage != "pass1":
            lights = _taken_over(job, photos, tensors)[1]
            lights.load(tensors[_BEFORE] if done else tensors["lights"])
    return _Found(tensors, stage, done)


def _first_pass(job: Job, photos: list[Photo], restored: dict[str, Tensor] | None, done: int) -> dict[str, Tensor]:
    """Fit lattice and field, bake them, and return the tensors the second pass starts from."""
    config = job.config
    targets = job.targets(photos, config.pass1_side)
    model = LatticeModel(_start(job, photos, targets), config, job.device, job.seed)
    lights = Lights([t.name for t in targets], config, job.device, job.seed)
    stage = Stage("pass1", 0, config.pass1_iterations)
    task = ImageTask(model, targets, lights, stage, config, job.seed)
    optimise(task, stage, config, job.progress, done, restored)
    # Baking ends the first pass for good: the unwrapper's time limit must not be able to change a resumed run.
    return _hand_over(job, bake(model, config, job.device, job.progress.tell), lights, "pass2")


def _start(job: Job, photos: list[Photo], targets: list[Target]) -> Start:
    """Return the lattice and the distances that the first pass starts from."""
    config = job.config
    if config.start is not StartShape.HULL:
        return start_from_box(config.start, config.lattice_cells, job.seed)
    cameras = [
        photo.camera.resized(target.view.width, target.view.height).normalised(job.scene.similarity)
        for photo, target in zip(photos, targets, strict=True)
    ]
    masks = [t.alpha.reshape(t.view.height, t.view.width).cpu().numpy() for t in targets]
    # The box leaves the surface room to grow beyond the hull, whose radius is 1 only up to a voxel.
    hull = carved_hull(cameras, masks, config.hull_voxels, lo=(-BOX,) * 3, hi=(BOX,) * 3)
    return start_from_hull(hull, config.lattice_cells)


def _second_pass(job: Job, photos: list[Photo], held_out: list[Photo], tensors: dict[str, Tensor], done: int
                 ) -> dict[str, Tensor]:  # fmt: skip
    """Refine the baked asset, vertices and textures, and return the tensors the third pass starts from."""
    config = job.config
    start, lights = _taken_over(job, photos, tensors)
    if config.pass2_iterations == 0:
        return tensors
    model = SurfaceModel(start, config, job.seed)
    stage = Stage("pass2", config.pass1_iterations, config.pass2_iterations, config.warm_up_steps)
    lights_before = tensors[_BEFORE] if done else tensors["lights"]
    job.progress.extra = {**_named(start), _BEFORE: lights_before}
    targets = job.targets(photos, config.pass2_side)
    task = ImageTask(model, targets, lights, stage, config, job.seed)
    optimise(task, stage, config, job.progress, done, tensors if done else None)
    kept = _best(job, stage, held_out, [start, model.asset()], lights, lights_before)
    return _hand_over(job, kept, lights, "pass3")


def _third_pass(job: Job, photos: list[Photo], held_out: list[Photo], tensors: dict[str, Tensor], done: int
                ) -> tuple[Asset, Lights]:  # fmt: skip
    """Refine the textures at the photos' full size, where that shows more."""
    config = job.config
    start, lights = _taken_over(job, photos, tensors)
    if config.pass3_iterations == 0 or not _has_detail(photos, config):
        return start, lights
    stage = Stage("pass3", config.pass1_iterations + config.pass2_iterations, config.pass3_iterations)
    lights_before = tensors[_BEFORE] if done else tensors["lights"]
    job.progress.extra = {**_named(start), _BEFORE: lights_before}
    pixels = [PhotoPixels.of(start, job.targets([photo], config.pass3_side)[0], job.seed) for photo in photos]
    pixels = [photo for photo in pixels if len(photo.color) > 0]
    before = start.textures.resized(max(config.pass3_texture_size, start.textures.size))
    model = SurfaceModel(replace(start, textures=before), config, job.seed)
    task = TextureTask(model, pixels, lights, stage, config, job.seed)
    optimise(task, stage, config, job.progress, done, tensors if done else None)
    refined = model.asset()
    # Detail that only explains errors of the lights is worse than none; halfway there is often better than either.
    halfway = replace(refined, textures=before.halfway(refined.textures))
    return _best(job, stage, held_out, [start, halfway, refined], lights, lights_before), lights


def _best(job: Job, stage: Stage, held_out: list[Photo], assets: list[Asset], lights: Lights, lights_before: Tensor
          ) -> Asset:  # fmt: skip
    """Return the asset that explains held-out photos best, the last one when there are none.

    The first asset is the one before the stage; when it stays, so do the `lights_before` that belong to it.
    """
    if not held_out:
        return assets[-1]
    judges = job.targets(held_out, job.config.pass2_side)
    scores = [validate(asset, judges, job.config, job.seed) for asset in assets]
    listed = ", ".join(f"{score:.2f}" for score in scores[1:])
    job.progress.tell(f"held-out photos: {scores[0]:.2f} dB before {stage.name}, {listed} after it")
    best = scores.index(max(scores))
    if best == 0:
        lights.load(lights_before)
    return assets[best]


def _hand_over(job: Job, asset: Asset, lights: Lights, stage: str) -> dict[str, Tensor]:
    """Return the tensors that the pass `stage` starts from, and save them when there are checkpoints."""
    tensors = {**_named(asset), "lights": torch.stack([light.detach() for light in lights.maps])}
    if job.progress.checkpoints:
        config = job.config
        step = config.pass1_iterations + (config.pass2_iterations if stage == "pass3" else 0)
        job.progress.checkpoints.save(step, tensors, {"stage": stage, "iteration": 0})
    return tensors


def _taken_over(job: Job, photos: list[Photo], tensors: dict[str, Tensor]) -> tuple[Asset, Lights]:
    """Return the asset that a pass starts from, and the lights, out of its tensors."""
    lights = Lights([p.name for p in photos], job.config, job.device, job.seed)
    named = {k.removeprefix(_START): v for k, v in tensors.items() if k.startswith(_START)}
    start = Asset.from_tensors(named, Path("the object of this pass"), "begin anew with --restart")
    lights.load(tensors["lights"])
    return start.to(job.device), lights


def _has_detail(photos: list[Photo], config: DecomposeConfig) -> bool:
    """Return whether the photos hold more than the second pass could see."""
    sides = [min(max(photo.camera.width, photo.camera.height), config.pass3_side) for photo in photos]
    return statistics.median(sides) > config.pass2_side


def _final_lights(job: Job, asset: Asset, lights: Lights) -> dict[str, Tensor]:
    """Return the environments of all training photos for the finished asset, photo name -> (6, R, R, 3).

    Lights fitted by gradients stay as they are (paper); solved ones are solved once more, at the teacher's resolution.
    """
    final = {}
    for photo in job.scene.train:
        if lights.gradient and photo.name in lights.index:
            final[photo.name] = lights.maps[lights.index[photo.name]].detach()
            continue
        (target,) = job.targets([photo], job.config.pass1_side)
        resolution = job.config.light_resolution if lights.gradient else job.config.teacher_resolution
        start = lights.maps[lights.index[photo.name]] if photo.name in lights.index and not lights.gradient else None
        final[photo.name] = explain(asset, target, resolution, job.config, job.seed, start)[1]
        job.progress.step("lights", len(final), len(job.scene.train), 0.0)
    return final


def _named(start: Asset) -> dict[str, Tensor]:
    return {_START + name: tensor for name, tensor in start.tensors().items()}
