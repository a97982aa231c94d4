"""The program on a GPU beside the CPU, within 25 minutes, into benchmarks/GPU.md.

    python -m benchmarks gpu [--device cuda] [-o benchmarks/GPU.md] [--minutes 24.5] [--seed 0] [--parts NAME ...]
    python -m benchmarks gpu --device cpu --brief [-o PAGE.md]

    tests       pytest -m cuda
    kernels     every kernel's body against the device's limits and the CPU's result
    quality     the demo's training on the device and on the CPU, and both their scores
    prediction  latency, photos a second, and the maps' difference from the CPU's
    pace        the first steps of each stage of the preset `standard`
    standard    Phase I and II of `standard`, and its scores

Each part, or each of --parts, runs in a process of its own within its share of the time. One that fails or takes too
long is recorded with the sentence it left, and the rest goes on. Everything is made from the bundled scene. On a CPU
the page is printed, and written only where -o says: benchmarks/GPU.md is for GPUs.
"""

import argparse
import importlib
import shlex
import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from benchmarks.gpu.parts import Outcome, Setting, pace_rows, run_part
from benchmarks.provenance import commit, machine
from lightprobe.core.device import resolve_device
from lightprobe.core.files import write_bytes

PAGE = Path("benchmarks/GPU.md")


@dataclass(frozen=True)
class Part:
    """A part of the page and the minutes it may take; what an earlier one leaves over comes on top."""

    module: str  # of this package; its function is NAME_part
    title: str
    minutes: float
    about: str


PARTS = {
    "tests": Part("checks", "Tests", 5.0, "The tests that need a CUDA device."),
    "kernels": Part(
        "kernels", "Kernels", 2.0, "Each kernel's body on the device, beside the device's limits."
    ),
    "quality": Part(
        "training",
        "Quality beside the CPU",
        6.0,
        "The demo's training, same seed, on the device and on the CPU; scores on its test photos. Steps of Phase I are "
        "alike on both only until rounding tells them apart, so scores differ as those of two seeds do.",
    ),
    "prediction": Part(
        "prediction",
        "Predictions",
        2.0,
        "By the run that the device trained above, over the test photos; medians, after a few to warm up. The last "
        "column is the largest relative L2 difference of a map from the one the CPU predicts with the same weights.",
    ),
    "pace": Part(
        "training",
        "Pace of `standard`",
        2.0,
        "The first steps of each stage with the settings meant for a GPU, and how long all of them take at that pace; "
        "what lies between the stages comes on top.",
    ),
    "standard": Part(
        "training",
        "Phase I and II at `standard`",
        7.5,
        "The bundled scene with the settings meant for a GPU.",
    ),
}


def measure(setting: Setting, minutes: float, names: Sequence[str]) -> dict[str, Outcome]:
    """Run the named parts within `minutes`, shared as their own are, and return what became of each."""
    begin, found, left_over = time.perf_counter(), dict[str, Outcome](), 0.0
    scale = minutes / sum(PARTS[name].minutes for name in names)
    for name in names:
        share = 60 * PARTS[name].minutes * scale + left_over
        limit = min(share, 60 * minutes - (time.perf_counter() - begin))
        if limit <= 1:
            found[name] = Outcome([], {}, 0.0, "no time was left for it")
            continue
        command = [sys.executable, "-m", "benchmarks", "gpu", "--part", name, *setting.words()]
        found[name] = run_part(command, name, setting, limit)
        left_over = max(share - found[name].seconds, 0.0)
        print(
            f"{PARTS[name].title}: {found[name].failure or 'done'}, {found[name].seconds:.0f} s", flush=True
        )
    return found


def page(setting: Setting, found: dict[str, Outcome], command: str, seconds: float) -> str:
    """Return the page of the parts that were run."""
    brief = "**A brief measurement**: small cases, to see that all of it works; its numbers mean nothing."
    lines = [
        "# On a GPU",
        "",
        "Written by `python -m benchmarks gpu`.",
        *(["", brief] if setting.brief else []),
        *(
            ["", "**No GPU was measured**: everything below ran on the CPU."]
            if setting.device == "cpu"
            else []
        ),
        "",
        f"- commit: {commit()}",
        f"- machine: {machine()}",
        f"- command: `{command}`",
        f"- seed: {setting.seed}",
        f"- time: {seconds / 60:.1f} minutes",
    ]
    missing = [part.title for name, part in PARTS.items() if name not in found]
    lines += [f"- left out: {', '.join(missing)}"] if missing else []
    for name, outcome in found.items():
        lines += ["", f"## {PARTS[name].title}", "", f"{PARTS[name].about} {outcome.seconds:.0f} s."]
        if outcome.failure:
            failure = outcome.failure.rstrip(".")
            lines += ["", f"**Failed**: {failure}. What stands below was measured before."]
        lines += [block for rows in (outcome.rows, pace_rows(outcome.state)) if rows for block in ("", *rows)]
    return "\n".join(lines) + "\n"


def main(words: Sequence[str]) -> int:
    """Read the command line, measure and write; return 1 where a part failed."""
    if words[:1] == ["--part"]:  # in the process of its own
        module = importlib.import_module(f"benchmarks.gpu.{PARTS[words[1]].module}")
        getattr(module, f"{words[1]}_part")(Setting.of_words(words[2:]))
        return 0
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--device", default="cuda", help="cuda, cuda:N, or cpu to see that all of it works")
    parser.add_argument("--brief", action="store_true", help="small cases")
    parser.add_argument("-o", "--output", type=Path, help=f"the page; on a GPU by default {PAGE}")
    parser.add_argument("--minutes", type=float, default=24.5, help="for all parts together")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--parts", nargs="+", choices=list(PARTS), default=list(PARTS), help="by default all")
    given = parser.parse_args(words)
    begin, device = time.perf_counter(), resolve_device(given.device)
    output = given.output or (None if device.type == "cpu" or given.brief else PAGE)
    with tempfile.TemporaryDirectory(prefix="lightprobe-gpu-") as folder:
        setting = Setting(Path(folder), str(device), given.brief, given.seed)
        found = measure(setting, given.minutes, [name for name in PARTS if name in given.parts])
        command = shlex.join(["python", "-m", "benchmarks", "gpu", *words])
        text = page(setting, found, command, time.perf_counter() - begin)
    if output is None:
        print(text)
    else:
        write_bytes(output, text.encode())
        print(f"GPU: {output}")
    failed = [PARTS[name].title for name, outcome in found.items() if outcome.failure]
    if failed:
        print(f"These parts failed, the page says why: {', '.join(failed)}.", file=sys.stderr)
    return 1 if failed else 0
