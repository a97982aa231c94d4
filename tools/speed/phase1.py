"""Phase I on the ball, step by step: its passes, the time of a step, and what its parts take.

`profile` does what `reconstruction.image_task.ImageTask.loss` and `Training.run` do, piece by piece; a test
holds them together.
"""

import time

import torch
from torch import Tensor

from lightprobe.core.config import DecomposeConfig
from lightprobe.reconstruction.image_task import ImageTask
from lightprobe.reconstruction.lattice_model import LatticeModel
from lightprobe.reconstruction.lights import Lights
from lightprobe.reconstruction.photos import Target
from lightprobe.reconstruction.start import BOX, start_from_hull
from lightprobe.reconstruction.surface_model import SurfaceModel
from lightprobe.render.asset import Asset
from lightprobe.render.split_sum import shade
from lightprobe.render.surface import View
from lightprobe.scene import carved_hull
from lightprobe.training import Adam, Progress, Stage, Training
from speed.ball import CPU, LIT, camera, light, photograph
from speed.clock import WARM, Parts, median_gap, seconds

SEED = 0


def picture(asset: Asset, side: int, number: int, count: int) -> Target:
    """Return one of `count` photos of the asset as Phase I holds it."""
    view = camera(side, number, count)
    pixels = photograph(asset, view, light(LIT, number))
    alpha = torch.from_numpy(pixels.alpha).reshape(-1)
    color = torch.from_numpy(pixels.color).reshape(-1, 3) * alpha[:, None]
    clipped = torch.from_numpy(pixels.clipped).reshape(-1, 3)
    return Target(f"{number:03d}", View.of(view, CPU), color, alpha, clipped)


def first_pass(asset: Asset, count: int, config: DecomposeConfig, steps: int) -> ImageTask:
    """Return the first pass on `count` photos, from their visual hull."""
    targets = [picture(asset, config.pass1_side, number, count) for number in range(count)]
    cameras = [camera(config.pass1_side, number, count) for number in range(count)]
    masks = [target.alpha.reshape(target.view.height, target.view.width).numpy() for target in targets]
    hull = carved_hull(cameras, masks, config.hull_voxels, lo=(-BOX,) * 3, hi=(BOX,) * 3)
    model = LatticeModel(start_from_hull(hull, config.lattice_cells), config, CPU, SEED)
    return _task(model, targets, config, Stage("pass1", 0, steps))


def second_pass(asset: Asset, count: int, config: DecomposeConfig, steps: int) -> ImageTask:
    """Return the second pass on `count` photos, from the asset itself."""
    targets = [picture(asset, config.pass2_side, number, count) for number in range(count)]
    return _task(SurfaceModel(asset, config), targets, config, Stage("pass2", 0, steps))


def _task(
    model: LatticeModel | SurfaceModel, targets: list[Target], config: DecomposeConfig, stage: Stage
) -> ImageTask:
    lights = Lights([target.name for target in targets], config, CPU, SEED)
    return ImageTask(model, targets, lights, stage, config, SEED)


def image_loss_parts(task: ImageTask, iteration: int, parts: Parts) -> Tensor:
    """Return the loss of a step, as `ImageTask.loss` does, and time its parts."""
    stage = task.stage
    target, step = task.target(iteration), stage.first_step + iteration
    with parts.part("surface, material, regularisation"):
        seen = task.model.rasterise(target.view, step, iteration / stage.iterations)
    with parts.part("light solve and prefilter"):
        levels, light_loss = task.lights.levels(target, seen.gbuffer, step)
    with parts.part("shade"):
        radiance = shade(seen.gbuffer, task.lights.prefilter, levels)
    with parts.part("silhouette and image loss"):
        return task.compare(target, seen, radiance, step) + light_loss


def profile(task: ImageTask, steps: int) -> dict[str, float]:
    """Return the median seconds of each part of a step of one of the first two passes."""
    parts = Parts()
    adam = Adam(task.groups(), betas=(0.9, 0.99), epsilon=1e-12)
    task.refresh(0, 0.0)
    for iteration in range(steps + WARM):
        adam.forget_gradients()
        loss = image_loss_parts(task, iteration, parts)
        with parts.part("backward"):
            loss.backward()
        with parts.part("optimiser"):
            adam.step()
            task.project()
    return parts.medians(WARM)


def renewal_seconds(task: ImageTask) -> float:
    """Return the seconds of what a pass renews now and then: shadows, and the brightness of the base colours."""
    return seconds(lambda: task.refresh(1, 0.0), 1, warm_up=False)


def step_seconds(task: ImageTask, steps: int) -> float:
    """Return the median seconds of a step of the training loop."""
    stamps: list[float] = []
    progress = Progress(on_step=lambda *_: stamps.append(time.perf_counter()))
    stage = Stage(task.stage.name, 0, steps + WARM)
    Training("Phase I", {}, SEED, (stage,), task.config.checkpoint_every, progress).run(task, stage)
    return median_gap(stamps)


def held(task: ImageTask) -> float:
    """Return the bytes of the photos and lights that a pass holds."""
    tensors = [
        tensor for target in task.targets for tensor in (target.color, target.alpha)
    ] + task.lights.maps
    return float(sum(tensor.numel() * tensor.element_size() for tensor in tensors))
