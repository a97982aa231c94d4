"""What `--preset paper` costs: measured steps and memory, and what its work comes to on a GPU.

    python -m benchmarks paper SCENE [--photos 8] [--steps 24] [--device cpu] [--page docs/paper-preset.md]

A few steps of each pass and of Phase II are trained at full size on some of the scene's photos. The lines between the
page's marks are replaced; without --page they are printed.

The projection counts the arithmetic and the memory traffic that the largest parts of a step cannot do without and
takes a share of a GPU's limits for them, plus the launches; what it leaves out makes it too short.
"""

import argparse
import dataclasses
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import torch

from benchmarks.provenance import commit, machine
from benchmarks.speed.kernels import LOBE
from benchmarks.speed.timing import median_gap
from lightprobe.core.config import Preset, settings
from lightprobe.core.config.presets import Settings
from lightprobe.core.device import resolve_device
from lightprobe.core.errors import InputError
from lightprobe.core.files import write_bytes
from lightprobe.core.memory import peak_memory
from lightprobe.distillation.training import train
from lightprobe.lessons.lesson import Lesson
from lightprobe.lessons.lessons import collect_lessons
from lightprobe.reconstruction import Progress, decompose
from lightprobe.scene import load_scene
from lightprobe.scene.photo import Scene

BEGIN, END = "<!-- measured by benchmarks/paper.py -->", "<!-- end of what was measured -->"
PHOTOS = 102  # of the scene of a projected run
PASSES = ("pass1", "pass2", "Phase II")
_NAMES = {"pass1": "first pass", "pass2": "second pass", "Phase II": "Phase II"}
_ADAM = 28  # bytes of a parameter's step: four numbers read, three written


@dataclass(frozen=True)
class Gpu:
    """A device that the projection is made for, and how much of its limits is reckoned with."""

    name: str
    flops: float  # /s, float32
    bandwidth: float  # bytes/s
    share: float = 0.4
    launch: float = 8e-6  # seconds a kernel takes at least


GPUS = (Gpu("GTX 1080 Ti", 11.3e12, 484e9), Gpu("RTX 4090", 82.6e12, 1008e9))


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


@dataclass(frozen=True)
class Work:
    """What a step cannot do without."""

    flops: float
    moved: float  # bytes
    launches: int

    def seconds(self, gpu: Gpu) -> float:
        """Return how long a GPU takes at the reckoned share of its limits."""
        return (self.flops / gpu.flops + self.moved / gpu.bandwidth) / gpu.share + self.launches * gpu.launch


def small() -> Settings:
    """Return the preset at sizes that take seconds."""
    usual = settings(Preset.PAPER)
    first = dataclasses.replace(
        usual.decompose,
        pass1_side=32,
        pass2_side=32,
        lattice_cells=10,
        hash_log2_size=10,
        texture_size=64,
        light_resolution=8,
        unwrap_seconds=0.0,
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
        memory[stage] = _peak(device)

    config = dataclasses.replace(sizes.decompose, pass1_iterations=steps, pass2_iterations=steps)
    found = decompose(scene, config, device, 0, Progress(on_step=on_step))
    begin = time.perf_counter(), time.process_time()
    second = dataclasses.replace(sizes.distill, steps=steps)
    lessons = collect_lessons(found.asset, found.lights, scene, second, device, 0)
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


def _peak(device: torch.device) -> float | None:
    return torch.cuda.max_memory_allocated(device) / 2**30 if device.type == "cuda" else peak_memory()


def _step_seconds(stamps: list[float], device: torch.device) -> float:
    """Return the seconds of a step; of a GPU, whose losses are read in bunches, the mean over the second
    half.
    """
    if device.type == "cpu":
        return median_gap(stamps)
    half = len(stamps) // 2
    return (stamps[-1] - stamps[half - 1]) / (len(stamps) - half)


def _held(lesson: Lesson) -> int:
    tensors = [
        *lesson.pixels.tensors(),
        *(value for value in vars(lesson).values() if isinstance(value, torch.Tensor)),
    ]
    return sum(tensor.numel() * tensor.element_size() for tensor in tensors)


def hours(steps: dict[str, float], lesson: float, sizes: Settings, photos: int = PHOTOS) -> float:
    """Return the hours of a full run on `photos` photos, from seconds a step and a lesson."""
    config = sizes.decompose
    counts = dict(
        zip(PASSES, (config.pass1_iterations, config.pass2_iterations, sizes.distill.steps), strict=True)
    )
    return (sum(counts[name] * steps[name] for name in PASSES) + photos * lesson) / 3600


def works(sizes: Settings) -> dict[str, Work]:
    """Return the work of a step of each part."""
    first, second = sizes.decompose, sizes.distill
    vertices, pixels = (first.lattice_cells + 1) ** 3, first.pass1_side**2
    network = 39 * 64 + 2 * 64 * 64 + 64  # multiply-adds of the distances' MLP
    light = 3 * 6 * first.light_resolution**2
    table = first.hash_levels * 2**first.hash_log2_size * first.hash_features
    shading = 4 * 60 * pixels * 3 * 2  # some sixty maps of three channels, there and back
    texels = 8 * first.texture_size**2
    pairs = second.samples * 6 * second.light_resolution**2
    return {
        "pass1": Work(
            6.0 * vertices * network,
            4 * vertices * 64 * 3 * 6 + _ADAM * (table + 3 * vertices + light) + shading,
            900,
        ),
        "pass2": Work(0.0, _ADAM * (texels + light) + 4 * 6 * texels + shading, 700),
        "Phase II": Work(float(pairs * (2 * LOBE + 14)), _ADAM * 40_000, 150),
    }


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
        "",
        *projection_rows(sizes),
    ]
    return lines


def projection_rows(sizes: Settings) -> list[str]:
    """Return the table of what a step's work comes to on GPUs."""
    found = works(sizes)
    lines = [
        f"| projection | {' | '.join(f'{_NAMES[name]}, ms a step' for name in PASSES)} | full run, hours |",
        "| --- |" + " ---: |" * (len(PASSES) + 1),
    ]
    for gpu in GPUS:
        steps = {name: work.seconds(gpu) for name, work in found.items()}
        cells = " | ".join(f"{1000 * steps[name]:.0f}" for name in PASSES)
        lines.append(f"| {gpu.name} | {cells} | {hours(steps, 0.1, sizes):.1f} |")
    usual = GPUS[0]
    return [
        *lines,
        "",
        "Not measured: "
        + "; ".join(
            f"{_NAMES[name]} {work.flops / 1e9:.1f} GFLOP, {work.moved / 1e9:.1f} GB, {work.launches} launches a step"
            for name, work in found.items()
        )
        + f", at {100 * usual.share:.0f} % of a device's limits and {1e6 * usual.launch:.0f} µs a launch.",
    ]


def replaced(page: str, lines: str) -> str:
    """Return a page with other lines between its marks; raise `InputError` if it has none."""
    before, begin, rest = page.partition(BEGIN)
    _, end, after = rest.partition(END)
    if not begin or not end:
        raise InputError(f"The page has no lines between '{BEGIN}' and '{END}' to replace.")
    return f"{before}{BEGIN}\n\n{lines}\n{END}{after}"


def main(words: Sequence[str]) -> None:
    """Read the command line, measure and write."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
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
