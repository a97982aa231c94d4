"""How far a training is, from what its run folder records while it goes on."""

import json
import time
from collections import deque
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from lightprobe.core.config import DecomposeConfig, DistillConfig
from lightprobe.core.errors import InputError, LightprobeError, printable
from lightprobe.core.files import read_json
from lightprobe.core.run import RunFolder
from lightprobe.core.stored import is_finite_number
from lightprobe.core.timings import read_timings
from lightprobe.distillation.training import stages as distill_stages
from lightprobe.models import LightAccuracy, ObjectVerdict
from lightprobe.reconstruction.phase1 import stages as decompose_stages
from lightprobe.runs.phases import is_learnt

_CHUNK = 2**20  # bytes of metrics.jsonl that are sent at once
_TAIL = 8192  # bytes of a log that are looked at
_LINES = 14  # of log.txt that are shown
_WINDOW = 90.0  # seconds over which the speed is measured
_QUIET = 180.0  # seconds without a new record after which a training is taken to have stopped

PHASES = ("decompose", "distill")


@dataclass
class TrainingWatch:
    """What was seen of one run so far, by which its speed is known."""

    run: RunFolder
    _seen: deque[tuple[float, str, int]] = field(default_factory=deque)  # time, phase, step

    def state(self, after: int) -> dict[str, Any]:
        """Return what the page is told, with the records of metrics.jsonl from byte `after` on."""
        run, latest = self.run, self._latest()
        records, end, start = read_records(run.metrics_log, after)
        phases, age = [self._phase(phase, latest) for phase in PHASES], _age(run)
        running = age is not None and age < _QUIET and not all(phase["finished"] for phase in phases)
        return {
            "records": records,
            "next": end,
            "from": start,
            "phases": phases,
            "running": running,
            "age": age,
            "seconds_left": self._seconds_left(phases, latest) if running and latest else None,
            "log": log_tail(run.log_file),
            "evaluation": evaluation_of(run),
            "checkpoint": run.checkpoints.newest_step(),
            "object": run.asset_file.is_file(),
            "verdicts": _verdicts(run),
        }

    def _latest(self) -> tuple[str, int] | None:
        """Return phase and step of the newest record, and take note of when it was seen."""
        found, now = newest_record(self.run.metrics_log), time.monotonic()
        if found is not None and (not self._seen or self._seen[-1][1:] != found):
            self._seen.append((now, *found))
        while len(self._seen) > 2 and now - self._seen[0][0] > _WINDOW:
            self._seen.popleft()
        return found

    def _phase(self, phase: str, latest: tuple[str, int] | None) -> dict[str, Any]:
        timing = read_timings(self.run.timings_file).get(phase)
        finished = self.run.asset_file.is_file() if phase == PHASES[0] else is_learnt(self.run)
        lengths = stage_lengths(self.run, phase)
        total = sum(lengths.values())
        return {
            "name": phase,
            "stages": lengths,
            "steps": total,
            "step": total if finished else latest[1] if latest and latest[0] == phase else 0,
            "finished": finished,
            "seconds": None if timing is None else timing.seconds,
        }

    def _seconds_left(self, phases: list[dict[str, Any]], latest: tuple[str, int]) -> float | None:
        """Return the time that the phase at hand will take from here, None while its speed is unknown."""
        phase = next(one for one in phases if one["name"] == latest[0])
        seen = [(when, step) for when, name, step in self._seen if name == latest[0]]
        (first, begin), (last, end) = seen[0], seen[-1]
        rate = (end - begin) / (last - first) if last > first else 0.0
        kept = (self.run.checkpoints if latest[0] == PHASES[0] else self.run.model_checkpoints).newest_step()
        if rate <= 0 and kept and phase["seconds"]:
            rate = kept / phase["seconds"]
        return (phase["steps"] - latest[1]) / rate if rate > 0 else None


def read_records(path: Path, after: int) -> tuple[list[dict[str, Any]], int, int]:
    """Return the whole lines of metrics.jsonl from byte `after` on, where they end, and where they were read
    from.

    A file that has become shorter, as after --restart, is read from its start. Damaged lines are left out.
    """
    if not path.is_file():
        return [], 0, 0
    with open(path, "rb") as file:
        size = file.seek(0, 2)
        start = after if 0 <= after <= size else 0
        file.seek(start)
        data = file.read(_CHUNK)
    whole = data[: data.rfind(b"\n") + 1]
    lines = (_record(line) for line in whole.splitlines())
    return [record for record in lines if record is not None], start + len(whole), start


def newest_record(path: Path) -> tuple[str, int] | None:
    """Return phase and step of the last whole line of metrics.jsonl, None without one."""
    for line in reversed(_tail(path).split(b"\n")[:-1]):
        if (record := _record(line)) is not None:
            return record["phase"], record["step"]
    return None


def _record(line: bytes) -> dict[str, Any] | None:
    """Return a line's phase, step, stage and numbers, None where it is damaged."""
    try:
        value = json.loads(line)
    except (ValueError, RecursionError):
        return None
    sound = isinstance(value, dict) and value.get("phase") in PHASES and type(value.get("step")) is int
    return {key: value[key] for key in value if isinstance(value[key], str | int | float)} if sound else None


def stage_lengths(run: RunFolder, phase: str) -> dict[str, int]:
    """Return the steps of each stage of a phase, none while its settings are unknown."""
    section = run.sections().get(phase)
    if not isinstance(section, dict):
        return {}
    settings = {key: value for key, value in section.items() if key not in ("seed", "hdri")}
    try:
        if phase == PHASES[0]:
            made = decompose_stages(DecomposeConfig.from_json(settings))
            return {stage.name: stage.iterations for stage in made}
        return {stage.name: stage.iterations for stage in distill_stages(DistillConfig.from_json(settings))}
    except LightprobeError:
        return {}


def log_tail(path: Path) -> list[str]:
    """Return the last lines of log.txt, tracebacks' lines left out."""
    lines = _tail(path).decode("utf-8", "replace").split("\n")
    return [printable(line) for line in lines if line[:2].isdigit()][-_LINES:]


def _tail(path: Path) -> bytes:
    if not path.is_file():
        return b""
    with open(path, "rb") as file:
        file.seek(max(file.seek(0, 2) - _TAIL, 0))
        return file.read()


def _age(run: RunFolder) -> float | None:
    """Return the seconds since something was recorded, None where nothing was."""
    folders = (run.checkpoints.folder, run.model_checkpoints.folder)
    files = (run.metrics_log, run.log_file, run.timings_file, *folders)
    times = [path.stat().st_mtime for path in files if path.exists()]
    return time.time() - max(times) if times else None


def _verdicts(run: RunFolder) -> list[str]:
    """Return what training says of its object and of the maps to expect, as far as it has come."""
    sentences = []
    for load, place in ((ObjectVerdict.load, run.verdict_file), (LightAccuracy.load, run.model_folder)):
        try:
            found = load(place)
        except InputError as error:
            sentences.append(str(error))
        else:
            sentences += [] if found is None else [found.sentence]
    return sentences


def evaluation_of(run: RunFolder) -> dict[str, Any]:
    """Return the mean scores of a run's evaluation, none before there is one or where it is damaged."""
    if not run.metrics_file.is_file():
        return {}
    try:
        value = read_json(run.metrics_file)
    except InputError:
        return {}
    mean = value.get("mean") if isinstance(value, dict) else None
    scores = mean.items() if isinstance(mean, dict) else ()
    return {key: number for key, number in scores if is_finite_number(number)}
