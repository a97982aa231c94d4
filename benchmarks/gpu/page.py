"""benchmarks/GPU.md: the parts one after the other, each within its share of the time, and what became of
them.
"""

import time
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from lightprobe.report.provenance import commit, machine

from gpu.boxes import Outcome, Setting, child_command, pace_rows, run_part

SCRIPT = Path(__file__).parents[1] / "measure_gpu.py"


@dataclass(frozen=True)
class Box:
    """A part of the page and the minutes it may take; what an earlier one leaves over comes on top."""

    part: str
    title: str
    minutes: float
    about: str


BOXES = (
    Box("tests", "Tests", 5.0, "The tests that need a CUDA device."),
    Box("kernels", "Kernels", 2.0, "Each kernel's body on the device, beside the device's limits."),
    Box(
        "quality",
        "Quality beside the CPU",
        6.0,
        "The demo's training, same seed, on the device and on the CPU; scores on its test photos. Steps of Phase I are "
        "alike on both only until rounding tells them apart, so scores differ as those of two seeds do.",
    ),
    Box(
        "prediction",
        "Predictions",
        2.0,
        "By the run that the device trained above, over the test photos; medians, after a few to warm up. The last "
        "column is the largest relative L2 difference of a map from the one the CPU predicts with the same weights.",
    ),
    Box(
        "pace",
        "Pace of `standard`",
        2.0,
        "The first steps of each stage with the settings meant for a GPU, and how long all of them take at that pace; "
        "what lies between the stages comes on top.",
    ),
    Box(
        "standard",
        "Phase I and II at `standard`",
        7.5,
        "The bundled scene with the settings meant for a GPU.",
    ),
)


def measure(setting: Setting, minutes: float, boxes: tuple[Box, ...] = BOXES) -> dict[str, Outcome]:
    """Run all parts within `minutes`, shared as the boxes' are, and return what became of each, by name."""
    begin, found, left_over = time.perf_counter(), dict[str, Outcome](), 0.0
    scale = minutes / sum(box.minutes for box in boxes)
    for box in boxes:
        share = 60 * box.minutes * scale + left_over
        limit = min(share, 60 * minutes - (time.perf_counter() - begin))
        if limit <= 1:
            found[box.part] = Outcome([], {}, 0.0, "no time was left for it")
            continue
        outcome = run_part(child_command(SCRIPT, box.part, setting), box.part, setting, limit)
        left_over = max(share - outcome.seconds, 0.0)
        found[box.part] = outcome
        print(f"{box.title}: {outcome.failure or 'done'}, {outcome.seconds:.0f} s", flush=True)
    return found


def page(
    setting: Setting,
    found: Mapping[str, Outcome],
    command: str,
    seconds: float,
    boxes: tuple[Box, ...] = BOXES,
) -> str:
    """Return the page of all parts."""
    lines = head(setting, command, seconds)
    missing = [box.title for box in BOXES if box not in boxes]
    if missing:
        lines.append(f"- left out: {', '.join(missing)}")
    for box in boxes:
        outcome = found[box.part]
        lines += ["", f"## {box.title}", "", f"{box.about} {outcome.seconds:.0f} s."]
        if outcome.failure:
            lines += [
                "",
                f"**Failed**: {outcome.failure.rstrip('.')}. What stands below was measured before.",
            ]
        lines += [block for rows in (outcome.rows, pace_rows(outcome.state)) if rows for block in ("", *rows)]
    return "\n".join(lines) + "\n"


def head(setting: Setting, command: str, seconds: float) -> list[str]:
    """Return what was measured where."""
    notes = [
        "",
        "**A brief measurement**: small cases, to see that all of it works; its numbers mean nothing.",
    ]
    away = ["", "**No GPU was measured**: everything below ran on the CPU."]
    return [
        "# On a GPU",
        "",
        "Written by `tools/measure_gpu.py`.",
        *(notes if setting.brief else []),
        *(away if setting.device == "cpu" else []),
        "",
        f"- commit: {commit()}",
        f"- machine: {machine()}",
        f"- command: `{command}`",
        f"- seed: {setting.seed}",
        f"- time: {seconds / 60:.1f} minutes",
    ]
