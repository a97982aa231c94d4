"""What `--preset paper` costs: measured steps and memory, and the hours of a full run at that pace.

    python -m benchmarks paper SCENE [--photos 8] [--steps 24] [--device cpu] [--page docs/paper-preset.md]

A few steps of each pass and of Phase II are trained at full size on some of the scene's photos. The lines between the
page's marks are replaced; without --page they are printed.
"""

import dataclasses
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import torch

from benchmarks import command_line
from benchmarks.provenance import commit, machine
from benchmarks.speed.timing import median_gap
from lightprobe.core.config import Preset, settings
from lightprobe.core.config.presets import Settings
from lightprobe.core.device import resolve_device
from lightprobe.core.errors import InputError
from lightprobe.core.files import write_bytes
from lightprobe.core.memory import peak_memory
from lightprobe.distillation.examples import TrainingExample, collect_examples
from lightprobe.distillation.training import train
from lightprobe.reconstruction import Progress, decompose
from lightprobe.scene import load_scene
from lightprobe.scene.photo import Scene

BEGIN, END = "<!-- measured by benchmarks/paper.py -->", "<!-- end of what was measured -->"
PHOTOS = 102  # of the scene of a projected run
PASSES = ("pass1", "pass2", "Phase II")
_NAMES = {"pass1": "first pass", "pass2": "second pass", "Phase II": "Phase II"}


@dataclass(frozen=True)
class Costs:
    """What the measured steps took."""

    steps: dict[str, float]  # seconds a step, by `PASSES`
    worked: dict[str, float]  # the processor's seconds a step, of all threads: what other jobs hardly change
    memory: dict[str, float | None]  # GiB at most until the end of each
    lesson: float  # seconds to prepare one
    lesson_worked: float  # of the processor
    lesson_bytes: int  # held of one
    faces: int
    photos: int
    device: torch.device


def small() -> Settings:
    """Return the preset at sizes that take seconds."""
    usual = settings(Preset.PAPER)
    first = dataclasses.replace(usual.decompose, pass1_side=32, pass2_side=32, lattice_cells=10)
    first = dataclasses.replace(
        first, hash_log2_size=10, texture_size=64, light_resolution=8, unwrap_seconds=0.0
    )
    second = dataclasses.replace(usual.distill, light_resolution=8, max_side=32, width=16)
    return dataclasses.replace(usual, decompose=first, distill=second)


def measure(scene: Scene, sizes: Settings, photos: int, steps: int, device: torch.device) -> Costs:
    """Train `steps` steps of each part on at most `photos` training photos, and return what they took."""
    scene = dataclasses.replace(scene, train=scene.train[:: max(1, len(scene.train) // photos)][:photos])
    if steps < max(len(scene.train), 5):
        raise InputError(f"{len(scene.train)} photos need --steps of at least {max(len(scene.train), 5)}.")
    stamps: dict[str, list[float]] = {}
    worked: dict[str, list[float]] = {}
    memory: dict[str, float | None] = {}

    def on_step(stage: str, step: int, count: int, loss: float) -> None:
        stamps.setdefault(stage, []).append(time.perf_counter())
        worked.setdefault(stage, []).append(time.process_time())
        on_gpu = device.type == "cuda"
        memory[stage] = torch.cuda.max_memory_allocated(device) / 2**30 if on_gpu else peak_memory()

    config = dataclasses.replace(sizes.decompose, pass1_iterations=steps, pass2_iterations=steps)
    found = decompose(scene, config, device, 0, Progress(on_step=on_step))
    begin = time.perf_counter(), time.process_time()
    second = dataclasses.replace(sizes.distill, steps=steps)
    lessons = collect_examples(found.asset, found.lights, scene, second, device, 0)
    end = time.perf_counter(), time.process_time()
    made, busy = ((now - then) / len(lessons) for now, then in zip(end, begin, strict=True))
    train(lessons, second, device, 0, Progress(on_step=lambda _, *step: on_step("Phase II", *step)))
    seconds, work = (
        {name: _step_seconds(each[name], device) for name in PASSES} for each in (stamps, worked)
    )
    held = _held(lessons[0])
    return Costs(
        seconds, work, memory, made, busy, held, len(found.asset.mesh.faces), len(scene.train), device
    )


def _step_seconds(stamps: list[float], device: torch.device) -> float:
    """Return the seconds of a step; of a GPU, whose losses are read in bunches, the later half's mean."""
    if device.type == "cpu":
        return median_gap(stamps)
    half = len(stamps) // 2
    return (stamps[-1] - stamps[half - 1]) / (len(stamps) - half)


def _held(lesson: TrainingExample) -> int:
    tensors = [
        *lesson.pixels.tensors(),
        *(value for value in vars(lesson).values() if isinstance(value, torch.Tensor)),
    ]
    return sum(tensor.numel() * tensor.element_size() for tensor in tensors)


def hours(steps: dict[str, float], lesson: float, sizes: Settings, photos: int = PHOTOS) -> float:
    """Return the hours of a full run on `photos` photos, from seconds a step and a lesson."""
    config = sizes.decompose
    counts = (config.pass1_iterations, config.pass2_iterations, sizes.distill.steps)
    trained = sum(count * steps[name] for name, count in zip(PASSES, counts, strict=True))
    return (trained + photos * lesson) / 3600


def rows(costs: Costs, sizes: Settings, note: str) -> list[str]:
    """Return the lines of the page."""
    gpu = costs.device.type == "cuda"
    first = sizes.decompose
    lines = [
        f"Commit {commit()}; {machine()}; {torch.get_num_threads()} thread(s) of PyTorch; {costs.photos} photos at "
        f"{first.pass1_side} pixels, {costs.faces:,} triangles. {note}".rstrip(),
        "",
        "| part | s a step | processor's s a step | steps of a full run | hours | processor's hours | "
        f"most {'GPU ' if gpu else ''}memory so far |",
        "| --- |" + " ---: |" * 6,
    ]
    counts = (first.pass1_iterations, first.pass2_iterations, sizes.distill.steps)
    for name, count in zip(PASSES, counts, strict=True):
        memory = costs.memory[name]
        size = "–" if memory is None else f"{memory:.2f} GiB"
        step, work = costs.steps[name], costs.worked[name]
        cells = f"{step:.3f} | {work:.3f} | {count:,} | {step * count / 3600:.1f} | {work * count / 3600:.1f}"
        lines.append(f"| {_NAMES[name]} | {cells} | {size} |")
    more = (16 * first.pass1_side**2 + 3 * 12 * 6 * first.light_resolution**2) / 2**20
    whole, busy = hours(costs.steps, costs.lesson, sizes), hours(costs.worked, costs.lesson_worked, sizes)
    lines += [
        "",
        f"Preparing a lesson takes {costs.lesson:.1f} s, of the processor {costs.lesson_worked:.1f} s.",
        f"Each further photo takes {more:.1f} MiB in Phase I and {costs.lesson_bytes / 2**20:.1f} MiB in Phase II.",
        f"**A full run on {PHOTOS} photos, projected: {whole:.1f} hours, {busy:.1f} of the processor's.**",
    ]
    return lines


def replaced(page: str, lines: str) -> str:
    """Return a page with other lines between its marks; raise `InputError` if it has none."""
    before, begin, rest = page.partition(BEGIN)
    _, end, after = rest.partition(END)
    if not begin or not end:
        raise InputError(f"The page has no lines between '{BEGIN}' and '{END}' to replace.")
    return f"{before}{BEGIN}\n\n{lines}\n{END}{after}"


def main(words: Sequence[str]) -> None:
    """Read the command line, measure and write."""
    parser = command_line(__doc__)
    parser.add_argument("scene", type=Path)
    parser.add_argument("--photos", type=int, default=8, help="training photos looked at")
    parser.add_argument("--steps", type=int, default=24, help="of each pass, at least as many as photos")
    parser.add_argument("--device", default="cpu", help="auto, cpu or cuda")
    parser.add_argument("--page", type=Path, help="page whose marked lines are replaced")
    parser.add_argument("--note", default="", help="one sentence on the circumstances")
    parser.add_argument("--brief", action="store_true", help="small sizes, to see that all of it works")
    given = parser.parse_args(words)
    sizes = small() if given.brief else settings(Preset.PAPER)
    costs = measure(load_scene(given.scene), sizes, given.photos, given.steps, resolve_device(given.device))
    text = "\n".join(rows(costs, sizes, given.note)) + "\n"
    if given.page is None:
        print(text)
        return
    write_bytes(given.page, replaced(given.page.read_text(encoding="utf-8"), text).encode())
    print(f"Page: {given.page}")
