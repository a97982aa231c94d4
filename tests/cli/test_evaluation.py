"""Where the numbers of `eval` go and what it prints; `test_commands` runs it on a trained run."""

import dataclasses
import shlex

import pytest

from lightprobe.cli import training
from lightprobe.cli.evaluation import default_first, destination, eval_command, print_tables
from lightprobe.cli.main import main
from lightprobe.core import config, config_distill
from lightprobe.core.files import write_json
from lightprobe.core.run import RunFolder
from lightprobe.evaluation import Evaluation, Protocols
from lightprobe.prediction import Method
from lightprobe.report.headings import LIGHTS, OBJECT
from lightprobe.report.run_info import read_phases, training_commands

OWN, OTHER = Method.PROBE_NET_OPTIMIZE, Method.CONSTANT


@pytest.fixture
def run(tmp_path):
    return RunFolder.create(tmp_path / "run")


def test_the_run_s_default_is_the_first_and_each_method_comes_once():
    assert default_first((OTHER, Method.SOLVE, OWN, OTHER), OWN) == (OWN, OTHER, Method.SOLVE)
    assert default_first((OTHER, Method.SOLVE), OWN) == (OTHER, Method.SOLVE)


def test_numbers_of_the_default_are_replaced_only_by_numbers_of_the_default(run):
    usual = (run.metrics_file, run.report_file)
    assert destination(run, (OTHER,), OWN) == usual  # nothing is there that could be lost
    write_json(run.metrics_file, {"methods": {"solve": {}}})
    assert destination(run, (OTHER,), OWN) == usual
    write_json(run.metrics_file, {"methods": {OWN.value: {}}})
    folder = run.report_file.parent / "comparison"
    assert destination(run, (OTHER,), OWN) == (folder / "metrics.json", folder / "index.html")
    assert destination(run, (OTHER, OWN), OWN) == usual


def test_the_command_of_an_evaluation_says_what_was_asked_for():
    assert eval_command((), Protocols(), oracle=False, slow=False) == "lightprobe eval RUN"
    asked = eval_command((OTHER, OWN), Protocols(unseen=False, slow_photos=2), oracle=True, slow=True)
    methods = "--methods constant probe-net+optimize"
    assert asked == f"lightprobe eval RUN {methods} --no-unseen --oracle-asset --slow --slow-photos 2"


def test_the_command_of_a_training_gives_its_settings_again(run, monkeypatch):
    first = dataclasses.replace(config.standard(), shadows=False, sdf=config.SdfMode.MLP, laplacian=0.25)
    second = dataclasses.replace(config_distill.standard(), pretrained=True, alpha_rule=config_distill.AlphaRule.R2)
    run.record_config("decompose", {"seed": 5, **dataclasses.asdict(first)})
    run.record_config("distill", {"seed": 5, "hdri": None, **dataclasses.asdict(second)})
    given = []
    monkeypatch.setattr(training, "_train", lambda *arguments, **_: given.append(arguments))
    (command,) = training_commands(read_phases(run), run.path)
    assert "--preset standard" in command
    assert main(shlex.split(command)[1:]) == 0
    assert given[0][3] == 5
    assert given[0][5:7] == (first, second)


def test_console_and_report_call_a_score_by_one_name(capsys):
    scores = {"psnr": 30.0, "relit_psnr": 21.25, "relit_psnr_scaled": 25.75, "light_log_rmse": 0.5}
    print_tables(Evaluation(OWN, {"a": {OWN: scores, OTHER: scores}}, {"relight_psnr": 21.906, "chamfer": 0.0123}))
    printed = capsys.readouterr().out
    assert "…" not in printed
    assert max(map(len, printed.splitlines())) <= 80
    table = next(part for part in printed.split("┏") if "25.75" in part)
    cells = [[cell.strip() for cell in line.split(line[0])[1:-1]] for line in table.splitlines() if line[0] in "┃│"]
    rows = [cells.index(row) for row in cells if row[0] == OWN.value]
    names = [" ".join(filter(None, words)) for words in zip(*cells[: rows[0]], strict=True)]
    assert dict(zip(names[1:], cells[rows[0]][1:], strict=True)) == {
        LIGHTS["relit_psnr"].name: "21.25", LIGHTS["relit_psnr_scaled"].name: "25.75",
    }  # fmt: skip
    assert f"{OBJECT['relight_psnr'].name}: 21.91\n" in printed
    assert f"{OBJECT['chamfer'].name}: 0.0123\n" in printed
    assert "relight_psnr" not in printed
