"""What the page says of a run that may come from anywhere."""

import json

import pytest

from lightprobe.view.sources import evaluation_of
from tests.report.pages import evaluated_run


@pytest.mark.parametrize("mean", [[1], "x", 3, True, None, {"psnr": float("nan")}, {"psnr": 10**400}])
def test_scores_that_are_none_are_left_out(tmp_path, mean):
    run = evaluated_run(tmp_path / "run", {"a": 20.0})
    assert evaluation_of(run)["psnr_masked"] == 20
    run.metrics_file.write_text(json.dumps({"mean": mean}))
    assert evaluation_of(run) == {}
