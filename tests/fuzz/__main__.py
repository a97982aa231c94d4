"""Read damaged and hostile files with every reader, for as long as is given, and write down what came of it.

    python -m tests.fuzz --minutes 60 --seed 0 [--page benchmarks/FUZZ.md] [--only GLB PNG]
    python -m tests.fuzz --again

Readers take turns, a few dozen files each. A file must give a result or one sentence of ours within 10 s and
2 GiB. Anything else is a finding: its file is left in build/fuzz/findings with as few edits as show it, and
the run ends with
1. Needs Linux, and a checkout: the valid files are made by the modules of the tests.
"""

import argparse
import hashlib
import os
import platform
import shutil
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from tests.fuzz.edits import byte_edits, drawn, fewest, spoilt, value_edits
from tests.fuzz.targets import TARGETS, Target
from tests.fuzz.worker import MEMORY, SECONDS, Outcome, Worker

ROOT = Path(__file__).parents[2]
BATCH = 40  # files of a reader's turn


@dataclass
class Tally:
    """What came of the files of one reader."""

    files: int = 0
    read: int = 0
    refused: int = 0
    memory: int = 0  # bytes, the most
    slowest: float = 0.0  # seconds
    findings: Counter[str] = field(default_factory=Counter)

    def add(self, outcome: Outcome, seconds: float) -> None:
        """Count one file."""
        self.files += 1
        self.refused += outcome.refused
        self.read += not outcome.refused and not outcome.finding
        self.memory = max(self.memory, outcome.memory)
        self.slowest = max(self.slowest, seconds)
        if outcome.finding:
            self.findings[outcome.finding] += 1


class Attack:
    """Spoilt files for every reader, in turns, and what was found."""

    def __init__(self, folder: Path, seed: int, targets: Sequence[Target] = TARGETS):
        """Make the valid files below `folder`."""
        self.targets, self.seed = targets, seed
        self.tallies = {target.name: Tally() for target in targets}
        self._corpus, self._findings = folder / "corpus", folder / "findings"
        shutil.rmtree(self._corpus, ignore_errors=True)
        self._files = {target.name: target.write(self._corpus) for target in targets}
        self._worker = Worker(self._corpus, only=frozenset(self.tallies))

    def check_corpus(self) -> list[str]:
        """Return what is wrong with the valid files: a reader is attacked only beyond what it reads."""
        wrong = []
        for target in self.targets:
            for file in self._files[target.name]:
                outcome = self._worker.read(target.name, file, self._valid(target, file))
                if outcome.refused or outcome.finding:
                    wrong.append(f"{target.name}, {file}: {outcome.finding or 'refused'} {outcome.detail}")
        return wrong

    def turn(self, number: int, batch: int = BATCH, until: float = float("inf")) -> None:
        """Give each reader about `batch` spoilt files, the same for the same seed and number."""
        for place, target in enumerate(self.targets):
            seed = (self.seed * 1_000_003 + number) * 101 + place
            for index, edits in enumerate(self._edits(target, batch, seed)):
                if time.monotonic() > until:
                    return
                files = self._files[target.name]
                self._try(target, files[(number + index) % len(files)], edits, mend=index % 2 == 1)

    def again(self) -> list[str]:
        """Read all findings that are kept once more, and return what is still wrong."""
        wrong = []
        for words in sorted(self._findings.glob("*.txt")):
            named = words.read_text().splitlines()[2]
            target = next((target for target in self.targets if named.startswith(f"{target.name}, ")), None)
            if target is None:  # not asked for
                continue
            data = words.with_suffix("").read_bytes()
            outcome = self._worker.read(target.name, named.removeprefix(f"{target.name}, "), data)
            wrong += [f"{words.with_suffix('')}: {outcome.finding}"] if outcome.finding else []
        return wrong

    def close(self) -> None:
        """End the process that reads."""
        self._worker.close()

    def _edits(self, target: Target, batch: int, seed: int) -> Iterator[list]:
        if target.form is not None:
            yield from drawn(value_edits(), batch // 2, seed)
            batch //= 2
        yield from drawn(byte_edits(), batch, seed)

    def _try(self, target: Target, file: str, edits: list, *, mend: bool) -> None:
        def data(chosen: list) -> bytes:
            made = spoilt(self._valid(target, file), chosen, target.form)
            return target.mend(made) if mend and target.mend is not None else made

        began = time.monotonic()
        outcome = self._worker.read(target.name, file, data(edits))
        tally = self.tallies[target.name]
        tally.add(outcome, time.monotonic() - began)
        if outcome.finding and tally.findings[outcome.finding] == 1:
            fewer = fewest(edits, lambda chosen: self._same(target, file, data(chosen), outcome))
            self._keep(target, file, data(fewer), fewer, outcome)

    def _same(self, target: Target, file: str, data: bytes, outcome: Outcome) -> bool:
        return self._worker.read(target.name, file, data).finding == outcome.finding

    def _keep(self, target: Target, file: str, data: bytes, edits: list, outcome: Outcome) -> None:
        self._findings.mkdir(parents=True, exist_ok=True)
        name = f"{hashlib.sha256(outcome.finding.encode()).hexdigest()[:10]}-{Path(file).name}"
        (self._findings / name).write_bytes(data)
        words = f"{outcome.finding}\n\n{target.name}, {file}\n{edits!r}\n\n{outcome.detail}\n"
        (self._findings / f"{name}.txt").write_text(words)
        print(f"{outcome.finding}: {self._findings / name}", flush=True)

    def _valid(self, target: Target, file: str) -> bytes:
        return (self._corpus / target.make.__name__ / file).read_bytes()


def page(attack: Attack, minutes: float, commit: str) -> str:
    """Return the record of an attack as Markdown."""
    total = sum(tally.files for tally in attack.tallies.values())
    found = sum(len(tally.findings) for tally in attack.tallies.values())
    command = f"python -m tests.fuzz --minutes {minutes:g} --seed {attack.seed} --page benchmarks/FUZZ.md"
    lines = [
        "# Damaged and hostile files",
        "",
        f"Written by `{command}`, commit {commit}, {platform.machine()}, {platform.system()}, Python "
        f"{platform.python_version()}, {os.cpu_count()} cores of which one is used.",
        "",
        f"{total} files in {minutes:g} minutes, {found} findings. A file must be read, or refused in one sentence, "
        f"within {SECONDS:g} s and {MEMORY / 2**30:g} GiB; all else is a finding: another error, a crash, a hang, more "
        "memory. Memory is that of the whole process, libraries included.",
        "",
        "| reader | files | read | refused | findings | slowest, s | most memory, GiB |",
        "|---|--:|--:|--:|--:|--:|--:|",
    ]
    for name, tally in attack.tallies.items():
        counts = f"{tally.files} | {tally.read} | {tally.refused} | {len(tally.findings)}"
        lines.append(f"| {name} | {counts} | {tally.slowest:.1f} | {tally.memory / 2**30:.2f} |")
    kinds = [
        f"- {finding} ({count} files)"
        for t in attack.tallies.values()
        for finding, count in t.findings.items()
    ]
    return "\n".join([*lines, "", *(["Findings:", "", *kinds, ""] if kinds else [])])


def _commit() -> str:
    words = ["git", "describe", "--always", "--dirty", "--exclude", "*"]
    return subprocess.run(words, cwd=ROOT, capture_output=True, text=True).stdout.strip() or "unknown"


def main(words: Sequence[str] | None = None, say: Callable[[str], None] = print) -> int:
    """Read the command line, attack, and return the exit status."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--minutes", type=float, default=60.0)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--folder", type=Path, default=ROOT / "build" / "fuzz")
    parser.add_argument("--page", type=Path, help="where the record is written as Markdown")
    parser.add_argument("--again", action="store_true", help="only read the findings that are kept once more")
    parser.add_argument(
        "--only", nargs="+", metavar="READER", help=f"some of: {', '.join(t.name for t in TARGETS)}"
    )
    given = parser.parse_args(words)
    commit = _commit()
    attack = Attack(
        given.folder, given.seed, [t for t in TARGETS if given.only is None or t.name in given.only]
    )
    try:
        if given.again:
            say("\n".join(wrong := attack.again()) or "Nothing that was found is wrong any more.")
            return 1 if wrong else 0
        if wrong := attack.check_corpus():
            say("\n".join(["The valid files are not read:", *wrong]))
            return 2
        until, number = time.monotonic() + 60 * given.minutes, 0
        while time.monotonic() < until:
            attack.turn(number, until=until)
            number += 1
    finally:
        attack.close()
    text = page(attack, given.minutes, commit)
    if given.page is not None:
        given.page.write_text(text)
    say(text)
    return 1 if any(tally.findings for tally in attack.tallies.values()) else 0


if __name__ == "__main__":
    sys.exit(main())
