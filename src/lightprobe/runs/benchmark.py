"""The pieces of a benchmark: commands of the program itself, and the records that their numbers are kept in.

A piece is the words of a command, as a record tells them and a person could type them. Who runs them is told.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path

from lightprobe.core.config import Preset
from lightprobe.core.errors import ConfigError
from lightprobe.core.files import read_json, write_json
from lightprobe.core.run import RunFolder
from lightprobe.models import LightAccuracy, ObjectVerdict
from lightprobe.report.bench_results import PAPER_LESSONS, PAPER_METHOD
from lightprobe.report.bench_scenes import BENCH_SCENES
from lightprobe.report.provenance import commit, machine, threads, training_costs, without_places
from lightprobe.report.records import Kind, Record
from lightprobe.runs.bench_runs import check_trained, is_finished, paper_options, share_phase_one
from lightprobe.runs.phases import TRAINED

LOSSES_SCENE = "chair"
PAPER = (
    "--distill.lessons",
    "teacher",
    "--distill.sphere-steps",
    "0",
)  # Phase II on photos alone, without the network

# what else Phase II is trained with on every scene; `distill --hdri` joins them where there is a folder of
# HDRIs
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


RunCommand = Callable[
    [Sequence[str]], bool
]  # runs a command of the program, given in words; whether it went well
Say = Callable[[str], None]  # shows a sentence to whoever waits


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
    """Names of the scenes."""
    data: Path = Path("data")
    """Where the scenes' folders are, at most one folder down."""
    output: Path = Path("runs/bench")
    """Where runs and variants go."""
    runs: Path | None = None
    """Finished runs named as the scenes; by default those in `output`."""
    preset: Preset = Preset.QUICK
    steps: tuple[Step, ...] = tuple(Step)
    seeds: tuple[int, ...] = (0, 1, 2)
    """The first is every run's; the others train the default and the losses again."""
    paper_iterations: tuple[int, ...] = ()
    """Steps of each pass of Phase I and of Phase II in runs with the paper's settings; none: no such runs."""
    slow_photos: int = 2
    """Test photos for methods that take more than 20 s each."""
    hdri: Path | None = None
    """Folder of .exr or .hdr environments, z up, that one more Phase II trains under."""
    records: Path | None = None
    """Folder of the records; by default benchmarks/records where there is a folder benchmarks, else in
    `output`.
    """
    results: Path | None = None
    """The page; by default benchmarks/RESULTS.md, else in `output`."""


class Benchmark:
    """The pieces of a benchmark: each is a command, and the record of the numbers it left."""

    def __init__(self, options: BenchOptions, records: Path, run_command: RunCommand, say: Say):
        """Keep records in the folder `records`; `run_command` makes the pieces, `say` hears of those already
        made.
        """
        self.folder, self.runs, self.records = (
            options.output,
            options.runs or options.output / "runs",
            records,
        )
        self.preset, self.seeds, self.slow_photos = options.preset, options.seeds, options.slow_photos
        self.data, self.hdri, self._run_command, self._say = options.data, options.hdri, run_command, say
        self.all_lessons = dict(LESSONS)
        if options.hdri is not None:
            self.all_lessons[HDRI_LESSONS] = ("--hdri", str(options.hdri))
        self.failed: list[str] = []

    def scene(self, name: str, folder: Path) -> None:
        """Train a scene, unless its run is finished, and evaluate it with its own and the true object."""
        record, run, options = self._own(name)
        if not self._train(record, run, folder, options):
            return
        score = (
            "eval",
            str(run.path),
            "--scene",
            str(folder),
            "--slow",
            "--slow-photos",
            str(self.slow_photos),
        )
        scored = self._score(record, score, run, run.metrics_file)
        if run.oracle.asset_file.is_file():  # the evaluation has found the true object
            oracle = self._record(name, Kind.ORACLE)
            kept = self._kept(oracle)
            anew = kept is not None and (
                scored or kept.trained != _trained_at(run)
            )  # never beside another training
            self._score(oracle, (*score, "--oracle-asset"), run, run.oracle.metrics_file, anew=anew)

    def seed(self, name: str, folder: Path, seed: int) -> None:
        """Train a scene once more with another seed and evaluate the default method."""
        own, (record, run, options) = self._scored(name, f"seed {seed}"), self._seeded(name, seed)
        if own is None or self._done(record):  # whose default method it is
            return
        if self._train(record, run, folder, options):
            score = (
                "eval",
                str(run.path),
                "--scene",
                str(folder),
                "--methods",
                own.metrics["default_method"],
            )
            self._score(record, score, run, run.metrics_file)

    def paper(self, name: str, folder: Path, first: int, second: int) -> None:
        """Train a scene with the paper's settings and so many of its iterations, and evaluate the paper's
        method.
        """
        record, run, options = self._by_the_paper(name, first, second)
        if not self._done(record) and self._train(record, run, folder, options):
            score = ("eval", str(run.path), "--scene", str(folder), "--methods", PAPER_METHOD)
            self._score(record, score, run, run.metrics_file)

    def lessons(self, kind: str, name: str, folder: Path) -> None:
        """Train another Phase II on a scene's Phase I, with the lessons `kind`, and evaluate what depends on
        it.
        """
        record, where = self._record(name, Kind.LESSONS, label=kind), ("--scene", str(folder))
        if self._scored(name, f"lessons {kind}") is None:  # it has the rows to compare with
            return
        run = self._variant(record, (*where, *self.all_lessons[kind]))
        if run is not None:
            score = ("eval", str(run.path), *where, "--methods", *LESSONS_METHODS)
            self._score(record, score, run, run.metrics_file)

    def loss(self, variant: str, seed: int, folder: Path) -> None:
        """Train Phase II of the ablation's scene with one loss and seed on the same Phase I, and evaluate it."""
        record, where = (
            self._record(LOSSES_SCENE, Kind.LOSS, label=variant, seed=seed),
            ("--scene", str(folder)),
        )
        run = self._variant(record, (*where, *PAPER, *LOSSES[variant]))
        if run is not None:
            score = ("eval", str(run.path), *where, "--methods", PAPER_METHOD, "--no-unseen")
            self._score(record, score, run, run.metrics_file)

    def check(self, names: Sequence[str], steps: Sequence[Step], paper_iterations: tuple[int, ...]) -> None:
        """Raise `ConfigError` for records and finished runs of the scenes `names` that were made otherwise."""
        planned = []
        variants = self.all_lessons if Step.LESSONS in steps else {}
        losses = [(label, seed) for seed in self.seeds for label in LOSSES] if Step.LOSSES in steps else []
        for name in names:
            for kind in (Kind.RUN, Kind.ORACLE):
                self._kept(self._record(name, kind))
            for label in variants:
                self._kept(self._record(name, Kind.LESSONS, label=label))
            for label, seed in losses if name == LOSSES_SCENE else []:
                self._kept(self._record(name, Kind.LOSS, label=label, seed=seed))
            planned += [self._own(name)] if Step.RUN in steps else []
            planned += (
                [self._by_the_paper(name, *paper_iterations)]
                if Step.PAPER in steps and paper_iterations
                else []
            )
            planned += [self._seeded(name, seed) for seed in self.seeds[1:]] if Step.SEEDS in steps else []
        for record, run, options in planned:
            if self._kept(record) is None and is_finished(run):
                check_trained(run, (*options, "--seed", str(record.seed)))

    def _own(self, name: str) -> tuple[Record, RunFolder, tuple[str, ...]]:
        """Return the record of a scene's run that is still to be made, the run, and the options of its
        training.
        """
        return self._record(name, Kind.RUN), RunFolder(self.runs / name), ("--preset", self.preset.value)

    def _seeded(self, name: str, seed: int) -> tuple[Record, RunFolder, tuple[str, ...]]:
        """Return record, run and options as `_own` does, of the scene's run with another seed."""
        run = RunFolder(self.runs / f"{name}.seed{seed}")
        return self._record(name, Kind.SEED, seed=seed), run, ("--preset", self.preset.value)

    def _by_the_paper(self, name: str, first: int, second: int) -> tuple[Record, RunFolder, tuple[str, ...]]:
        """Return record, run and options as `_own` does, of the scene's run with the paper's settings."""
        options, iterations = paper_options(first, second)
        record = self._record(name, Kind.PAPER, preset=Preset.PAPER, iterations=iterations)
        return record, RunFolder(self.runs / f"{name}.paper"), options

    def _scored(self, name: str, piece: str) -> Record | None:
        """Return the record of a scene's own run, without which the piece is left out, and that is said."""
        own = self._kept(self._record(name, Kind.RUN))
        if own is None:
            self._say(f"SKIPPED {name}, {piece}: the scene's run has no numbers yet; add run to --steps.")
        return own

    def _record(
        self,
        scene: str,
        kind: Kind,
        *,
        label: str = "",
        seed: int | None = None,
        preset: Preset | None = None,
        iterations: str = "",
    ) -> Record:
        """Return the record of an evaluation that is still to be made."""
        chosen = self.seeds[0] if seed is None else seed
        return Record(scene, kind, {}, label, chosen, (preset or self.preset).value, iterations=iterations)

    def _kept(self, record: Record) -> Record | None:
        """Return the record as it is kept, or None; raise `ConfigError` for one that was made with other
        settings.
        """
        path = self.records / f"{record.name}.json"
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
            file = self.records / f"{record.name}.json"
            self._say(f"KEPT {record.name}: scored at {kept.commit}; delete {file} to repeat it.")
        return kept is not None

    def _train(self, record: Record, run: RunFolder, folder: Path, options: Sequence[str]) -> bool:
        """Train a run, unless it is finished; return whether there is one.

        Raises `ConfigError` for a finished one that was trained with other settings, which its record would
        not tell.
        """
        options = (*options, "--seed", str(record.seed))
        if self._kept(record):
            return True
        if is_finished(run):
            check_trained(run, options)
            return True
        return self._learn(record, run, ("train", str(folder), "-o", str(run.path), *options))

    def _variant(self, record: Record, options: Sequence[str]) -> RunFolder | None:
        """Train Phase II anew on a scene's Phase I; return the run, or None if there is nothing to score."""
        source, run = RunFolder(self.runs / record.scene), RunFolder(self.folder / "variants" / record.name)
        if self._done(record):
            return None
        if not source.asset_file.is_file():
            self._say(f"SKIPPED {record.name}: {source.path} has no Phase I; add run to --steps.")
            return None
        share_phase_one(source, run)
        chosen = ("--preset", self.preset.value, "--seed", str(record.seed))
        return run if self._learn(record, run, ("distill", str(run.path), *chosen, *options)) else None

    def _learn(self, record: Record, run: RunFolder, command: Sequence[str]) -> bool:
        if not self._command(f"{record.name} training", command):
            return False
        if not (run.path / TRAINED).is_file():
            write_json(run.path / TRAINED, {"commit": commit()})
        return True

    def _score(
        self, record: Record, command: Sequence[str], run: RunFolder, metrics: Path, *, anew: bool = False
    ) -> bool:
        """Run a command that writes `metrics` and keep the record of these; return whether that was done.

        It is not where the record is kept already, unless it is to be made `anew`.
        """
        if (anew or not self._done(record)) and self._command(record.name, command):
            text = " ".join(("lightprobe", *command))
            about = {**vars(record), "metrics": read_json(metrics), "command": self._unplaced(text)}
            about |= {
                "commit": commit(),
                "machine": machine(),
                "threads": threads(),
                "training": training_costs(run),
            }
            about["trained"] = _trained_at(run)
            if record.kind is not Kind.ORACLE:
                verdict, accuracy = ObjectVerdict.load(run.verdict_file), LightAccuracy.load(run.model_folder)
                about |= {"object_verdict": verdict.to_json()} if verdict is not None else {}
                about |= {"light_accuracy": accuracy.to_json()} if accuracy is not None else {}
            Record(**about).write(self.records)
            return True
        return False

    def _command(self, name: str, command: Sequence[str]) -> bool:
        """Run a command of the program itself; note a failure and return whether it went well."""
        done = self._run_command(command)
        if not done:
            self.failed.append(name)
        return done

    def _unplaced(self, command: str) -> str:
        places = {"DATA": self.data, "RUNS": self.runs, "FOLDER": self.folder}
        return without_places(command, places if self.hdri is None else {**places, "HDRI": self.hdri})


def _trained_at(run: RunFolder) -> str:
    """Return the commit that trained a run, "" where no benchmark did."""
    trained = run.path / TRAINED
    return str(read_json(trained)["commit"]) if trained.is_file() else ""
