"""bench: trains and evaluates every scene, and writes the tables."""

import functools
import math
import os
import platform
import re
import shutil
import subprocess
from collections.abc import Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Annotated, Any

import torch

from lightprobe.cli.failures import INTERRUPTED
from lightprobe.cli.options import Seed, option
from lightprobe.core.config import Preset
from lightprobe.core.errors import ConfigError, ResourceError
from lightprobe.core.files import read_json, write_bytes, write_json
from lightprobe.core.run import RunFolder
from lightprobe.distill import ProbeModel
from lightprobe.evaluate.results import PAPER_LESSONS, PAPER_METHOD, BenchResults, Metrics, results_page
from lightprobe.light.files import environment_files

SCENES = ("chair", "spot", "bottle", "cape", "liberty")
LOSSES_SCENE = "chair"

PAPER = ("--distill.lessons", "teacher", "--distill.sphere-steps", "0")  # Phase II as published

# what else Phase II is trained with on every scene; `distill --hdri` joins them where there is a folder of HDRIs
LESSONS: dict[str, tuple[str, ...]] = {
    PAPER_LESSONS: ("--distill.lessons", "teacher"),
    "re-rendered alone": ("--distill.lessons", "synthetic"),
}
HDRI_LESSONS = "with HDRIs"
LESSONS_METHODS = ("probe-net+optimize", "probe-net", PAPER_METHOD)

# what Phase II is trained with for the ablation
LOSSES: dict[str, tuple[str, ...]] = {
    "L2": ("--distill.no-sample-weight", "--distill.no-intensity-weight"),
    "L2, intensity weight": ("--distill.no-sample-weight",),
    "L2, sample weight": ("--distill.no-intensity-weight",),
    "L2, both weights": (),
    "L2, both weights, alpha² = r²": ("--distill.alpha-rule", "r2"),
}


def bench(
    *,
    scenes: Annotated[tuple[str, ...], option(help="Names of the scenes.")] = SCENES,
    data: Annotated[Path, option(metavar="DIR", help="Where the scenes' folders are, at most one folder down.")] = Path(
        "data"
    ),
    output: Annotated[Path, option(aliases=["-o"], metavar="FOLDER", help="Runs and numbers.")] = Path("runs/bench"),
    runs: Annotated[
        Path | None, option(metavar="FOLDER", help="Finished runs named as the scenes, if not there.")
    ] = None,
    preset: Annotated[Preset, option(help="Size of the training.")] = Preset.QUICK,
    seed: Seed = 0,
    seeds: Annotated[int, option(help="Seeds for each loss of the ablation; 0 leaves it out.")] = 3,
    slow_photos: Annotated[int, option(help="Test photos for methods that take more than 20 s each.")] = 2,
    hdri: Annotated[
        Path | None,
        option(
            metavar="DIR", help="Folder of .exr or .hdr environments, z up: one more Phase II trains under them, too."
        ),
    ] = None,
    results: Annotated[
        Path | None, option(metavar="RESULTS.md", help="The page; by default benchmarks/RESULTS.md, else in FOLDER.")
    ] = None,
) -> None:
    """Train and evaluate every scene with every method, and write the tables.

    Phase II is trained anew for every kind of lessons, and on one scene for every loss of the ablation.
    The same command goes on where an interrupted one stopped; every finished piece is a JSON file in FOLDER/pieces.
    Scenes that are not in DIR are left out and named.

    Examples:
      lightprobe bench --data ~/light-data
      lightprobe bench --data ~/light-data --scenes spot --runs runs --seeds 0
      lightprobe bench --data ~/light-data --hdri ~/hdris
    """
    if hdri is not None:
        _check_hdri(hdri, preset)
    benchmark = Benchmark(output, runs or output / "runs", preset, seed, slow_photos, scenes, data, hdri)
    found = {name: folder for name in scenes if (folder := find_scene(data, name)) is not None}
    for name in scenes:
        if name not in found:
            print(f"SKIPPED {name}: there is no scene of that name in {data}; tell where it is with --data DIR.")
    if not found:
        raise ConfigError(f"None of {', '.join(scenes)} is in {data}; tell where they are with --data DIR.")
    page = results or (Path("benchmarks/RESULTS.md") if Path("benchmarks").is_dir() else output / "RESULTS.md")
    steps = [functools.partial(benchmark.scene, name, folder) for name, folder in found.items()]
    if preset is not Preset.PAPER:  # whose lessons are its own
        steps += [
            functools.partial(benchmark.lessons, kind, name, folder)
            for name, folder in found.items()
            for kind in benchmark.all_lessons
        ]
    if LOSSES_SCENE in found:
        losses = [(variant, seed + number) for number in range(seeds) for variant in LOSSES]
        steps += [functools.partial(benchmark.loss, *loss, found[LOSSES_SCENE]) for loss in losses]
    for step in steps:
        step()
        write_bytes(page, results_page(benchmark.collect()).encode())
    print(f"Results: {page}")
    if benchmark.failed:
        raise ResourceError(f"These pieces failed, their messages stand above: {', '.join(benchmark.failed)}.")


def find_scene(data: Path, name: str) -> Path | None:
    """Return the folder of a scene in `data` or one folder down, or None."""
    places = [data / name, *sorted(folder / name for folder in data.glob("*") if folder.is_dir())]
    return next((place for place in places if place.is_dir()), None)


def _check_hdri(hdri: Path, preset: Preset) -> None:
    """Raise now what would otherwise stop the first Phase II with HDRIs, hours later."""
    if preset is Preset.PAPER:
        raise ConfigError("--hdri changes nothing with --preset paper, which re-renders no photos; leave one out.")
    environment_files(hdri)


class Benchmark:
    """The pieces of a benchmark: each is a command, and the numbers it left, kept as one JSON file."""

    def __init__(
        self, folder: Path, runs: Path, preset: Preset, seed: int, slow_photos: int, scenes: Sequence[str], data: Path,
        hdri: Path | None = None,
    ):  # fmt: skip
        self.folder, self.runs, self.preset, self.seed, self.slow_photos = folder, runs, preset, seed, slow_photos
        self.scenes, self.data, self.hdri = scenes, data, hdri
        self.all_lessons = dict(LESSONS) if hdri is None else {**LESSONS, HDRI_LESSONS: ("--hdri", str(hdri))}
        self.failed: list[str] = []

    def scene(self, name: str, folder: Path) -> None:
        """Train a scene, unless its run is finished, and evaluate it with its own and the true object."""
        run = RunFolder(self.runs / name)
        if not (run.asset_file.is_file() and ProbeModel.exists(run.model_folder)):
            train = ("train", str(folder), "-o", str(run.path), "--preset", self.preset.value, "--seed", str(self.seed))
            if not self._command(f"{name} training", train):
                return
        score = ("eval", str(run.path), "--scene", str(folder), "--slow", "--slow-photos", str(self.slow_photos))
        self._piece(f"{name}.eval", score, run, run.metrics_file)
        if run.oracle.asset_file.is_file():  # the evaluation has found the true object
            self._piece(f"{name}.oracle", (*score, "--oracle-asset"), run, run.oracle.metrics_file)

    def lessons(self, kind: str, name: str, folder: Path) -> None:
        """Train another Phase II on a scene's Phase I, with the lessons `kind`, and evaluate what depends on it."""
        piece = lessons_piece(kind, name)
        if not self._file(f"{name}.eval").is_file():  # it has the rows to compare with
            return
        where = ("--scene", str(folder))
        run = self._variant(piece, name, self.seed, (*where, *self.all_lessons[kind]))
        if run is not None:
            self._piece(piece, ("eval", str(run.path), *where, "--methods", *LESSONS_METHODS), run, run.metrics_file)

    def loss(self, variant: str, seed: int, folder: Path) -> None:
        """Train Phase II of the ablation's scene with one loss and seed on the same Phase I, and evaluate it."""
        piece = f"{LOSSES_SCENE}.loss.{list(LOSSES).index(variant)}.seed{seed}"
        where = ("--scene", str(folder))
        run = self._variant(piece, LOSSES_SCENE, seed, (*where, *PAPER, *LOSSES[variant]))
        if run is not None:
            score = ("eval", str(run.path), *where, "--methods", PAPER_METHOD, "--no-unseen")
            self._piece(piece, score, run, run.metrics_file)

    def _variant(self, piece: str, scene: str, seed: int, options: Sequence[str]) -> RunFolder | None:
        """Train Phase II anew on a scene's Phase I; return the run, or None if there is nothing to score."""
        source, run = RunFolder(self.runs / scene), RunFolder(self.folder / "variants" / piece)
        if self._file(piece).is_file() or not source.asset_file.is_file():
            return None
        share_phase_one(source, run)
        train = ("distill", str(run.path), "--preset", self.preset.value, "--seed", str(seed), *options)
        return run if self._command(f"{piece} training", train) else None

    def collect(self) -> BenchResults:
        """Return all numbers there are."""
        results = BenchResults(self._about(), losses_scene=LOSSES_SCENE)
        absent = [name for name in self.scenes if not self._file(f"{name}.eval").is_file()]
        results.missing += [f"{name}, for which there are no numbers." for name in absent]
        for name in self.scenes:
            for kind, kept in (("eval", results.scenes), ("oracle", results.oracle)):
                if self._file(f"{name}.{kind}").is_file():
                    piece = self._keep(f"{name}.{kind}", name, kept, results)
                    results.training[name] = piece["training"]
        for kind, options in {**LESSONS, HDRI_LESSONS: ("--hdri", "HDRI")}.items():
            kept = results.lessons.setdefault(kind, {})
            for name in results.scenes:
                if self._file(lessons_piece(kind, name)).is_file():
                    self._keep(lessons_piece(kind, name), name, kept, results)
                elif kind in self.all_lessons and self.preset is not Preset.PAPER:
                    results.missing.append(f"{name} with lessons '{kind}', for which there are no numbers.")
            if kept:
                chosen = f"--restart --preset {self.preset.value} --seed {self.seed} {' '.join(options)}"
                results.commands.append(f"lightprobe distill RUN {chosen}   # {kind}")
        for number, variant in enumerate(LOSSES):
            files = sorted((self.folder / "pieces").glob(f"{LOSSES_SCENE}.loss.{number}.seed*.json"))
            if files:
                pieces = [read_json(file) for file in files]
                results.losses[variant] = [piece["metrics"] for piece in pieces]
                chosen = " ".join(("--restart", *PAPER, *LOSSES[variant], "--seed K"))
                commits = ", ".join(sorted({piece["commit"] for piece in pieces}))
                results.commands.append(f"lightprobe distill RUN {chosen}   # {variant}, {commits}")
        return results

    def _keep(self, name: str, scene: str, kept: dict[str, Metrics], results: BenchResults) -> dict[str, Any]:
        """Put a piece's numbers into `kept` and its command into `results`; return the piece."""
        piece: dict[str, Any] = read_json(self._file(name))
        kept[scene] = piece["metrics"]
        results.commands.append(f"{self._unplaced(piece['command'])}   # {piece['commit']}")
        return piece

    def _piece(self, name: str, command: Sequence[str], run: RunFolder, metrics: Path) -> None:
        """Run a command that writes `metrics` and keep these, unless they are kept already."""
        if self._file(name).is_file():
            return
        if self._command(name, command):
            training = training_costs(run)
            text = self._unplaced(" ".join(("lightprobe", *command)))
            value = {"command": text, "commit": commit(), "training": training, "metrics": read_json(metrics)}
            write_json(self._file(name), value)

    def _command(self, name: str, command: Sequence[str]) -> bool:
        """Run a command of the program itself; note a failure and return whether it went well."""
        from lightprobe.cli.main import main

        print(f"lightprobe {' '.join(command)}", flush=True)
        code = main(list(command))
        if code == INTERRUPTED:
            raise KeyboardInterrupt
        if code:
            self.failed.append(name)
        return code == 0

    def _file(self, name: str) -> Path:
        return self.folder / "pieces" / f"{name}.json"

    def _unplaced(self, command: str) -> str:
        return without_places(command, {"DATA": self.data, "RUNS": self.runs, "FOLDER": self.folder})

    def _about(self) -> dict[str, str]:
        lessons = "" if self.hdri is None else " --hdri HDRI"
        threads = os.environ.get("OMP_NUM_THREADS", "")
        return {
            "commit": commit(),
            "machine": machine(),
            "threads": f"{torch.get_num_threads()}" + (f" (OMP_NUM_THREADS={threads})" if threads else ""),
            "preset": self.preset.value,
            "seed": str(self.seed),
            "command": f"`lightprobe bench --data DATA --preset {self.preset.value} --seed {self.seed}{lessons}`",
        }


def share_phase_one(source: RunFolder, run: RunFolder) -> None:
    """Make `run` a run with the finished Phase I of `source` and no Phase II; an existing one is left alone."""
    if run.config_file.is_file():
        return
    shutil.copytree(source.mesh_folder, run.mesh_folder, dirs_exist_ok=True)
    shutil.copyfile(source.scene_file, run.scene_file)
    write_json(run.config_file, {"decompose": source.config("decompose")})


def lessons_piece(kind: str, scene: str) -> str:
    """Return the name of the piece that holds what the lessons `kind` come to on a scene."""
    return f"{scene}.lessons.{kind.replace(' ', '-')}"


def without_places(command: str, places: dict[str, Path]) -> str:
    """Return a command without this machine's folders: names stand for `places`, other absolute paths lose theirs."""
    spellings = {str(spelling): name for name, place in places.items() for spelling in (place, place.resolve())}
    for spelling in sorted(spellings, key=len, reverse=True):  # one place may lie inside another
        command = re.sub(rf"(?<!\S){re.escape(spelling)}(?=[/\\])", spellings[spelling], command)
    return re.sub(r"(?<!\S)(?:/|[A-Za-z]:[/\\])(?:\S*[/\\])?(?=\S)", "", command)


def training_costs(run: RunFolder) -> dict[str, float]:
    """Return the seconds of each phase of a run and the most memory (`memory`, GiB), from its log.

    Phases that were interrupted are left out.
    """
    if not run.log_file.is_file():
        return {}
    text = run.log_file.read_text(encoding="utf-8", errors="replace")
    found: dict[str, float] = {}
    pattern = re.compile(r"(decompose|distill) finished in (\d+):(\d\d)(?:, ([\d.]+) GiB)?")
    for phase, minutes, seconds, memory in pattern.findall(text):
        if f"{phase} goes on from" in text:
            continue
        found[phase] = 60 * int(minutes) + int(seconds)
        if memory:
            found["memory"] = max(float(memory), found.get("memory", 0))
    return found


def commit() -> str:
    """Return the commit of the checkout that the program runs from, or its version outside of one."""
    here = Path(__file__).resolve().parent
    questions = (["rev-parse", "--short", "HEAD"], ["status", "--porcelain", "--untracked-files=no"])
    try:
        name, changes = (
            subprocess.run(["git", "-C", str(here), *words], capture_output=True, text=True, check=True).stdout.strip()
            for words in questions
        )
    except (OSError, subprocess.CalledProcessError):
        return f"version {version('lightprobe')}"
    return f"{name} with changes" if changes else name


def machine() -> str:
    """Return the processor, its cores, and the GPU if PyTorch sees one."""
    name = platform.processor() or platform.machine()
    info = Path("/proc/cpuinfo")
    if info.is_file():
        models = re.findall(r"model name\s*: (.+)", info.read_text(encoding="utf-8"))
        name = models[0] if models else name
    memory = ""
    if hasattr(os, "sysconf") and "SC_PHYS_PAGES" in os.sysconf_names:
        memory = f", {math.ceil(os.sysconf('SC_PAGE_SIZE') * os.sysconf('SC_PHYS_PAGES') / 2**30)} GiB"
    gpu = f", {torch.cuda.get_device_name()}" if torch.cuda.is_available() else ", no GPU"
    return f"{name}, {os.cpu_count()} cores{memory}{gpu}, PyTorch {torch.__version__}"
