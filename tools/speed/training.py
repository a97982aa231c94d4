"""What training costs: a profile of each phase's step on the ball, how a step grows with the photos, and a run's log.

The photos are pictures of the ball from all around, each under another light. A step of Phase I looks at one photo
and a step of Phase II at a fixed number of lessons, so neither should grow; what a run needs for each photo does.
`profile_images` does what `decompose.image_task.ImageTask.loss` and `optimise` do, piece by piece; a test holds them
together.
"""

import statistics
import time
from collections.abc import Callable
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from lightprobe.cli.bench import training_costs
from lightprobe.core.config import DecomposeConfig, DistillConfig
from lightprobe.core.device import generator
from lightprobe.core.run import RunFolder
from lightprobe.decompose.image_task import ImageTask
from lightprobe.decompose.lattice_model import LatticeModel
from lightprobe.decompose.lights import Lights
from lightprobe.decompose.losses import color_gauge, image_loss
from lightprobe.decompose.optimisation import Progress, Stage, optimise, photo_order
from lightprobe.decompose.phase1 import BOX
from lightprobe.decompose.photos import Target
from lightprobe.decompose.start import start_from_hull
from lightprobe.decompose.surface_model import SurfaceModel
from lightprobe.distill.lesson import Desk, Lesson
from lightprobe.distill.training import train
from lightprobe.render.asset import Asset, rasterize_asset
from lightprobe.render.silhouette import coverage, silhouette_crossings, spread_color
from lightprobe.render.split_sum import shade
from lightprobe.render.surface import View
from lightprobe.scene import visual_hull
from speed.ball import CPU, ball, camera, light, photograph
from speed.clock import Parts
from speed.growth import Cases, growth_rows

SEED, WARM = 0, 2  # steps that are not counted
_LIT = 16  # texels along each edge of the photos' lights


@dataclass(frozen=True)
class Size:
    """How large the measured trainings are."""

    decompose: DecomposeConfig
    distill: DistillConfig
    counts: tuple[int, ...]  # photos
    steps: int
    subdivisions: int  # of the ball


def usual() -> Size:
    """Return the preset `quick` of the program, for a few steps."""
    return Size(DecomposeConfig(), DistillConfig(), (8, 16, 32, 64), 20, 5)


def small() -> Size:
    """Return a size that takes seconds."""
    first = DecomposeConfig(lattice_cells=24, hull_voxels=32, pass1_side=64, pass2_side=64, texture_size=256,
                            light_resolution=8, light_solve_pixels=512)  # fmt: skip
    return Size(first, DistillConfig(max_side=64, samples=256, sphere_batch=1, sphere_width=8), (4, 8), 3, 3)


def picture(asset: Asset, side: int, number: int, count: int) -> Target:
    """Return one of `count` photos of the asset as Phase I holds it."""
    view = camera(side, number, count)
    pixels = photograph(asset, view, light(_LIT, number))
    alpha = torch.from_numpy(pixels.alpha).reshape(-1)
    color = torch.from_numpy(pixels.color).reshape(-1, 3) * alpha[:, None]
    return Target(f"{number:03d}", View.of(view, CPU), color, alpha)


def first_pass(asset: Asset, count: int, config: DecomposeConfig, steps: int) -> ImageTask:
    """Return the first pass on `count` photos, from their visual hull."""
    targets = [picture(asset, config.pass1_side, number, count) for number in range(count)]
    cameras = [camera(config.pass1_side, number, count) for number in range(count)]
    masks = [target.alpha.reshape(target.view.height, target.view.width).numpy() for target in targets]
    hull = visual_hull(cameras, masks, config.hull_voxels, lo=(-BOX,) * 3, hi=(BOX,) * 3)
    model = LatticeModel(start_from_hull(hull, config.lattice_cells), config, CPU, SEED)
    return _task(model, targets, config, Stage("pass1", 0, steps))


def second_pass(asset: Asset, count: int, config: DecomposeConfig, steps: int) -> ImageTask:
    """Return the second pass on `count` photos, from the asset itself."""
    targets = [picture(asset, config.pass2_side, number, count) for number in range(count)]
    return _task(SurfaceModel(asset, config), targets, config, Stage("pass2", 0, steps))


def _task(model: LatticeModel | SurfaceModel, targets: list[Target], config: DecomposeConfig, stage: Stage
          ) -> ImageTask:  # fmt: skip
    lights = Lights([target.name for target in targets], config, CPU, SEED)
    return ImageTask(model, targets, lights, stage, config, SEED)


def image_loss_parts(task: ImageTask, iteration: int, parts: Parts) -> Tensor:
    """Return the loss of a step, as `ImageTask.loss` does, and time its parts."""
    stage, config = task.stage, task.config
    fraction, step = iteration / stage.iterations, stage.first_step + iteration
    target = task.targets[photo_order(task.seed, stage.name, len(task.targets), iteration)]
    height, width = target.view.height, target.view.width
    with parts.part("surface, material, regularisation"):
        seen = task.model.see(target.view, step, fraction)
    with parts.part("light solve and prefilter"):
        levels, light_loss = task.lights.levels(target, seen.gbuffer, step)
    with parts.part("shade"):
        radiance = shade(seen.gbuffer, task.lights.prefilter, levels)
    with parts.part("silhouette and image loss"):
        covered = torch.zeros(height * width, dtype=torch.bool)
        covered[seen.gbuffer.pixel] = True
        shaped = covered.reshape(height, width)
        crossings = silhouette_crossings(seen.screen, seen.faces, seen.edges, shaped, target.view)
        cover = coverage(seen.gbuffer.pixel, crossings, height * width)
        image = spread_color(radiance, seen.gbuffer.pixel, crossings, cover)
        background = torch.rand(3, generator=generator(task.seed, "background", step))
        loss = image_loss(image, cover, target.color, target.alpha, background, config.coverage_weight)
        gauge = config.color_gauge * color_gauge(seen.gbuffer.base_color, task.lights.cast())
        return loss + light_loss + seen.regularisation + gauge


def profile_images(task: ImageTask, steps: int) -> dict[str, float]:
    """Return the median seconds of each part of a step of one of the first two passes."""
    parts = Parts()
    optimiser = torch.optim.Adam(task.groups(), betas=(0.9, 0.99), eps=1e-12)
    task.refresh(0, 0.0)
    for iteration in range(steps + WARM):
        optimiser.zero_grad(set_to_none=True)
        loss = image_loss_parts(task, iteration, parts)
        with parts.part("backward"):
            loss.backward()
        with parts.part("optimiser"):
            optimiser.step()
            task.project()
    return parts.medians(WARM)


def step_seconds(task: ImageTask, steps: int) -> float:
    """Return the median seconds of a step of `optimise`."""
    stamps: list[float] = []
    progress = Progress(on_step=lambda *_: stamps.append(time.perf_counter()))
    optimise(task, Stage(task.stage.name, 0, steps + WARM), task.config, progress)
    return _median_gap(stamps)


def _median_gap(stamps: list[float]) -> float:
    return statistics.median(b - a for a, b in zip(stamps[WARM - 1 :], stamps[WARM:], strict=False))


def lessons_of(asset: Asset, count: int, config: DistillConfig) -> list[Lesson]:
    """Return a lesson from each of `count` cameras."""
    lessons = []
    for number in range(count):
        gbuffer = rasterize_asset(asset, camera(config.max_side, number, count), CPU)
        photo = picture(asset, config.max_side, number, count)
        desk = Desk(gbuffer, config)
        lessons.append(desk.lesson(photo.name, photo.color[gbuffer.pixel], light(_LIT, number)))
    return lessons


def distill_seconds(lessons: list[Lesson], config: DistillConfig, steps: int) -> dict[str, float]:
    """Return the median seconds of a step of the illumination MLP and of the sphere network."""
    stamps: list[float] = []
    short = replace(config, steps=steps + WARM, sphere_steps=steps + WARM)
    train(lessons, short, CPU, SEED, on_step=lambda *_: stamps.append(time.perf_counter()))
    return {
        "step of Phase II's MLP": _median_gap(stamps[: short.steps]),
        "step of the sphere network": _median_gap(stamps[short.steps :]),
    }


def held(task: ImageTask) -> float:
    """Return the bytes of the photos and lights that a pass holds."""
    tensors = [tensor for target in task.targets for tensor in (target.color, target.alpha)] + task.lights.maps
    return float(sum(tensor.numel() * tensor.element_size() for tensor in tensors))


def photo_tables(size: Size) -> list[str]:
    """Return how steps, an epoch and memory grow with the photos."""
    asset = ball(size.subdivisions)
    times: Cases = {}
    memory: Cases = {}
    for count in size.counts:
        task = first_pass(asset, count, size.decompose, size.steps)
        step = step_seconds(task, size.steps)
        begin = time.perf_counter()
        lessons = lessons_of(asset, count, size.distill)
        made = time.perf_counter() - begin
        phase2 = distill_seconds(lessons, size.distill, size.steps)
        times[float(count)] = {
            "step of Phase I": step, "each photo once": count * step, **phase2, "preparing lessons": made,
        }  # fmt: skip
        memory[float(count)] = {"first pass, MiB": held(task)}
    return [*growth_rows("photos, ms", times), "", *growth_rows("photos and lights held", memory, 2**-20)]


def profile_tables(size: Size) -> list[str]:
    """Return the shares of the parts of a step of each pass, with the step of the real loop beside their sum."""
    asset, rows = ball(size.subdivisions, size.decompose.texture_size), []
    passes: tuple[tuple[str, Callable[..., ImageTask]], ...] = (("first", first_pass), ("second", second_pass))
    for name, make in passes:
        task = make(asset, size.counts[0], size.decompose, size.steps)
        parts = profile_images(task, size.steps)
        whole = step_seconds(make(asset, size.counts[0], size.decompose, size.steps), size.steps)
        rows += [*part_rows(f"{name} pass of Phase I, {size.counts[0]} photos", parts), ""]
        rows += [f"The same step in the training loop itself: {1000 * whole:.0f} ms.", ""]
    return rows[:-1]


def part_rows(name: str, parts: dict[str, float]) -> list[str]:
    """Return the table of the parts of a step."""
    total = sum(parts.values())
    rows = [f"| {name} | ms | share |", "| --- | ---: | ---: |"]
    rows += [f"| {part} | {1000 * value:.1f} | {100 * value / total:.0f} % |" for part, value in parts.items()]
    return [*rows, f"| sum | {1000 * total:.1f} | |"]


def log_rows(run: RunFolder | None) -> list[str]:
    """Return what the log of a finished run says of its whole training."""
    if run is None:
        return ["A whole training: not measured; it needs a finished run (`--run RUN`)."]
    costs = training_costs(run)
    cells = (f"{costs[phase]:.0f}" if phase in costs else "–" for phase in ("decompose", "distill"))
    memory = f"{costs['memory']:.2f} GiB" if "memory" in costs else "–"
    return ["| whole training, from the log | Phase I, s | Phase II, s | peak memory |", "| --- | ---: | ---: | ---: |",
            f"| {run.path.resolve().name} | {' | '.join(cells)} | {memory} |"]  # fmt: skip
