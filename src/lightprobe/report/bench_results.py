"""All records of a benchmark, by scene and by what was evaluated."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from functools import cached_property

from lightprobe.report.bench_scenes import ordered
from lightprobe.report.markdown import NONE, markdown_table
from lightprobe.report.records import Kind, Metrics, Record

PAPER_METHOD = "probe-mlp"
PAPER_LESSONS = "photos alone"

Rows = Iterable[tuple[list[str], Record | None]]  # cells, and the record that they are from if it is one


@dataclass(frozen=True)
class BenchResults:
    """What a benchmark has found so far; anything may still be missing."""

    records: list[Record] = field(default_factory=list)
    missing: list[str] = field(default_factory=list)  # sentences

    def by_scene(self, kind: Kind, label: str = "") -> dict[str, Record]:
        """Return the scenes' records of one kind, scenes that nothing was chosen with first."""
        found = {
            record.scene: record for record in self.records if record.kind is kind and record.label == label
        }
        return {scene: found[scene] for scene in ordered(found)}

    @cached_property
    def runs(self) -> dict[str, Record]:
        """The scenes' own runs."""
        return self.by_scene(Kind.RUN)

    @cached_property
    def oracle(self) -> dict[str, Record]:
        """The same with the scenes' true objects."""
        return self.by_scene(Kind.ORACLE)

    @cached_property
    def paper(self) -> dict[str, Record]:
        """The runs with the paper's settings."""
        return self.by_scene(Kind.PAPER)

    @cached_property
    def lessons(self) -> dict[str, dict[str, Record]]:
        """Other lessons of Phase II -> scene -> record."""
        labels = dict.fromkeys(record.label for record in self.records if record.kind is Kind.LESSONS)
        return {label: self.by_scene(Kind.LESSONS, label) for label in sorted(labels)}

    @cached_property
    def losses(self) -> dict[str, list[Record]]:
        """Loss of the ablation -> a record for each seed."""
        found: dict[str, list[Record]] = {}
        for record in sorted(
            (r for r in self.records if r.kind is Kind.LOSS), key=lambda r: (len(r.label), r.label)
        ):
            found.setdefault(record.label, []).append(record)
        return found

    @cached_property
    def seeds(self) -> dict[str, list[Record]]:
        """Scene -> its run and those with other seeds, by seed, where there are others."""
        found = {
            scene: [run, *(r for r in self.records if r.kind is Kind.SEED and r.scene == scene)]
            for scene, run in self.runs.items()
        }
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
    if method == PAPER_METHOD:
        return f"{method}, {record.preset}"
    return method


def whole(metrics: Metrics) -> dict[str, dict[str, float]]:
    """Return the methods that were scored on every photo, with their means; slow ones see a part of them."""
    return {
        method: scores for method, scores in metrics["methods"].items() if not partial_photos(metrics, method)
    }


def partial_photos(metrics: Metrics, method: str) -> list[Mapping[str, Mapping[str, float]]]:
    """Return the scores, by method, of the photos that `method` saw if it did not see all; else an empty
    list.
    """
    photos = [photo["methods"] for photo in metrics["photos"].values()]
    seen = [each for each in photos if method in each]
    return seen if 0 < len(seen) < len(photos) else []


def rows_table(results: BenchResults, head: list[str], rows: Rows) -> list[str]:
    """Return a table, none without rows, with a column for the commit where the records are of several."""
    lines = [[*cells, *(_commit(record) if results.mixed else ())] for cells, record in rows]
    return markdown_table([*head, *(["commit"] if results.mixed else [])], lines) if lines else []


def _commit(record: Record | None) -> list[str]:
    return [NONE if record is None else record.commit]
