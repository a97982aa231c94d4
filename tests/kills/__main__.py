"""Disturb commands at many moments: the same command must then end with the bits of an undisturbed one.

    python -m tests.kills --moments 50 --seed 0 [--commands predict export] [--page benchmarks/KILLS.md]

Kills come at changes of the file system and after random times, half and half; `--moments` of them over all
commands. A fifth as many times, once at least, the disk is full from a change on, or files end at a size.
Once each the folder is read-only, and two processes run the same command at once. After each the same command
is run undisturbed. Needs Linux and one thread. Ends with 1 when anything differs.
"""

import argparse
import random
import sys
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import chain
from pathlib import Path
from typing import Any

from tests.kills.commands import COMMANDS, Command, contents, lay_out, leftovers, write_inputs
from tests.kills.program import Ended, Fault, Moment, in_child, start

_RESOURCE = 4  # exit status of a `ResourceError`


@dataclass(frozen=True)
class Result:
    """What came of one moment; `fault` is empty where all was well."""

    command: str
    moment: str
    kind: str
    fault: str = ""


class Bench:
    """A folder in which commands run, always under the same paths, and what each leaves undisturbed."""

    def __init__(self, folder: Path, seed: int, commands: Sequence[Command]):
        """Write the inputs."""
        self._bench, self._work, self._random = folder / "bench", folder / "work", random.Random(seed)
        self._whole: dict[str, dict[str, Any]] = {}
        self._undisturbed: dict[str, Ended] = {}
        in_child(lambda: write_inputs(self._bench, commands))

    def undisturbed(self, command: Command) -> Ended:
        """Run a command without any fault, once, and keep what it leaves."""
        if command.name not in self._whole:
            for _ in range(2):  # the first one compiles
                lay_out(command, self._bench, self._work)
                ended = start(command.words(self._work), self._work, Moment())()
                if ended.code != 0:
                    raise RuntimeError(f"{command.name} fails undisturbed: {ended.said[-2000:]}")
            self._undisturbed[command.name] = ended
            self._whole[command.name] = contents(self._work / command.output)
        return self._undisturbed[command.name]

    def moments(self, command: Command, kills: int, full: int) -> Iterator[Moment]:
        """Yield the moments at which a command is disturbed."""
        whole, dice = self.undisturbed(command), self._random
        for index in range(kills):
            if index % 2 == 0 and whole.changes > 0:
                yield Moment(Fault.KILL, change=dice.randint(1, whole.changes))
            else:
                yield Moment(Fault.KILL, seconds=dice.uniform(0, whole.seconds))
        sizes = sorted(len(data) for data in self._whole[command.name].values() if isinstance(data, bytes))
        for index in range(full):
            if index % 2 == 0:
                yield Moment(Fault.FULL, change=dice.randint(1, whole.changes))
            else:
                yield Moment(Fault.LIMIT, size=max(1, int(dice.choice(sizes) * dice.random())))
        yield Moment(Fault.READ_ONLY, change=1)

    def disturbed(self, command: Command, moment: Moment) -> Result:
        """Disturb a command, run it again, and return what came of it."""
        lay_out(command, self._bench, self._work)
        ended = start(command.words(self._work), self._work, moment)()
        wrong = _wrongly_ended(ended, moment)
        complete = contents(self._work / command.output) == self._whole[command.name]
        if not wrong and not (
            complete and command.name == "export"
        ):  # it refuses a folder that it has filled
            wrong = self._again(command)
        return Result(command.name, str(moment), moment.fault.value, wrong)

    def together(self, command: Command) -> Result:
        """Run a command twice at once: both end, with 0 or one sentence, and leave what one leaves."""
        lay_out(command, self._bench, self._work)
        both = [start(command.words(self._work), self._work, Moment()) for _ in range(2)]
        ends = [wait() for wait in both]
        wrong = "" if any(ended.code == 0 for ended in ends) else "none of two got through"
        for ended in ends:
            wrong = wrong or ("" if ended.code == 0 else _no_sentence(ended))
        return Result(command.name, "two at once", "two at once", wrong or self._different(command))

    def _again(self, command: Command) -> str:
        ended = start(command.words(self._work), self._work, Moment())()
        if ended.code != 0:
            return f"the second run ends with {ended.code}: {ended.said[-300:]}"
        return self._different(command)

    def _different(self, command: Command) -> str:
        ours, whole = contents(self._work / command.output), self._whole[command.name]
        names = sorted({*ours} ^ {*whole}) or [name for name in whole if ours[name] != whole[name]]
        if names:
            return f"not the bits of an undisturbed run: {', '.join(names[:5])}"
        left = leftovers(self._work)
        return f"left over: {', '.join(left)}" if left else ""


def _wrongly_ended(ended: Ended, moment: Moment) -> str:
    """Return why the way a command ended is wrong for what happened to it, or nothing."""
    if moment.fault is Fault.KILL:
        return "" if ended.code in (-9, 0) else f"ended with {ended.code}: {ended.said[-300:]}"
    if ended.code == 0:  # nothing was written after that moment, or nothing as large
        return ""
    return _no_sentence(ended) if ended.code == _RESOURCE else f"ended with {ended.code}: {ended.said[-300:]}"


def _no_sentence(ended: Ended) -> str:
    said = [line for line in ended.said.splitlines() if line.startswith("lightprobe: ")]
    lines = [line for line in said if "warning" not in line]
    sound = len(lines) == 1 and lines[0].endswith(".") and "Traceback" not in ended.said
    return "" if sound else f"no sentence: {ended.said[-300:]}"


def page(results: Sequence[Result], command: str) -> str:
    """Return the record as Markdown."""
    kinds = list(dict.fromkeys(result.kind for result in results))
    lines = [
        f"# Killed, and out of disk\n\nWritten by `{command}`. Each time the command was disturbed at a random moment "
        "and run once more: the cells say how often it then left the bits of an undisturbed run and nothing "
        f"unfinished, of how many times.\n\n| command | {' | '.join(kinds)} |\n|---|{'--:|' * len(kinds)}"
    ]
    for name in dict.fromkeys(result.command for result in results):
        cells = []
        for kind in kinds:
            found = [result for result in results if result.command == name and result.kind == kind]
            cells.append(f"{sum(not result.fault for result in found)} of {len(found)}")
        lines.append(f"| {name} | {' | '.join(cells)} |")
    wrong = [f"- {result.command}, {result.moment}: {result.fault}" for result in results if result.fault]
    return "\n".join([*lines, "", *(["Not as it must be:", "", *wrong, ""] if wrong else [])])


def main(words: Sequence[str] | None = None) -> int:
    """Read the command line, disturb, and return the exit status."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--moments", type=int, default=50, help="kills over all commands")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--commands", nargs="+", choices=[c.name for c in COMMANDS], metavar="COMMAND")
    parser.add_argument("--page", type=Path, help="where the record is written as Markdown")
    given = parser.parse_args(words)
    chosen = [command for command in COMMANDS if given.commands is None or command.name in given.commands]
    results: list[Result] = []
    with tempfile.TemporaryDirectory() as folder:
        bench = Bench(Path(folder), given.seed, chosen)
        for place, command in enumerate(chosen):
            kills, full = (_share(n, place, len(chosen)) for n in (given.moments, max(1, given.moments // 5)))
            disturbed = (bench.disturbed(command, moment) for moment in bench.moments(command, kills, full))
            for result in chain(disturbed, map(bench.together, [command])):
                results.append(result)
                print(f"{result.command}, {result.moment}: {result.fault or 'well'}", flush=True)
    line = f"python -m tests.kills --moments {given.moments} --seed {given.seed}"
    line += f" --commands {' '.join(given.commands)}" if given.commands else ""
    text = page(results, line)
    if given.page is not None:
        given.page.write_text(text)
    print(text)
    return 1 if any(result.fault for result in results) else 0


def _share(total: int, place: int, count: int) -> int:
    return total // count + (place < total % count)


if __name__ == "__main__":
    sys.exit(main())
