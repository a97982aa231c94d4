"""Read damaged and hostile files with every reader, for as long as is given, and write down what came of it.

    python -m tests.fuzz --minutes 60 --seed 0 [--page benchmarks/FUZZ.md] [--only GLB PNG]

Readers take turns, a few dozen files each. A file must give a result or one sentence of ours within 10 s and
2 GiB. Anything else is a finding: its file is left in build/fuzz/findings with as few edits as show it, and
the run ends with 1. Needs Linux, and a checkout: the valid files are made by the modules of the tests.
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
from collections.abc import Iterator, Sequence
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
    refused: int = 0
    memory: int = 0  # bytes, the most
    slowest: float = 0.0  # seconds
    findings: Counter[str] = field(default_factory=Counter)

    def add(self, outcome: Outcome, seconds: float) -> None:
        """Count one file."""
        self.files += 1
        self.refused += outcome.refused and not outcome.finding
        self.memory, self.slowest = max(self.memory, outcome.memory), max(self.slowest, seconds)
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
            seed, files = (self.seed * 1_000_003 + number) * 101 + place, self._files[target.name]
            for index, edits in enumerate(_edits(target, batch, seed)):
                if time.monotonic() > until:
                    return
                self._try(target, files[(number + index) % len(files)], edits, mend=index % 2 == 1)

    def close(self) -> None:
        """End the process that reads."""
        self._worker.close()

    def _try(self, target: Target, file: str, edits: list, *, mend: bool) -> None:
        def data(chosen: list) -> bytes:
            made = spoilt(self._valid(target, file), chosen, target.form)
            return target.mend(made) if mend and target.mend is not None else made

        def same(chosen: list) -> bool:
            return self._worker.read(target.name, file, data(chosen)).finding == outcome.finding

        began = time.monotonic()
        outcome = self._worker.read(target.name, file, data(edits))
        tally = self.tallies[target.name]
        tally.add(outcome, time.monotonic() - began)
        if outcome.finding and tally.findings[outcome.finding] == 1:
            fewer = fewest(edits, same)
            words = f"{outcome.finding}\n\n{target.name}, {file}\n{fewer!r}\n\n{outcome.detail}\n"
            name = f"{hashlib.sha256(outcome.finding.encode()).hexdigest()[:10]}-{Path(file).name}"
            self._findings.mkdir(parents=True, exist_ok=True)
            (self._findings / name).write_bytes(data(fewer))
            (self._findings / f"{name}.txt").write_text(words)
            print(f"{outcome.finding}: {self._findings / name}", flush=True)

    def _valid(self, target: Target, file: str) -> bytes:
        return (self._corpus / target.make.__name__ / file).read_bytes()


def _edits(target: Target, batch: int, seed: int) -> Iterator[list]:
    if target.form is not None:
        yield from drawn(value_edits(), batch // 2, seed)
        batch //= 2
    yield from drawn(byte_edits(), batch, seed)


def page(attack: Attack, minutes: float) -> str:
    """Return the record of an attack as Markdown."""
    words = ["git", "describe", "--always", "--dirty", "--exclude", "*"]
    commit = subprocess.run(words, cwd=ROOT, capture_output=True, text=True).stdout.strip() or "unknown"
    tallies = attack.tallies.items()
    kinds = [f"- {kind} ({n} files)" for _, tally in tallies for kind, n in tally.findings.items()]
    command = f"python -m tests.fuzz --minutes {minutes:g} --seed {attack.seed} --page benchmarks/FUZZ.md"
    lines = [
        "# Damaged and hostile files",
        "",
        f"Written by `{command}`, commit {commit}, {platform.machine()}, {platform.system()}, Python "
        f"{platform.python_version()}, {os.cpu_count()} cores of which one is used.",
        "",
        f"{sum(tally.files for _, tally in tallies)} files in {minutes:g} minutes, {len(kinds)} findings. A file must "
        f"be read, or refused in one sentence, within {SECONDS:g} s and {MEMORY / 2**30:g} GiB; all else is a "
        "finding: another error, a crash, a hang, more memory. Memory is that of the whole process, libraries "
        "included.",
        "",
        "| reader | files | read | refused | findings | slowest, s | most memory, GiB |",
        "|---|--:|--:|--:|--:|--:|--:|",
    ]
    for name, tally in tallies:
        read = tally.files - tally.refused - tally.findings.total()
        counts = f"{tally.files} | {read} | {tally.refused} | {len(tally.findings)}"
        lines.append(f"| {name} | {counts} | {tally.slowest:.1f} | {tally.memory / 2**30:.2f} |")
    return "\n".join([*lines, "", *(["Findings:", "", *kinds, ""] if kinds else [])])


def main(words: Sequence[str] | None = None) -> int:
    """Read the command line, attack, and return the exit status."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    names = [target.name for target in TARGETS]
    parser.add_argument("--minutes", type=float, default=60.0)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--folder", type=Path, default=ROOT / "build" / "fuzz")
    parser.add_argument("--page", type=Path, help="where the record is written as Markdown")
    parser.add_argument(
        "--only", nargs="+", default=names, choices=names, metavar="READER", help=", ".join(names)
    )
    given = parser.parse_args(words)
    attack = Attack(given.folder, given.seed, [target for target in TARGETS if target.name in given.only])
    try:
        if wrong := attack.check_corpus():
            print("\n".join(["The valid files are not read:", *wrong]))
            return 2
        until, number = time.monotonic() + 60 * given.minutes, 0
        while time.monotonic() < until:
            attack.turn(number, until=until)
            number += 1
    finally:
        attack.close()
    text = page(attack, given.minutes)
    if given.page is not None:
        given.page.write_text(text)
    print(text)
    return 1 if any(tally.findings for tally in attack.tallies.values()) else 0


if __name__ == "__main__":
    sys.exit(main())
