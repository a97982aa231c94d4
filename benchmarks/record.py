"""What a finished evaluation of a benchmark leaves: one small JSON file with every photo's scores, and how it
was made.

The tables are written from these files alone, so a benchmark can be made in pieces and on several days. A
record holds the scores that have a heading, to five digits; means and intervals are taken from them anew.
"""

import json
import math
import re
from dataclasses import dataclass, field
from enum import StrEnum
from pathlib import Path
from typing import Any

from lightprobe.core.errors import InputError
from lightprobe.core.files import read_json, write_bytes
from lightprobe.evaluation.metrics import photo_interval
from lightprobe.report.headings import IMAGES, LIGHTS, MAPS, OBJECT

Metrics = dict[str, Any]  # as the content of a metrics.json
_FORMAT = 1  # of the files; another one is refused
_SCORES = IMAGES | LIGHTS | MAPS


class Kind(StrEnum):
    """What was evaluated."""

    RUN = "run"  # a scene's run
    ORACLE = "oracle"  # the same with the scene's true object
    SEED = "seed"  # a run with another seed
    PAPER = "paper"  # a run with the paper's settings
    LESSONS = "lessons"  # another Phase II on the run's Phase I
    LOSS = "loss"  # the paper's Phase II on it with one of the losses of the ablation


@dataclass(frozen=True)
class Record:
    """The scores of one evaluation and how they were made."""

    scene: str
    kind: Kind
    metrics: Metrics
    label: str = ""  # of the lessons or of the loss
    seed: int = 0
    preset: str = ""
    commit: str = ""  # that evaluated
    trained: str = ""  # the commit that trained, where the benchmark did
    machine: str = ""
    threads: str = ""
    command: str = ""
    iterations: str = ""  # where the paper's are cut: how many of how many
    training: dict[str, float] = field(default_factory=dict)  # phase -> seconds, and `memory` in GiB
    object_verdict: dict[str, Any] = field(
        default_factory=dict
    )  # as `ObjectVerdict.to_json`, where there is one
    light_accuracy: dict[str, Any] = field(
        default_factory=dict
    )  # as `LightAccuracy.to_json`, where there is one

    @property
    def name(self) -> str:
        """The name of its file without the suffix: the scene, and what sets it apart from the scene's other
        records.
        """
        parts = [] if self.kind is Kind.RUN else [self.kind.value]
        parts = [f"{self.kind.value}{self.seed}"] if self.kind is Kind.SEED else parts
        parts += [re.sub(r"[^A-Za-z0-9]+", "-", self.label).strip("-")] if self.label else []
        parts += [f"seed{self.seed}"] if self.kind is Kind.LOSS else []
        return ".".join([self.scene, *parts])

    def write(self, folder: Path) -> None:
        """Write the record into `folder`, under its name."""
        about = {
            key: value for key, value in vars(self).items() if key != "metrics" and value not in ("", {})
        }
        content = {"format": _FORMAT, **about, **_packed(self.metrics)}
        scores = ",\n".join(f"{json.dumps(m)}: {_line(s)}" for m, s in content.pop("scores").items())
        lines = [f"{json.dumps(key)}: {_line(value)}" for key, value in content.items()]
        text = "{\n" + ",\n".join([*lines, f'"scores": {{\n{scores}\n}}']) + "\n}\n"
        write_bytes(folder / f"{self.name}.json", text.encode())

    @staticmethod
    def read(path: Path) -> "Record":
        """Read a record; raise `InputError` for a file that is none."""
        stored = read_json(path)
        try:
            if stored["format"] != _FORMAT:
                raise ValueError(f"format {stored['format']}")
            about = {
                key: stored[key] for key in Record.__dataclass_fields__ if key in stored and key != "kind"
            }
            return Record(**about, kind=Kind(stored["kind"]), metrics=_unpacked(stored))
        except (KeyError, TypeError, ValueError, AttributeError, IndexError, ArithmeticError) as error:
            raise InputError(
                f"{path} is no record of a benchmark ({error!r}); delete it to make it anew."
            ) from error


def read_records(folder: Path) -> list[Record]:
    """Return all records of a folder in the order of their names; none where there is no folder."""
    return [Record.read(path) for path in sorted(folder.glob("*.json"))]


def _packed(metrics: Metrics) -> dict[str, Any]:
    """Return the content of a metrics.json with one list per method and score, over photos; None where one
    has none.
    """
    photos = metrics["photos"]
    scores: dict[str, dict[str, list[float | None]]] = {}
    for method in metrics["methods"]:
        each = [photo["methods"].get(method, {}) for photo in photos.values()]
        found = [key for key in _SCORES if any(key in values for values in each)]
        scores[method] = {key: [_short(values.get(key)) for values in each] for key in found}
    bins = {
        method: {**checked, "bins": [{k: _short(v) for k, v in part.items()} for part in checked["bins"]]}
        for method, checked in metrics.get("confidence", {}).items()
    }
    return {
        "default_method": metrics["default_method"],
        "truth": {key: _short(metrics["mean"][key]) for key in OBJECT if key in metrics["mean"]},
        "confidence": bins,
        "skipped": metrics.get("skipped", {}),
        "photos": list(photos),
        "lights": [photo.get("light") for photo in photos.values()],
        "scores": scores,
    }


def _unpacked(stored: dict[str, Any]) -> Metrics:
    """Return the like of a metrics.json, its means and intervals anew from the photos' scores."""
    names, scores = stored["photos"], stored["scores"]
    lights = {name: light for name, light in zip(names, stored["lights"], strict=True) if light is not None}
    values = {
        method: {
            key: {name: value for name, value in zip(names, column, strict=True) if value is not None}
            for key, column in columns.items()
        }
        for method, columns in scores.items()
    }
    means = {
        m: {key: sum(v.values()) / len(v) for key, v in columns.items()} for m, columns in values.items()
    }
    photos: dict[str, Any] = {name: {"methods": {}} for name in names}
    for method, columns in values.items():
        for key, column in columns.items():
            for name, value in column.items():
                photos[name]["methods"].setdefault(method, {})[key] = value
    for name, light in lights.items():
        photos[name]["light"] = light
    widths = {
        m: {key: photo_interval(v, lights) for key, v in columns.items()} for m, columns in values.items()
    }
    return {
        "mean": {**means[stored["default_method"]], **stored["truth"]},
        "interval": {
            m: {key: w for key, w in each.items() if math.isfinite(w)} for m, each in widths.items()
        },
        "default_method": stored["default_method"],
        "methods": means,
        "confidence": stored["confidence"],
        "photos": photos,
        **({"skipped": stored["skipped"]} if stored["skipped"] else {}),
    }


def _line(value: Any) -> str:
    return json.dumps(value, ensure_ascii=False, separators=(",", ":"), allow_nan=False)


def _short(value: float | None) -> float | None:
    return None if value is None else float(f"{value:.5g}")
