"""A benchmark: every scene trained and evaluated, a record of every evaluation, and the results page from them.

    python -m benchmarks run --data DATA
    python -m benchmarks run --data DATA --scenes spot --steps run seeds --runs runs
    python -m benchmarks run --data DATA --scenes spot cape --steps paper --paper-iterations 1500 2000

A piece is two commands of the program, as a person could type them, and the record of the numbers they left. Every
finished piece leaves its record, so the same call goes on where an interrupted one stopped, on another day too. A
record is made anew once its file is deleted. Scenes that are not in DATA are left out and named.
"""

import re
import shutil
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from pathlib import Path

import tyro

from benchmarks.provenance import commit, machine, threads, training_costs, without_places
from benchmarks.record import Kind, Record
from benchmarks.results import BENCH_SCENES, PAPER_LESSONS, PAPER_METHOD
from benchmarks.tables import RECORDS, RESULTS, Tables, write_pages
from lightprobe.cli.main import main as program
from lightprobe.core.config import Preset, settings
from lightprobe.core.errors import INTERRUPTED, ConfigError, ResourceError
from lightprobe.core.files import read_json, write_json
from lightprobe.core.run import RunFolder
from lightprobe.evaluation import Protocols
from lightprobe.light.files import environment_files
from lightprobe.models import LightAccuracy, ObjectVerdict
from lightprobe.report.run_info import fitted_preset, read_phases
from lightprobe.runs.phases import TRAINED, is_learnt

RunCommand = Callable[[Sequence[str]], bool]  # runs a command of the program; whether it went well

LOSSES_SCENE = "chair"
LESSONS: dict[str, tuple[str, ...]] = {
    PAPER_LESSONS: ("--distill.lessons", "teacher"),
    "re-rendered alone": ("--distill.lessons", "synthetic"),
}
"""What else Phase II is trained with on every scene; a folder of HDRIs joins these where there is one."""
LESSONS_METHODS = ("probe-net+optimize", "probe-net", PAPER_METHOD)
_PAPERS = (Preset.PAPER, Preset.PAPER_SMALL)  # all of whose runs are the paper's
_ON_PHOTOS = ("--distill.lessons", "teacher", "--distill.sphere-steps", "0")  # and without the sphere network
LOSSES: dict[str, tuple[str, ...]] = {
    "L2": ("--distill.no-sample-weight", "--distill.no-intensity-weight"),
    "L2, intensity weight": ("--distill.no-sample-weight",),
    "L2, sample weight": ("--distill.no-intensity-weight",),
    "L2, both weights": (),
    "L2, both weights, alpha² = r²": ("--distill.alpha-rule", "r2"),
}
"""What Phase II is trained with for the ablation."""


class Step(StrEnum):
    """A part of the benchmark."""

    RUN = "run"
    PAPER = "paper"
    SEEDS = "seeds"
    LESSONS = "lessons"
    LOSSES = "losses"


@dataclass(frozen=True)
class BenchOptions:
    """What a benchmark makes, and where."""

    scenes: tuple[str, ...] = BENCH_SCENES
    """Names of scenes. kettle and figure are for releases."""
    data: Path = Path("data")
    """Where the scenes' folders are, at most one folder down."""
    output: Path = Path("runs/bench")
    """Where runs and variants go."""
    runs: Path | None = None
    """Finished runs named as the scenes; by default those in `output`."""
    preset: Preset = Preset.QUICK
    """Size of the training."""
    steps: tuple[Step, ...] = tuple(Step)
    """What to do: runs, the paper's settings, other seeds, other training examples, losses."""
    seeds: tuple[int, ...] = (0, 1, 2)
    """The first is every run's; the others train the default and the losses again."""
    paper_iterations: tuple[int, ...] = ()
    """Steps of each pass of Phase I and of Phase II in runs with the paper's settings; none: no such runs."""
    slow_photos: int = 2
    """Test photos for methods that take more than 20 s each."""
    hdri: Path | None = None
    """Folder of .exr or .hdr environments, z up, that one more Phase II trains under."""
    records: Path = RECORDS
    """Folder of the records."""
    results: Path = RESULTS
    """The page of results."""

    def check(self) -> None:
        """Raise `ConfigError` or `InputError` for what would otherwise stop a piece hours later."""
        seeds, counts, steps = self.seeds, self.paper_iterations, self.steps
        if not seeds or len(set(seeds)) < len(seeds) or min(seeds) < 0:
            raise ConfigError("--seeds must be one number or more, none negative and none twice.")
        if counts and (len(counts) != 2 or min(counts) < 1):
            raise ConfigError(
                "--paper-iterations must be two numbers of 1 or more: steps of Phase I and of Phase II."
            )
        Protocols(slow_photos=self.slow_photos)
        own_paper = Step.PAPER in steps and set(steps) != set(Step)
        if self.preset in _PAPERS and (self.hdri is not None or counts or own_paper):
            given = "--hdri" if self.hdri is not None else "--paper-iterations" if counts else "--steps paper"
            raise ConfigError(
                f"{given} changes nothing with --preset {self.preset.value}, all of whose runs are the paper's."
            )
        if own_paper and not counts:
            raise ConfigError("--steps paper needs --paper-iterations I II; the paper's own are 40000 30000.")
        if self.hdri is not None:
            environment_files(self.hdri)


@dataclass(frozen=True)
class Piece:
    """A training and an evaluation, and the record that they leave."""

    record: Record  # without scores
    run: RunFolder
    scene: Path
    learn: tuple[str, ...]  # options of the training, without seed
    score: tuple[str, ...] = ()  # options of the evaluation


def run_bench(options: BenchOptions, run_command: RunCommand) -> None:
    """Make every piece that has no record yet, and the results page anew after each.

    Raises `ConfigError` for options that make no sense, where no scene is found and for records and runs of other
    settings, `InputError` for maps that cannot be used, and `ResourceError` at the end if a piece failed.
    """
    options.check()
    found = {
        name: folder for name in options.scenes if (folder := find_scene(options.data, name)) is not None
    }
    for name in options.scenes:
        if name not in found:
            print(
                f"SKIPPED {name}: there is no scene of that name in {options.data}; tell where it is with --data DIR."
            )
    if not found:
        raise ConfigError(
            f"None of {', '.join(options.scenes)} is in {options.data}; tell where they are with --data DIR."
        )
    pieces = plan(options, found)
    if not pieces:
        raise ConfigError(
            f"--steps {' '.join(options.steps)} has nothing to do: seeds need a second one of --seeds, losses the "
            f"scene {LOSSES_SCENE}, lessons another preset than the paper's."
        )
    benchmark = Benchmark(options, run_command)
    for check in (benchmark.check_records, benchmark.check_run):
        for piece in pieces:
            check(piece)
    for piece in pieces:
        benchmark.make(piece)
        if any(options.records.glob("*.json")):
            write_pages(Tables(options.records, options.results), options.scenes)
    print(f"Results: {options.results}")
    if benchmark.failed:
        raise ResourceError(
            f"These pieces failed, their messages stand above: {', '.join(benchmark.failed)}."
        )


def find_scene(data: Path, name: str) -> Path | None:
    """Return the folder of a scene in `data` or one folder down, or None."""
    places = [data / name, *sorted(folder / name for folder in data.glob("*") if folder.is_dir())]
    return next((place for place in places if place.is_dir()), None)


def plan(options: BenchOptions, found: dict[str, Path]) -> list[Piece]:
    """Return all pieces, the most wanted first; found: scene -> folder."""
    steps, seed, preset = options.steps, options.seeds[0], options.preset.value
    runs, size = options.runs or options.output / "runs", ("--preset", preset)
    lessons = LESSONS | ({} if options.hdri is None else {"with HDRIs": ("--hdri", str(options.hdri))})

    def own(name: str, kind: Kind, place: str, score: tuple[str, ...], seed: int = seed) -> Piece:
        return Piece(
            Record(name, kind, {}, "", seed, preset), RunFolder(runs / place), found[name], size, score
        )

    def variant(
        name: str, kind: Kind, label: str, seed: int, learn: tuple[str, ...], score: tuple[str, ...]
    ) -> Piece:
        record = Record(name, kind, {}, label, seed, preset)
        return Piece(
            record, RunFolder(options.output / "variants" / record.name), found[name], (*size, *learn), score
        )

    pieces = []
    if Step.RUN in steps:
        slow = ("--slow", "--slow-photos", str(options.slow_photos))
        pieces += [own(name, Kind.RUN, name, slow) for name in found]
    if options.preset not in _PAPERS and Step.PAPER in steps and options.paper_iterations:
        learn, iterations = paper_options(*options.paper_iterations)
        for name in found:
            record = Record(name, Kind.PAPER, {}, "", seed, Preset.PAPER.value, iterations=iterations)
            score = ("--methods", PAPER_METHOD)
            pieces.append(Piece(record, RunFolder(runs / f"{name}.paper"), found[name], learn, score))
    if Step.SEEDS in steps:
        others = [(name, other) for name in found for other in options.seeds[1:]]
        pieces += [own(name, Kind.SEED, f"{name}.seed{other}", (), other) for name, other in others]
    if options.preset not in _PAPERS and Step.LESSONS in steps:  # which has lessons of its own
        learned = ("--methods", *LESSONS_METHODS)
        kinds = [(name, *kind) for name in found for kind in lessons.items()]
        pieces += [variant(name, Kind.LESSONS, label, seed, learn, learned) for name, label, learn in kinds]
    if Step.LOSSES in steps and LOSSES_SCENE in found:
        seen = ("--methods", PAPER_METHOD, "--no-unseen")
        losses = [(label, each, learn) for each in options.seeds for label, learn in LOSSES.items()]
        pieces += [
            variant(LOSSES_SCENE, Kind.LOSS, label, each, (*_ON_PHOTOS, *learn), seen)
            for label, each, learn in losses
        ]
    return pieces


class Benchmark:
    """Makes pieces, each once."""

    def __init__(self, options: BenchOptions, run_command: RunCommand):
        self.options, self._run_command = options, run_command
        self.failed: list[str] = []

    def check_records(self, piece: Piece) -> None:
        """Raise `ConfigError` where records of a piece or of its scene's own run were made with other settings."""
        own = replace(piece.record, kind=Kind.RUN, label="", iterations="")
        own = replace(own, seed=self.options.seeds[0], preset=self.options.preset.value)
        for record in (own, replace(own, kind=Kind.ORACLE), piece.record):
            self._kept(record)

    def check_run(self, piece: Piece) -> None:
        """Raise `ConfigError` where a finished run, still without a record, was trained with other settings."""
        if piece.record.kind in (Kind.RUN, Kind.PAPER, Kind.SEED) and self._kept(piece.record) is None:
            self._finished(piece)

    def make(self, piece: Piece) -> None:
        """Train and evaluate, unless the record is kept; a scene's own run is scored with the true object, too."""
        record, run, score = piece.record, piece.run, piece.score
        if record.kind in (Kind.SEED, Kind.LESSONS):
            own = self._kept(replace(record, kind=Kind.RUN, label="", seed=self.options.seeds[0]))
            if own is None:  # it tells the default method, and has the rows to compare with
                print(f"SKIPPED {record.name}: the scene's run has no numbers yet; add run to --steps.")
                return
            score = score or ("--methods", own.metrics["default_method"])
        kept = self._done(record)
        if not kept and not self._train(piece):
            return
        command = ("eval", str(run.path), "--scene", str(piece.scene), *score)
        scored = not kept and self._score(record, command, run, run.metrics_file)
        if record.kind is Kind.RUN and run.oracle.asset_file.is_file():  # found by the evaluation
            oracle = replace(record, kind=Kind.ORACLE)
            before = self._kept(oracle)
            stale = before is not None and (scored or before.trained != _trained_at(run))
            if stale or not self._done(oracle):
                self._score(oracle, (*command, "--oracle-asset"), run, run.oracle.metrics_file)

    def _kept(self, record: Record) -> Record | None:
        """Return the record as it is kept, or None; raise `ConfigError` for one made with other settings."""
        path = self.options.records / f"{record.name}.json"
        if not path.is_file():
            return None
        kept = Record.read(path)
        for key in ("preset", "seed", "iterations"):
            if getattr(kept, key) != getattr(record, key):
                raise ConfigError(
                    f"{path} was made with {key} {getattr(kept, key)}, not {getattr(record, key)}; delete it, or "
                    "keep other records elsewhere with --records DIR."
                )
        return kept

    def _done(self, record: Record) -> bool:
        """Return whether the record is kept, and say so."""
        kept = self._kept(record)
        if kept is not None:
            file = self.options.records / f"{record.name}.json"
            print(f"KEPT {record.name}: scored at {kept.commit}; delete {file} to repeat it.")
        return kept is not None

    def _finished(self, piece: Piece) -> bool:
        """Return whether both phases of a piece's run are done; raise `ConfigError` for other settings than its own."""
        done = piece.run.asset_file.is_file() and is_learnt(piece.run)
        if done:
            check_trained(piece.run, (*piece.learn, "--seed", str(piece.record.seed)))
        return done

    def _train(self, piece: Piece) -> bool:
        """Train what a piece evaluates, unless it is finished; return whether there is something to evaluate."""
        record, run = piece.record, piece.run
        learn = (*piece.learn, "--seed", str(record.seed))
        if record.kind in (Kind.LESSONS, Kind.LOSS):
            source = RunFolder((self.options.runs or self.options.output / "runs") / record.scene)
            if not source.asset_file.is_file():
                print(f"SKIPPED {record.name}: {source.path} has no Phase I; add run to --steps.")
                return False
            share_phase_one(source, run)
            command = ("distill", str(run.path), "--scene", str(piece.scene), *learn)
        elif self._finished(piece):
            return True
        else:
            command = ("train", str(piece.scene), "-o", str(run.path), *learn)
        done = self._command(f"{record.name} training", command)
        if done and not (run.path / TRAINED).is_file():
            write_json(run.path / TRAINED, {"commit": commit()})
        return done

    def _score(self, record: Record, command: Sequence[str], run: RunFolder, metrics: Path) -> bool:
        """Run a command that writes `metrics` and keep their record; return whether that was done."""
        if not self._command(record.name, command):
            return False
        verdict, accuracy = ObjectVerdict.load(run.verdict_file), LightAccuracy.load(run.model_folder)
        of_run = record.kind is not Kind.ORACLE
        replace(
            record,
            metrics=read_json(metrics),
            commit=commit(),
            trained=_trained_at(run),
            machine=machine(),
            threads=threads(),
            command=self._unplaced(" ".join(("lightprobe", *command))),
            training=training_costs(run),
            object_verdict=verdict.to_json() if of_run and verdict is not None else {},
            light_accuracy=accuracy.to_json() if of_run and accuracy is not None else {},
        ).write(self.options.records)
        return True

    def _command(self, name: str, command: Sequence[str]) -> bool:
        """Run a command of the program; note a failure and return whether it went well."""
        done = self._run_command(command)
        self.failed += [] if done else [name]
        return done

    def _unplaced(self, command: str) -> str:
        options = self.options
        runs = options.runs or options.output / "runs"
        places = {"DATA": options.data, "RUNS": runs, "FOLDER": options.output}
        return without_places(command, places | ({} if options.hdri is None else {"HDRI": options.hdri}))


def _trained_at(run: RunFolder) -> str:
    """Return the commit that trained a run, "" where no benchmark did."""
    trained = run.path / TRAINED
    return str(read_json(trained)["commit"]) if trained.is_file() else ""


def check_trained(run: RunFolder, options: Sequence[str]) -> None:
    """Raise `ConfigError` unless a finished run was trained with the `options`, names and values in turn, alone.

    Of a run whose settings this version cannot read, the preset is not known, and other settings are not seen.
    """
    given = dict(zip(options[::2], options[1::2], strict=True))
    remedy = "remove it, or choose another with --output or --runs"
    for option, wanted in given.items():
        section, _, key = option.removeprefix("--").replace("-", "_").rpartition(".")
        if key == "preset":
            found = {fitted_preset(run).value}
        else:
            sections = [section] if section else ["decompose", "distill"]
            found = {str(run.config(name).get(key)) for name in sections}
        if found != {wanted}:
            told = " and ".join(sorted(found))
            raise ConfigError(f"{run.path} was trained with {option} {told}, not {wanted}; {remedy}.")
    asked = {f"{option} {value}" for option, value in given.items()}
    for changed in (option for phase in read_phases(run) for option in phase.options(given["--preset"])):
        if changed not in asked:
            raise ConfigError(f"{run.path} was trained with {changed} as well; {remedy}.")


def paper_options(first: int, second: int) -> tuple[tuple[str, ...], str]:
    """Return the options of a training with the paper's settings and fewer iterations, and these in words.

    first: of each pass that Phase I has with these settings; second: of Phase II. More than the paper's are cut.
    """
    paper = settings(Preset.PAPER)
    passes = {f"pass{i}_iterations": getattr(paper.decompose, f"pass{i}_iterations") for i in (1, 2, 3)}
    used = {name: (min(first, most), most) for name, most in passes.items() if most}
    steps = (min(second, paper.distill.steps), paper.distill.steps)
    options = ["--preset", Preset.PAPER.value]
    for name, (count, _) in used.items():
        options += [f"--decompose.{name.replace('_', '-')}", str(count)]
    words = [
        f"{n} of {most}" if n < most else str(most) for n, most in (*dict.fromkeys(used.values()), steps)
    ]
    spaced = re.sub(r"(?<=\d\d)(?=\d{3}\b)", " ", " + ".join(words))
    return (*options, "--distill.steps", str(steps[0])), spaced


def share_phase_one(source: RunFolder, run: RunFolder) -> None:
    """Make `run` a run with the finished Phase I of `source` and no Phase II; an existing one is left alone."""
    if not run.config_file.is_file():
        shutil.copytree(source.mesh_folder, run.mesh_folder, dirs_exist_ok=True)
        shutil.copyfile(source.scene_file, run.scene_file)
        write_json(run.config_file, {"decompose": source.config("decompose")})


def run_program(command: Sequence[str]) -> bool:
    """Run a command of the program and return whether it went well; an interruption ends the benchmark, too."""
    print(f"lightprobe {' '.join(command)}")
    sys.stdout.flush()
    code = program(list(command))
    if code == INTERRUPTED:
        raise KeyboardInterrupt
    return code == 0


def main(words: Sequence[str]) -> None:
    """Read the command line and run the benchmark."""
    config = (tyro.conf.EnumChoicesFromValues,)
    run_bench(tyro.cli(BenchOptions, description=__doc__, args=words, config=config), run_program)
