"""Parts of a measurement in processes of their own: one that takes too long or breaks ends alone.

A part writes finished rows, and how far it is, into files of its name as it goes; what a killed one had written stays.
"""

import json
import os
import signal
import subprocess
import time
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from lightprobe.core.files import write_json

State = dict[str, list[float]]  # stage -> steps done, steps in all, seconds, steps that took them
_LAST_WORDS = 400  # characters of what a failed part printed last
_BUNCH = 0.02  # seconds: steps told within them were told together, their losses having been read at once
_PATIENCE = 10.0  # seconds that a part has to end when it is told to


@dataclass(frozen=True)
class Setting:
    """What every part is told."""

    folder: Path  # for its files
    device: str  # cpu, cuda or cuda:N
    brief: bool  # small cases, to see that all of it works
    seed: int = 0

    def rows_file(self, part: str) -> Path:
        """Return where a part writes its rows."""
        return self.folder / f"{part}.rows"

    def state_file(self, part: str) -> Path:
        """Return where a part writes how far it is."""
        return self.folder / f"{part}.json"

    def write(self, part: str, rows: Iterable[str]) -> None:
        """Add finished rows of a part."""
        with self.rows_file(part).open("a", encoding="utf-8") as file:
            file.writelines(f"{row}\n" for row in rows)

    def words(self) -> list[str]:
        """Return the command line that `of_words` reads."""
        return [str(self.folder), self.device, "brief" if self.brief else "full", str(self.seed)]

    @staticmethod
    def of_words(words: list[str]) -> "Setting":
        """Return the setting of a command line."""
        folder, device, size, seed = words
        return Setting(Path(folder), device, size == "brief", int(seed))


@dataclass(frozen=True)
class Outcome:
    """What became of a part."""

    rows: list[str]
    state: State
    seconds: float
    failure: str | None = None


def run_part(command: list[str], part: str, setting: Setting, limit: float) -> Outcome:
    """Run the command of a part, for at most `limit` seconds, and return what it left."""
    begin = time.perf_counter()
    printed = setting.folder / f"{part}.log"
    with printed.open("w", encoding="utf-8") as log:
        child = subprocess.Popen(command, stdout=log, stderr=subprocess.STDOUT, start_new_session=True)
        try:
            code = child.wait(max(limit, 1.0))
            lines = printed.read_text(encoding="utf-8", errors="replace").split("\n")
            words = [line.strip() for line in lines if line.strip()] or [f"ended with {code} without a word"]
            failure = words[-1][-_LAST_WORDS:] if code else None
        except subprocess.TimeoutExpired:
            failure = f"stopped after {limit:.0f} s, the time it was given"
        finally:
            _end(child)
    rows, state = setting.rows_file(part), setting.state_file(part)
    return Outcome(
        rows.read_text(encoding="utf-8").splitlines() if rows.is_file() else [],
        json.loads(state.read_text(encoding="utf-8")) if state.is_file() else {},
        time.perf_counter() - begin,
        failure,
    )


def _end(child: subprocess.Popen) -> None:
    """End a child and whatever it has started."""
    for number in (signal.SIGTERM, signal.SIGKILL):
        try:
            os.killpg(child.pid, number)
            child.wait(_PATIENCE)
        except ProcessLookupError:
            return
        except subprocess.TimeoutExpired:
            continue


class Pace:
    """How far a training is and what its steps take, written down at most once a second."""

    def __init__(self, part: str, setting: Setting):
        self._file = setting.state_file(part)
        self._stages: State = {}
        self._since: dict[
            str, tuple[float, int]
        ] = {}  # stage -> when its first bunch of steps was told, and its end
        self._written = 0.0

    def step(self, stage: str, done: int, steps: int) -> None:
        """Note that a step of a stage is done; the first, or the first bunch, only starts the stage's time."""
        now = time.perf_counter()
        begin, first = self._since.get(stage, (now, done))
        if now - begin < _BUNCH:
            first = done
        self._since[stage] = begin, first
        self._stages[stage] = [done, steps, now - begin, done - first]
        if now - self._written > 1 or done == steps:
            write_json(self._file, self._stages)
            self._written = now


def pace_rows(state: State) -> list[str]:
    """Return the table of stages: how far, how long for a step, and how long at that pace for all of them."""
    if not state:
        return []
    rows = ["| stage | steps | of | ms a step | all of them, s |", "| --- | ---: | ---: | ---: | ---: |"]
    for stage, (done, steps, seconds, timed) in state.items():
        each = seconds / max(timed, 1)
        rows.append(f"| {stage} | {done:.0f} | {steps:.0f} | {1000 * each:.1f} | {each * steps:.0f} |")
    return rows
