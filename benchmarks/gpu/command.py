"""Measures the program on a GPU beside the CPU, within 25 minutes, and writes benchmarks/GPU.md.

    python tools/measure_gpu.py [--device cuda] [-o benchmarks/GPU.md] [--minutes 24.5] [--seed 0] [--parts NAME ...]
    python tools/measure_gpu.py --device cpu --brief [-o PAGE.md]

    tests       pytest -m cuda                                                             (gpu.checks)
    kernels     every kernel's body against the device's limits and the CPU's result       (gpu.kernels)
    quality     the demo's training on the device and on the CPU, and both their scores    (gpu.training)
    prediction  latency, photos a second, and the maps' difference from the CPU's          (gpu.prediction)
    pace        the first steps of each stage of the preset `standard`                     (gpu.training)
    standard    Phase I and II of `standard`, and its scores                               (gpu.training)

Each part, or each of --parts, runs in a process of its own within its share of the time. One that fails or takes too
long is recorded with the sentence it left, and the rest goes on. Everything is made from the bundled scene. On a CPU
the page is printed, and written only where -o says: benchmarks/GPU.md is for GPUs.
"""

import argparse
import shlex
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

from gpu.boxes import Part, Setting
from gpu.page import BOXES, measure, page
from lightprobe.core.device import resolve_device
from lightprobe.core.errors import LightprobeError
from lightprobe.core.files import write_bytes

PAGE = Path("benchmarks/GPU.md")
_PARTS = {
    "tests": ("checks", "tests_part"),
    "kernels": ("kernels", "kernels_part"),
    "quality": ("training", "quality_part"),
    "prediction": ("prediction", "prediction_part"),
    "pace": ("training", "pace_part"),
    "standard": ("training", "standard_part"),
}


def part_of(name: str) -> Part:
    """Return the function of a part; only what it needs is imported."""
    import importlib

    module, function = _PARTS[name]
    part: Part = getattr(importlib.import_module(f"gpu.{module}"), function)
    return part


def main(arguments: Sequence[str]) -> None:
    """Read the command line, measure and write."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--device", default="cuda", help="cuda, cuda:N, or cpu to see that all of it works")
    parser.add_argument("--brief", action="store_true", help="small cases")
    parser.add_argument("-o", "--output", type=Path, help=f"the page; on a GPU by default {PAGE}")
    parser.add_argument("--minutes", type=float, default=24.5, help="for all parts together")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument(
        "--parts", nargs="+", choices=list(_PARTS), default=list(_PARTS), help="by default all"
    )
    given = parser.parse_args(arguments)
    boxes = tuple(box for box in BOXES if box.part in given.parts)
    begin = time.perf_counter()
    device = resolve_device(given.device)
    output = given.output or (None if device.type == "cpu" or given.brief else PAGE)
    with tempfile.TemporaryDirectory(prefix="lightprobe-gpu-") as folder:
        setting = Setting(Path(folder), str(device), given.brief, given.seed)
        found = measure(setting, given.minutes, boxes)
        command = shlex.join(["python", "tools/measure_gpu.py", *arguments])
        text = page(setting, found, command, time.perf_counter() - begin, boxes)
    if output is None:
        print(text)
    else:
        write_bytes(output, text.encode())
        print(f"GPU: {output}")
    failed = [box.title for box in boxes if found[box.part].failure]
    if failed:
        sys.exit(f"These parts failed, the page says why: {', '.join(failed)}.")


if __name__ == "__main__":
    try:
        if sys.argv[1:2] and sys.argv[1] in _PARTS:
            part_of(sys.argv[1])(Setting.of_words(sys.argv[2:]))
        else:
            main(sys.argv[1:])
    except LightprobeError as error:
        sys.exit(str(error))
