"""Phase I from start to end: visual hull, first pass, bake, second pass with its guard, final lights."""

from dataclasses import dataclass

import torch
from torch import Tensor

from lightprobe.core.config import DecomposeConfig
from lightprobe.decompose.bake import bake
from lightprobe.decompose.decomposition import Decomposition
from lightprobe.decompose.lattice_model import LatticeModel
from lightprobe.decompose.lights import Lights
from lightprobe.decompose.photos import Target, load_targets
from lightprobe.decompose.start import start_from_hull
from lightprobe.decompose.surface_model import SurfaceModel
from lightprobe.decompose.training import Progress, Stage, optimise
from lightprobe.decompose.validation import explain, validate
from lightprobe.render.asset import Asset
from lightprobe.scene import visual_hull
from lightprobe.scene.photo import Photo, Scene

BOX = 1.15  # half edge of the lattice, in object radii
_START = "start."  # prefix of the second pass's start asset in a checkpoint


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
    job = Job(scene, config or DecomposeConfig(), device or torch.device("cpu"), seed, progress or Progress())
    found = job.progress.checkpoints.latest() if job.progress.checkpoints else None
    fitted, held_out = split_validation(scene.train, job.config.validation_photos)
    if found is None or found[2]["stage"] == "pass1":
        tensors = _first_pass(job, fitted, found[1] if found else None, found[2]["iteration"] if found else 0)
        done = 0
    else:
        tensors, done = found[1], found[2]["iteration"]
    asset, lights = _second_pass(job, fitted, held_out, tensors, done)
    return Decomposition(asset, _final_lights(job, asset, lights), scene.similarity)


def _first_pass(job: Job, photos: list[Photo], restored: dict[str, Tensor] | None, done: int) -> dict[str, Tensor]:
    """Fit lattice and field, bake them, and return the tensors the second pass starts from."""
    config = job.config
    targets = job.targets(photos, config.pass1_side)
    cameras = [
        photo.camera.resized(target.view.width, target.view.height).normalised(job.scene.similarity)
        for photo, target in zip(photos, targets, strict=True)
    ]
    masks = [t.alpha.reshape(t.view.height, t.view.width).cpu().numpy() for t in targets]
    # The box leaves the surface room to grow beyond the hull, whose radius is 1 only up to a voxel.
    hull = visual_hull(cameras, masks, config.hull_voxels, lo=(-BOX,) * 3, hi=(BOX,) * 3)
    model = LatticeModel(start_from_hull(hull, config.lattice_cells), config, job.device, job.seed)
    lights = Lights([t.name for t in targets], config, job.device, job.seed)
    stage = Stage("pass1", 0, config.pass1_iterations)
    optimise(model, targets, lights, stage, config, job.seed, job.progress, done, restored)
    start = bake(model, config, job.device)
    tensors = {**_named(start), "lights": torch.stack([light.detach() for light in lights.maps])}
    if job.progress.checkpoints:
        # Baking ends the first pass for good: the unwrapper's time limit must not be able to change a resumed run.
        job.progress.checkpoints.save(config.pass1_iterations, tensors, {"stage": "pass2", "iteration": 0})
    return tensors


def _second_pass(job: Job, photos: list[Photo], held_out: list[Photo], tensors: dict[str, Tensor], done: int
                 ) -> tuple[Asset, Lights]:  # fmt: skip
    """Refine the baked asset; keep the refined one only if it explains held-out photos better."""
    config = job.config
    start = Asset.from_tensors({k.removeprefix(_START): v for k, v in tensors.items() if k.startswith(_START)})
    start = start.to(job.device)
    lights = Lights([p.name for p in photos], config, job.device, job.seed)
    lights.load(tensors["lights"])
    if config.pass2_iterations == 0:
        return start, lights
    model = SurfaceModel(start, config)
    stage = Stage("pass2", config.pass1_iterations, config.pass2_iterations)
    job.progress.extra = _named(start)
    targets = job.targets(photos, config.pass2_side)
    optimise(model, targets, lights, stage, config, job.seed, job.progress, done, tensors if done else None)
    refined = model.asset()
    if held_out:
        judges = job.targets(held_out, config.pass2_side)
        before, after = (validate(asset, judges, config, job.seed) for asset in (start, refined))
        job.progress.tell(f"held-out photos: {before:.2f} dB after the first pass, {after:.2f} dB after the second")
        if after < before:
            return start, lights
    return refined, lights


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
