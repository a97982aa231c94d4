"""What the training of a run's phases took: RUN/timings.json, one entry for each phase.

    {"decompose": {"seconds": 812.4, "memory": 1.15, "finished": true}, "distill": ...}

seconds: wall-clock time of the work that the result rests on, over all calls of the phase: each one counts up
to its last checkpoint, the last one to the end, files written. What an interrupted call did after its last
checkpoint is done again and so left out. memory: the most that any of these calls held as a process, GiB;
absent where the system does not count it. An entry that is not finished holds the sums so far.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from lightprobe.core.errors import InputError
from lightprobe.core.files import read_json, write_json

_MOST = 1e9  # seconds, thirty years: what is more was damaged


@dataclass(frozen=True)
class PhaseTiming:
    """What a phase took."""

    seconds: float = 0.0
    memory: float | None = None  # GiB
    finished: bool = False


def read_timings(path: Path) -> dict[str, PhaseTiming]:
    """Return the timings by phase; none where there is no such file.

    Entries that are damaged count as none: no result depends on them, and no training may end for their sake.
    """
    try:
        stored = read_json(path)
    except InputError:
        return {}
    entries = stored.items() if isinstance(stored, dict) else ()
    return {phase: timing for phase, entry in entries if (timing := _timing(entry)) is not None}


def write_timing(path: Path, phase: str, timing: PhaseTiming) -> None:
    """Put a phase's timing in the place of an earlier one."""
    _write(path, {**read_timings(path), phase: timing})


def forget_timing(path: Path, phase: str) -> None:
    """Remove a phase's timing, if there is one."""
    timings = read_timings(path)
    if timings.pop(phase, None) is not None:
        _write(path, timings)


def _write(path: Path, timings: dict[str, PhaseTiming]) -> None:
    write_json(path, {phase: _entry(timing) for phase, timing in timings.items()})


def _entry(timing: PhaseTiming) -> dict[str, Any]:
    memory = {} if timing.memory is None else {"memory": round(timing.memory, 3)}
    return {"seconds": round(timing.seconds, 3), **memory, "finished": timing.finished}


def _timing(entry: Any) -> PhaseTiming | None:
    """Return the timing of a JSON value, or None where it is none."""

    def amount(value: Any) -> float | None:
        usable = isinstance(value, int | float) and not isinstance(value, bool) and 0 <= value <= _MOST
        return float(value) if usable else None

    entry = entry if isinstance(entry, dict) else {}
    seconds = amount(entry.get("seconds"))
    finished = entry.get("finished") is True
    return None if seconds is None else PhaseTiming(seconds, amount(entry.get("memory")), finished)
