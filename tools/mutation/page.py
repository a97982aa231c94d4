"""What survived, as a page."""

from collections import Counter
from collections.abc import Sequence

from mutation.plan import Mutant
from mutation.trial import Outcome

Outcomes = Sequence[tuple[Mutant, Outcome]]


def percent(outcomes: Outcomes) -> tuple[int, int]:
    """Return how many mutants were killed, hanging ones among them, and how many there were."""
    return sum(outcome is not Outcome.SURVIVED for _, outcome in outcomes), len(outcomes)


def page(outcomes: Outcomes, total: int, packages: Sequence[str], seed: int) -> str:
    """Return the page in Markdown: shares by package, and all survivors."""
    killed, every = percent(outcomes)
    share = f"{100 * killed / max(every, 1):.1f} %"
    lines = [
        "# Mutation testing",
        "",
        f"Written by `python tools/mutate.py {' '.join(packages)} --count {every} --seed {seed}`:",
        f"{every} of {total} mutants, drawn at random, of which tests killed {killed} ({share}).",
        "",
        "| package | mutants | killed | share |",
        "| --- | ---: | ---: | ---: |",
    ]
    counts = Counter(_package(mutant) for mutant, _ in outcomes)
    dead = Counter(_package(mutant) for mutant, outcome in outcomes if outcome is not Outcome.SURVIVED)
    lines += [
        f"| {name} | {n} | {dead[name]} | {100 * dead[name] / n:.0f} % |"
        for name, n in sorted(counts.items())
    ]
    lines += ["", "## Survivors", "", "Places are those of the drawn version.", ""]
    lines += [
        f"- {mutant.place}: {mutant.change}" for mutant, outcome in outcomes if outcome is Outcome.SURVIVED
    ]
    return "\n".join(lines) + "\n"


def _package(mutant: Mutant) -> str:
    return mutant.module.rsplit(".", 1)[0]
