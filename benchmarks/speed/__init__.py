"""Kernels, predictions and training on the CPU beside the machine's limits, into benchmarks/SPEED.md.

    python -m benchmarks speed [-o benchmarks/SPEED.md] [--run RUN [--scene FOLDER]] [--quick]

    limits      the rates of copying and of multiplying matrices, in the same process with the same threads
    kernels     Numba and reference bodies, the work that the formula asks for, its share of the limit
    prediction  at 512 x 512 onto 6 x 128 x 128 by the default method, and its memory, in a process of its own; only
                with a finished RUN, as it needs a trained model
    stages      of a prediction by `solve`, growing with object pixels, texels and triangles
    training    steps growing with photos, and what the timings of RUN say of the whole

Where no RUN is needed the object is a ball of many triangles with blotchy material under a smooth light. Times are
medians after a call to warm up; exponents are fitted to logarithms. `--quick` takes small cases once, to see that all
of it works.
"""

import argparse
from collections.abc import Sequence
from pathlib import Path

import torch

from benchmarks.provenance import commit, machine
from benchmarks.speed import training
from benchmarks.speed.kernels import LOBE, all_kernels, kernel_rows, time_kernel, time_prefilter
from benchmarks.speed.stages import measure_target, stage_tables, target_rows
from benchmarks.speed.timing import Limits, measure_limits
from lightprobe.core.files import write_bytes
from lightprobe.core.run import RunFolder


def main(words: Sequence[str]) -> None:
    """Read the command line, measure and write."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("-o", "--output", type=Path, default=Path("benchmarks/SPEED.md"))
    parser.add_argument("--run", type=Path, help="finished run: its model predicts, its timings are read")
    parser.add_argument("--scene", type=Path, help="where the run's photos are, if they have moved")
    parser.add_argument("--quick", action="store_true", help="small cases, one repeat")
    given = parser.parse_args(words)
    write_bytes(given.output, page(given.quick, given.run, given.scene).encode())
    print(f"Speed: {given.output}")


def page(quick: bool, run: Path | None = None, scene: Path | None = None) -> str:
    """Measure everything and return the page; run: a finished one, of whose scene `scene` is the folder."""
    repeats = 1 if quick else 5
    # First of all: except on Linux a child process inherits the most memory that its parent had.
    target = None if run is None else measure_target(run, scene, repeats)
    limits = measure_limits(3 if quick else 10)
    sections = {
        "Kernels": _kernels(quick, repeats, limits),
        "A prediction": target_rows(target),
        "Growth of the stages of a prediction": stage_tables(repeats, quick=quick),
        "Training": _training(run, training.small() if quick else training.usual()),
    }
    lines = [
        "# Speed",
        "",
        "Written by `python -m benchmarks speed`. Times are medians on the CPU; a GPU is not measured here.",
        *(["", "**A quick measurement**: small cases, one repeat; not for comparison."] if quick else []),
        "",
        f"- commit: {commit()}",
        f"- machine: {machine()}",
        f"- threads: {torch.get_num_threads()}",
        f"- limit of copying memory: {limits.copy / 1e9:.1f} GB/s, read and written bytes both counted",
        f"- limit of multiplying and adding, float32: {limits.arithmetic / 1e9:.0f} GFLOP/s, a product of matrices, a",
        "  fused multiply-add being two operations",
    ]
    for title, rows in sections.items():
        lines += ["", f"## {title}", "", *rows]
    return "\n".join(lines) + "\n"


def _kernels(quick: bool, repeats: int, limits: Limits) -> list[str]:
    timings = [time_kernel(kernel, repeats) for kernel in all_kernels(quick=quick)]
    timings.append(time_prefilter(16 if quick else 32, repeats))
    return [
        *kernel_rows(timings, limits),
        "",
        "Reference: the plain PyTorch body; of the prefilter product SciPy's. Work is what the formula asks for, once;",
        f"a pair of the stacking is {LOBE} operations for the lobe and 8 for the sums (backward 6, weight alone 2),",
        "and every pair is evaluated in full, also those below a pixel's horizon. Where work is in GB the limit is",
        "copying, and the bytes are those that the loops name, so tables that stay in a cache can exceed it.",
    ]


def _training(run: Path | None, size: training.Size) -> list[str]:
    config = size.decompose
    return [
        *training.run_rows(None if run is None else RunFolder.open(run)),
        "",
        f"Steps on pictures of the ball: {config.pass1_side} pixels wide and a lattice of {config.lattice_cells} cells",
        f"in the first pass, {size.distill.max_side} pixels in Phase II.",
        "",
        *training.photo_tables(size),
    ]
