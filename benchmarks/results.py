"""All records of a benchmark, by scene and by what was evaluated; and what each scene was used for."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from functools import cached_property

from benchmarks import make
from benchmarks.markdown import NONE, markdown_table
from benchmarks.record import Kind, Metrics, Record
from benchmarks.shoot import DESIGNS

PAPER_METHOD = "probe-mlp"
PAPER_LESSONS = "photos alone"

Rows = list[tuple[list[str], Record | None]]  # cells, and the record that they are from if it is one


class Role(StrEnum):
    """What a scene was used for in the development of the program, as the tables say it."""

    UNTOUCHED = "untouched: no setting was chosen by it"
    YOURS = "yours: not used in development"
    DEVELOPMENT = "development: looked at while settings were chosen"


_UNTOUCHED = ("kettle", "figure")
_DEVELOPMENT = ("chair", "spot", "bottle", "robot", "vase", "cape", "liberty", "demo")
BENCH_SCENES = (*_UNTOUCHED, *_DEVELOPMENT[:-1])  # the demo has a command of its own


def role(scene: str) -> Role:
    """Return what a scene was used for."""
    made = scene.removesuffix("-shoot")  # as `benchmarks make` names it
    if scene in _UNTOUCHED or made in make.UNTOUCHED:
        return Role.UNTOUCHED
    return Role.DEVELOPMENT if scene in _DEVELOPMENT or made in DESIGNS else Role.YOURS


def ordered(scenes: Iterable[str]) -> list[str]:
    """Return each scene once, by roles, then in the order of the lists above."""
    roles, known = list(Role), (*_UNTOUCHED, *_DEVELOPMENT)
    place = {scene: known.index(scene) if scene in known else len(known) for scene in scenes}
    return sorted(place, key=lambda scene: (roles.index(role(scene)), place[scene], scene))


@dataclass(frozen=True)
class BenchResults:
    """What a benchmark has found so far; anything may still be missing."""

    records: list[Record] = field(default_factory=list)
    missing: list[str] = field(default_factory=list)  # sentences

    def by_scene(self, kind: Kind, label: str = "") -> dict[str, Record]:
        """Return the scenes' records of one kind, untouched scenes first."""
        found = {r.scene: r for r in self.records if r.kind is kind and r.label == label}
        return {scene: found[scene] for scene in ordered(found)}

    @cached_property
    def runs(self) -> dict[str, Record]:
        """The scenes' own runs."""
        return self.by_scene(Kind.RUN)

    @cached_property
    def oracle(self) -> dict[str, Record]:
        """The same runs with the scenes' true objects."""
        return self.by_scene(Kind.ORACLE)

    @cached_property
    def paper(self) -> dict[str, Record]:
        """The runs with the paper's settings."""
        return self.by_scene(Kind.PAPER)

    @cached_property
    def lessons(self) -> dict[str, dict[str, Record]]:
        """Other training examples of Phase II -> scene -> record."""
        labels = {record.label for record in self.records if record.kind is Kind.LESSONS}
        return {label: self.by_scene(Kind.LESSONS, label) for label in sorted(labels)}

    @cached_property
    def losses(self) -> dict[str, list[Record]]:
        """Loss of the ablation -> a record for each seed."""
        found: dict[str, list[Record]] = {}
        losses = [record for record in self.records if record.kind is Kind.LOSS]
        for record in sorted(losses, key=lambda r: (len(r.label), r.label)):
            found.setdefault(record.label, []).append(record)
        return found

    @cached_property
    def seeds(self) -> dict[str, list[Record]]:
        """Scene -> its runs of all seeds, by seed, where there are several."""
        others = [record for record in self.records if record.kind is Kind.SEED]
        found = {scene: [run, *(r for r in others if r.scene == scene)] for scene, run in self.runs.items()}
        return {scene: sorted(runs, key=lambda r: r.seed) for scene, runs in found.items() if len(runs) > 1}

    @cached_property
    def mixed(self) -> bool:
        """Whether the records were made at more than one commit, so that each row has to tell its own."""
        return len({record.commit for record in self.records}) > 1


def default_scores(metrics: Metrics) -> dict[str, float]:
    """Return the means of the run's default method."""
    scores: dict[str, float] = metrics["methods"][metrics["default_method"]]
    return scores


def method_name(method: str, record: Record) -> str:
    """Return a method's name in the tables: the paper's method is the paper's only with the paper's settings."""
    if record.kind is Kind.PAPER:
        return f"{method}, paper's settings, {record.iterations} iterations"
    return f"{method}, {record.preset}" if method == PAPER_METHOD else method


def partial_photos(metrics: Metrics, method: str) -> list[Mapping[str, Mapping[str, float]]]:
    """Return the scores, by method, of the photos that a slow `method` was scored on; [] if it saw all."""
    photos = [photo["methods"] for photo in metrics["photos"].values()]
    seen = [each for each in photos if method in each]
    return seen if 0 < len(seen) < len(photos) else []


def rows_table(results: BenchResults, head: list[str], rows: Rows) -> list[str]:
    """Return a table, [] without rows, with a column for the commit where the records are of several."""
    if not results.mixed:
        return markdown_table(head, [cells for cells, _ in rows]) if rows else []
    lines = [[*cells, NONE if record is None else record.commit] for cells, record in rows]
    return markdown_table([*head, "commit"], lines) if rows else []
