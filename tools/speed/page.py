"""benchmarks/SPEED.md from all measurements."""

from dataclasses import dataclass
from pathlib import Path

import torch
from lightprobe.report.provenance import commit, machine

from lightprobe.core.run import RunFolder
from speed import training
from speed.kernels import LOBE, all_kernels, culled_line, kernel_rows, time_kernel, time_prefilter
from speed.limits import Limits, measure_limits
from speed.stages import stage_tables
from speed.target import measure, target_rows


@dataclass(frozen=True)
class Plan:
    """How much is measured."""

    quick: bool
    run: Path | None = None  # a finished run
    scene: Path | None = None  # where its photos are, if they have moved

    @property
    def repeats(self) -> int:
        """Calls whose median is taken."""
        return 1 if self.quick else 5


def page(plan: Plan) -> str:
    """Measure everything and return the page."""
    # First of all: except on Linux a child process inherits the most memory that its parent had.
    target = None if plan.run is None else measure(plan.run, plan.scene, plan.repeats)
    limits = measure_limits(3 if plan.quick else 10)
    size = training.small() if plan.quick else training.usual()
    sections = {
        "Kernels": kernel_section(plan, limits),
        "A prediction": target_rows(target),
        "Growth of the stages of a prediction": stage_tables(plan.repeats, quick=plan.quick),
        "Training": training_section(plan, size),
    }
    lines = head(plan, limits)
    for title, rows in sections.items():
        lines += ["", f"## {title}", "", *rows]
    return "\n".join(lines) + "\n"


def head(plan: Plan, limits: Limits) -> list[str]:
    """Return what was measured where."""
    short = (
        ["", "**A quick measurement**: small cases, one repeat; not for comparison."] if plan.quick else []
    )
    return [
        "# Speed",
        "",
        "Written by `tools/measure_speed.py`. Times are medians on the CPU; a GPU is not measured here.",
        *short,
        "",
        f"- commit: {commit()}",
        f"- machine: {machine()}",
        f"- threads: {torch.get_num_threads()}",
        f"- limit of copying memory: {limits.copy / 1e9:.1f} GB/s, read and written bytes both counted",
        f"- limit of multiplying and adding, float32: {limits.arithmetic / 1e9:.0f} GFLOP/s, a fused multiply-add",
        f"  being two operations (a loop in registers reached {limits.registers / 1e9:.0f}, a product of matrices",
        f"  {limits.matrix / 1e9:.0f})",
    ]


def kernel_section(plan: Plan, limits: Limits) -> list[str]:
    """Return the table of kernels and how to read it."""
    timings = [time_kernel(kernel, plan.repeats) for kernel in all_kernels(quick=plan.quick)]
    timings.append(time_prefilter(16 if plan.quick else 32, plan.repeats))
    return [
        *kernel_rows(timings, limits),
        "",
        "Reference: the plain PyTorch body; of the prefilter product SciPy's. Work is what the formula asks for, once;",
        f"a pair of the stacking is {LOBE} operations for the lobe and 8 for the sums (backward 6, weight alone 2),",
        "and every pair is evaluated in full, also those below a pixel's horizon. Where work is in GB the limit is",
        "copying, and the bytes are those that the loops name, so tables that stay in a cache can exceed it.",
        "",
        culled_line(64 if plan.quick else 128, plan.repeats),
    ]


def training_section(plan: Plan, size: training.Size) -> list[str]:
    """Return what whole trainings, steps and their parts cost."""
    run = None if plan.run is None else RunFolder.open(plan.run)
    config = size.decompose
    return [
        *training.run_rows(run),
        "",
        f"Steps on pictures of the ball: {config.pass1_side} pixels wide and a lattice of {config.lattice_cells} cells",
        f"in the first pass, {config.pass2_side} pixels in the second, {size.distill.max_side} pixels in Phase II.",
        "",
        *training.photo_tables(size),
        "",
        *training.profile_tables(size),
    ]
