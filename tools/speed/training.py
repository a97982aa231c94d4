"""What training costs: how its steps grow with the photos, a profile of each phase's steps, and a whole run.

The photos are pictures of the ball from all around, each under another light. A step of Phase I looks at one
photo and a step of Phase II at a fixed number of lessons, so neither should grow; what a run needs for each
photo does.
"""

import time
from collections.abc import Callable
from dataclasses import dataclass

from lightprobe.report.provenance import training_costs

from lightprobe.core.config import DecomposeConfig, DistillConfig
from lightprobe.core.run import RunFolder
from lightprobe.reconstruction.image_task import ImageTask
from speed import phase1, phase2
from speed.ball import ball
from speed.growth import Cases, growth_rows


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
    return Size(first, DistillConfig(max_side=64, samples=256, sphere_batch=1, sphere_width=8), (2, 4), 3, 2)


def photo_tables(size: Size) -> list[str]:
    """Return how steps, an epoch and memory grow with the photos."""
    asset = ball(size.subdivisions)
    times: Cases = {}
    memory: Cases = {}
    for count in size.counts:
        task = phase1.first_pass(asset, count, size.decompose, size.steps)
        step = phase1.step_seconds(task, size.steps)
        begin = time.perf_counter()
        lessons = phase2.lessons_of(asset, count, size.distill)
        made = time.perf_counter() - begin
        second = phase2.step_seconds(lessons, size.distill, size.steps)
        times[count] = {
            "step of Phase I": step,
            "each photo once": count * step,
            **second,
            "preparing lessons": made,
        }
        memory[count] = {"first pass, MiB": phase1.held(task)}
    return [*growth_rows("photos, ms", times), "", *growth_rows("photos and lights held", memory, 2**-20)]


def profile_tables(size: Size) -> list[str]:
    """Return the shares of the parts of a step of each pass and network, and what Phase I does beside its
    steps.
    """
    asset, config, count = (
        ball(size.subdivisions, size.decompose.texture_size),
        size.decompose,
        size.counts[0],
    )
    rows = []
    passes: tuple[tuple[str, Callable[..., ImageTask]], ...] = (
        ("first pass of Phase I", phase1.first_pass),
        ("second pass of Phase I", phase1.second_pass),
    )
    for name, make in passes:
        task = make(asset, count, config, size.steps)
        rows += [*part_rows(name, phase1.profile(task, size.steps)), ""]
        renewal = phase1.renewal_seconds(task)
        whole = phase1.step_seconds(make(asset, count, config, size.steps), size.steps)
        rows += [
            f"The step in the training loop itself: {1000 * whole:.0f} ms. Renewing shadows and brightness, once",
            f"in {config.checkpoint_every} steps: {1000 * renewal:.0f} ms.",
            "",
        ]
    lessons = phase2.lessons_of(asset, count, size.distill)
    for name, parts in phase2.profile(lessons, size.distill, size.steps).items():
        rows += [*part_rows(f"{name} of Phase II", parts), ""]
    return rows[:-1]


def part_rows(name: str, parts: dict[str, float]) -> list[str]:
    """Return the table of the parts of a step."""
    total = sum(parts.values())
    rows = [f"| {name} | ms | share |", "| --- | ---: | ---: |"]
    rows += [
        f"| {part} | {1000 * value:.1f} | {100 * value / total:.0f} % |" for part, value in parts.items()
    ]
    return [*rows, f"| sum | {1000 * total:.1f} | |"]


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
