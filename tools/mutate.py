"""Mutation testing: the meaning of how many places in the sources is held by a test?

    python tools/mutate.py lightprobe.light lightprobe.render lightprobe.evaluation --count 200 --seed 0

A mutant is a module with one small change: a comparison, an operator, a number, a condition or a step left
out (`mutation.changes`). Of all mutants of the packages, `--count` are drawn at random. Each is imported in
place of its module in a process of its own, in which first the module's own tests run, slow ones too, then
the quick ones of all other files of tests that import it. A mutant that fails a test, or takes far longer, is
killed. The survivors are listed: each is a test that is missing, or a change that makes no difference to
anybody.

Processes are forked from one that has imported the large libraries, so a mutant costs seconds. Needs fork:
not Windows.
"""

import argparse
import sys
from pathlib import Path

from mutation.page import page, percent
from mutation.plan import Plan, drawn
from mutation.trial import Outcome, judged

_ROOT = Path(__file__).parents[1]


def main() -> int:
    """Judge mutants of the packages on the command line; 1 when tests fail without any mutation."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("packages", nargs="+", metavar="PACKAGE", help="as they are imported")
    parser.add_argument("--count", type=int, default=200, help="mutants to draw, all where there are fewer")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--page", type=Path, help="file for the survivors, as Markdown")
    arguments = parser.parse_args()
    plan, outcomes = Plan(_ROOT), []
    chosen, total = drawn(plan, arguments.packages, arguments.count, arguments.seed)
    sys.path.insert(0, str(_ROOT))
    for number, mutant in enumerate(chosen, start=1):
        outcome = judged(plan, mutant)
        if outcome is Outcome.BROKEN:
            print(f"The tests of {mutant.module} fail without any mutation.", file=sys.stderr)
            return 1
        outcomes.append((mutant, outcome))
        print(f"{number}/{len(chosen)} {outcome.value} {mutant.place}: {mutant.change}", flush=True)
    killed, every = percent(outcomes)
    print(f"{killed} of {every} mutants killed ({100 * killed / max(every, 1):.1f} %), drawn from {total}")
    if arguments.page is not None:
        arguments.page.write_text(page(outcomes, total, arguments.packages, arguments.seed))
    return 0


if __name__ == "__main__":
    sys.exit(main())
