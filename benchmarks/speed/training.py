"""What training costs: how its steps grow with the photos, and a whole run.

The photos are pictures of the ball from all around, each under another light. A step of Phase I looks at one photo
and a step of Phase II at a fixed number of training examples, so neither should grow; what a run needs for each photo
does.
"""

import time
from dataclasses import dataclass, replace

import torch

from benchmarks.provenance import training_costs
from benchmarks.speed.ball import CPU, LIT, ball, camera, light, photograph
from benchmarks.speed.timing import WARM, growth_rows, median_gap
from lightprobe.core.config import DecomposeConfig, DistillConfig
from lightprobe.core.run import RunFolder
from lightprobe.distillation.examples import ExampleMaker, TrainingExample
from lightprobe.distillation.training import train
from lightprobe.reconstruction.image_objective import ImageObjective
from lightprobe.reconstruction.lattice_model import LatticeModel
from lightprobe.reconstruction.lights import Lights
from lightprobe.reconstruction.photos import Target
from lightprobe.reconstruction.start import BOX, start_from_hull
from lightprobe.render.asset import Asset, rasterize_asset
from lightprobe.render.surface import View
from lightprobe.scene import carved_hull
from lightprobe.training import Progress, Stage, Training

SEED = 0
UP = torch.tensor([0.0, 0.0, 1.0])


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
    first = DecomposeConfig(
        lattice_cells=24,
        hull_voxels=32,
        pass1_side=64,
        pass2_side=64,
        texture_size=256,
        light_resolution=16,
        light_solve_pixels=512,
    )
    return Size(first, DistillConfig(max_side=64, samples=256, sphere_width=8), (2, 4), 3, 2)


def photo_tables(size: Size) -> list[str]:
    """Return how steps, an epoch and memory grow with the photos."""
    asset = ball(size.subdivisions)
    times, memory = {}, {}
    for count in size.counts:
        task = first_pass(asset, count, size.decompose, size.steps)
        step = phase_one_step(task, size.steps)
        begin = time.perf_counter()
        lessons = lessons_of(asset, count, size.distill)
        made = time.perf_counter() - begin
        second = phase_two_steps(lessons, size.distill, size.steps)
        times[count] = {
            "step of Phase I": step,
            "each photo once": count * step,
            **second,
            "preparing lessons": made,
        }
        tensors = [
            tensor for target in task.targets for tensor in (target.color, target.alpha)
        ] + task.lights.maps
        memory[count] = {"first pass, MiB": float(sum(t.numel() * t.element_size() for t in tensors))}
    return [*growth_rows("photos, ms", times), "", *growth_rows("photos and lights held", memory, 2**-20)]


def picture(asset: Asset, side: int, number: int, count: int) -> Target:
    """Return one of `count` photos of the asset as Phase I holds it."""
    view = camera(side, number, count)
    pixels = photograph(asset, view, light(LIT, number))
    alpha = torch.from_numpy(pixels.alpha).reshape(-1)
    color = torch.from_numpy(pixels.color).reshape(-1, 3) * alpha[:, None]
    clipped = torch.from_numpy(pixels.clipped).reshape(-1, 3)
    return Target(f"{number:03d}", View.of(view, CPU), color, alpha, clipped)


def first_pass(asset: Asset, count: int, config: DecomposeConfig, steps: int) -> ImageObjective:
    """Return the first pass of Phase I on `count` photos, from their visual hull."""
    targets = [picture(asset, config.pass1_side, number, count) for number in range(count)]
    cameras = [camera(config.pass1_side, number, count) for number in range(count)]
    masks = [target.alpha.reshape(target.view.height, target.view.width).numpy() for target in targets]
    hull = carved_hull(cameras, masks, config.hull_voxels, lo=(-BOX,) * 3, hi=(BOX,) * 3)
    model = LatticeModel(start_from_hull(hull, config.lattice_cells), config, CPU, SEED)
    lights = Lights([target.name for target in targets], config, CPU, SEED)
    return ImageObjective(model, targets, lights, Stage("pass1", 0, steps), config, SEED)


def phase_one_step(task: ImageObjective, steps: int) -> float:
    """Return the median seconds of a step of the training loop."""
    stamps: list[float] = []
    progress = Progress(on_step=lambda *_: stamps.append(time.perf_counter()))
    stage = Stage(task.stage.name, 0, steps + WARM)
    Training("Phase I", {}, SEED, (stage,), task.config.checkpoint_every, progress).run(task, stage)
    return median_gap(stamps)


def lessons_of(asset: Asset, count: int, config: DistillConfig) -> list[TrainingExample]:
    """Return a training example of Phase II from each of `count` cameras."""
    lessons = []
    for number in range(count):
        gbuffer = rasterize_asset(asset, camera(config.max_side, number, count), CPU)
        photo, at = picture(asset, config.max_side, number, count), gbuffer.pixel
        maker = ExampleMaker(gbuffer, UP, config)
        lessons.append(maker.example(photo.name, photo.color[at], photo.clipped[at], light(LIT, number)))
    return lessons


def phase_two_steps(lessons: list[TrainingExample], config: DistillConfig, steps: int) -> dict[str, float]:
    """Return the median seconds of a step of the illumination MLP and of the sphere network."""
    stamps: list[float] = []
    short = replace(config, steps=steps + WARM, sphere_steps=steps + WARM)
    train(lessons, short, CPU, SEED, Progress(on_step=lambda *_: stamps.append(time.perf_counter())))
    return {
        "step of Phase II's MLP": median_gap(stamps[: short.steps]),
        "step of the sphere network": median_gap(stamps[short.steps :]),
    }


def run_rows(run: RunFolder | None) -> list[str]:
    """Return what the record of a finished run's timings says of its whole training."""
    if run is None:
        return ["A whole training: not measured; it needs a finished run (`--run RUN`)."]
    costs = training_costs(run)
    cells = (f"{costs[phase]:.0f}" if phase in costs else "–" for phase in ("decompose", "distill"))
    memory = f"{costs['memory']:.2f} GiB" if "memory" in costs else "–"
    return [
        "| whole training, from its timings | Phase I, s | Phase II, s | peak memory |",
        "| --- | ---: | ---: | ---: |",
        f"| {run.path.resolve().name} | {' | '.join(cells)} | {memory} |",
    ]
