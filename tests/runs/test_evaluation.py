"""Where the numbers of an evaluation go and how its command reads; `tests.cli` evaluates a trained run."""

from types import SimpleNamespace

import pytest

from lightprobe.core.errors import InputError, LightprobeWarning
from lightprobe.core.files import write_json
from lightprobe.core.run import RunFolder
from lightprobe.evaluation import Protocols
from lightprobe.prediction import Method
from lightprobe.runs import evaluation
from lightprobe.runs.evaluation import EvaluationOptions, default_first, destination, eval_command

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
    assert eval_command(EvaluationOptions()) == "lightprobe eval RUN"
    protocols = Protocols(unseen=False, slow_photos=2)
    asked = eval_command(EvaluationOptions((OTHER, OWN), protocols, oracle=True, slow=True))
    methods = "--methods constant probe-net+optimize"
    assert asked == f"lightprobe eval RUN {methods} --no-unseen --oracle-asset --slow --slow-photos 2"


def test_a_true_object_that_cannot_be_used_costs_no_score_unless_it_is_asked_for(run, monkeypatch):
    def refuse(*_):
        raise InputError("mesh.obj cannot be read.")

    monkeypatch.setattr(evaluation, "can_be_oracle", lambda scene: True)
    monkeypatch.setattr(evaluation, "oracle_decomposition", refuse)
    with pytest.warns(LightprobeWarning, match=r"true object is not used\. mesh\.obj cannot be read"):
        assert evaluation._true_object(run, SimpleNamespace(), SimpleNamespace(), needed=False) is None
    with pytest.raises(InputError, match="cannot be read"):
        evaluation._true_object(run, SimpleNamespace(), SimpleNamespace(), needed=True)
