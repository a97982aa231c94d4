"""eval: the numbers, the predictions and the report of a run."""

import sys
from pathlib import Path
from typing import Annotated

from rich.console import Console
from rich.table import Column, Table
from tyro.conf import FlagCreatePairsOff

from lightprobe.cli.answer import is_for_programs, keep, say
from lightprobe.cli.options import Device, MovedScene, Prediction, RunArg, option
from lightprobe.cli.progress import Meter
from lightprobe.core.config.prediction import UNCHANGED, Method
from lightprobe.evaluation import Evaluation, Protocols
from lightprobe.report.summary import summary_lines, summary_tables
from lightprobe.runs.evaluation import EvaluatedRun, EvaluationOptions, evaluate_run

_METHODS = (
    f"Methods to compare, of {', '.join(Method.offered())}. Where the run has numbers of its default method, those of "
    "methods without it go to RUN/report/comparison and replace nothing."
)
_NumbersArg = Annotated[
    Path | None, option(aliases=["-o"], metavar="metrics.json", help="Numbers; also in the run.")
]
_OracleArg = Annotated[
    FlagCreatePairsOff[bool],
    option(help="Put the scene's true object in place of the reconstructed one; results go to RUN/oracle."),
]


def eval(  # the name of the command
    run: RunArg,
    *,
    methods: Annotated[tuple[Method, ...], option(metavar="METHOD ...", help=_METHODS)] = (),
    output: _NumbersArg = None,
    scene: MovedScene = None,
    unseen: Annotated[
        bool, option(help="Also predict from half of the object and score on the other half.")
    ] = True,
    oracle_asset: _OracleArg = False,
    slow: Annotated[bool, option(help="Also score `optimize`, which takes 15 s to minutes a photo.")] = False,
    slow_photos: Annotated[
        int, option(help="Test photos that methods slower than 20 s a photo are scored on.")
    ] = 4,
    settings: Prediction = UNCHANGED,
    device: Device = "auto",
) -> None:
    """Score the predicted light on the test photos and write metrics.json and report/index.html.

    Examples:
      lightprobe eval runs/cup
      lightprobe eval runs/cup --methods probe-mlp constant -o numbers.json
      lightprobe eval runs/chair --oracle-asset
    """
    protocols = Protocols(unseen=unseen, slow_photos=slow_photos)
    asked = EvaluationOptions(methods, protocols, oracle_asset, slow, settings)
    with Meter() as meter:
        found = evaluate_run(
            run, asked, scene_folder=scene, output=output, device=device, on_progress=meter.update
        )
    show_evaluation(found)


def show_evaluation(found: EvaluatedRun) -> None:
    """Print what an evaluation found and where; photos not scored or doubtful go to standard error."""
    result = found.evaluation
    for photo, why in result.skipped.items():
        print(f"lightprobe: warning: test photo {photo} is not scored. {why}", file=sys.stderr)
    for photo, verdict in result.verdicts.items():
        for sentence in verdict.sentences:
            print(f"lightprobe: warning: test photo {photo} is doubtful. {sentence}", file=sys.stderr)
    say(f"Report: {found.page}", report=found.page, numbers=found.numbers)
    if found.numbers != found.usual_numbers:
        kept = f"{found.usual_numbers} and its report keep those of {found.default.value}"
        say(f"Numbers: {found.numbers} ({kept})")
    keep(**result.to_json())
    if not is_for_programs():
        print_tables(result)


def print_tables(evaluation: Evaluation) -> None:
    """Print the means of every method, the scores of the asset and the check of the confidence."""
    for summary in summary_tables(evaluation.to_json()):
        method = Column("method", no_wrap=True)
        table = Table(method, *summary.columns, title=summary.title, title_justify="left", title_style="")
        for name, cells in summary.rows.items():
            table.add_row(name, *cells)
        Console().print(table)
    print("\n".join(summary_lines(evaluation)))
