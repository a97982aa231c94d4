"""What `eval` writes and prints."""

import json
import re
from dataclasses import replace
from datetime import datetime
from importlib.metadata import version
from urllib.parse import unquote

import numpy as np
import pytest

from lightprobe.cli.evaluation import print_tables
from lightprobe.evaluation import Evaluation
from lightprobe.imaging import read_hdr
from lightprobe.prediction import Method, Predictor
from lightprobe.report.headings import LIGHTS, OBJECT
from lightprobe.scene import load_photo
from tests.cli.commands import succeed

OWN, OTHER = Method.PROBE_NET_OPTIMIZE, Method.CONSTANT


def test_console_and_report_call_a_score_by_one_name(capsys):
    scores = {"psnr": 30.0, "relit_psnr": 21.25, "relit_psnr_scaled": 25.75, "light_log_rmse": 0.5}
    print_tables(
        Evaluation(OWN, {"a": {OWN: scores, OTHER: scores}}, {"relight_psnr": 21.906, "chamfer": 0.0123})
    )
    printed = capsys.readouterr().out
    assert "…" not in printed
    assert max(map(len, printed.splitlines())) <= 80
    table = next(part for part in printed.split("┏") if "25.75" in part)
    cells = [
        [cell.strip() for cell in line.split(line[0])[1:-1]] for line in table.splitlines() if line[0] in "┃│"
    ]
    rows = [cells.index(row) for row in cells if row[0] == OWN.value]
    names = [" ".join(filter(None, words)) for words in zip(*cells[: rows[0]], strict=True)]
    assert dict(zip(names[1:], cells[rows[0]][1:], strict=True)) == {
        LIGHTS["relit_psnr"].name: "21.25",
        LIGHTS["relit_psnr_scaled"].name: "25.75",
    }
    assert f"{OBJECT['relight_psnr'].name}: 21.91\n" in printed
    assert f"{OBJECT['chamfer'].name}: 0.0123\n" in printed
    assert "relight_psnr" not in printed


@pytest.mark.slow
def test_eval_writes_numbers_predictions_and_a_self_contained_report(trained, tmp_path, capsys):
    _, run = trained
    succeed("eval", run.path, "-o", tmp_path / "numbers.json")
    metrics = json.loads(run.metrics_file.read_text())
    assert metrics == json.loads((tmp_path / "numbers.json").read_text())
    assert {"psnr", "ssim", "psnr_masked", "ssim_masked", "seconds", "psnr_unseen"} <= metrics["mean"].keys()
    assert metrics["photos"].keys() == {"test_00", "test_01"}
    assert metrics["methods"][metrics["default_method"]].items() <= metrics["mean"].items()
    each = [photo["psnr"] for photo in metrics["photos"].values()]
    assert metrics["mean"]["psnr"] == pytest.approx(np.mean(each))
    for suffix in (".exr", ".png", ".confidence.exr"):
        assert run.prediction_file("test_00", suffix).is_file()
        assert run.prediction_file("test_00", suffix, metrics["default_method"]).is_file()
    page = run.report_file.read_text()
    assert page.count("<section id=") == 2
    assert "http://" not in page
    assert 'src="data:image/' in page
    printed = capsys.readouterr().out
    assert str(run.report_file) in printed
    assert "…" not in printed
    for method, means in metrics["methods"].items():
        assert any(method in line and f"{means['psnr']:.2f}" in line for line in printed.splitlines())


@pytest.mark.slow
def test_eval_of_other_methods_leaves_the_default_s_results_alone(trained, capsys):
    _, run = trained
    succeed("eval", run.path, "--no-unseen", "--methods", "constant", "probe-net+optimize")
    assert json.loads(run.metrics_file.read_text())["default_method"] == "probe-net+optimize"
    stored = [run.prediction_file("test_00", suffix) for suffix in (".exr", ".png", ".confidence.exr")]
    assert stored[0].read_bytes() == run.prediction_file("test_00", ".exr", "probe-net+optimize").read_bytes()
    before = {path: path.read_bytes() for path in (*stored, run.metrics_file, run.report_file)}
    capsys.readouterr()
    succeed("eval", run.path, "--no-unseen", "--methods", "constant")
    assert {path: path.read_bytes() for path in before} == before
    page = run.report_file.parent / "comparison" / "index.html"
    assert list(json.loads((page.parent / "metrics.json").read_text())["methods"]) == ["constant"]
    printed = capsys.readouterr().out
    assert f"Report: {page}" in printed
    assert f"{run.metrics_file} and its report keep those of probe-net+optimize" in printed
    for report, method in ((page, "constant"), (run.report_file, "probe-net%2Boptimize")):
        addresses = re.findall(r'href="([^"#]+)"', report.read_text())
        assert len(addresses) == 2 + 2 * 2  # the object and the numbers, and each photo's map and confidence
        assert all((report.parent / unquote(address)).is_file() for address in addresses)
        assert any(f"predictions/{method}/test_00.exr" in address for address in addresses)


@pytest.mark.slow
def test_the_report_says_how_the_run_was_made(trained):
    _, run = trained
    succeed("eval", run.path, "--no-unseen", "--methods", "probe-net+optimize")
    page = run.report_file.read_text()
    for words in (
        "On 2 simulated photos of the object the directions of the predicted map were off by",
        "Phase I 12 + 8 + 10 steps",
        "Phase II 12 + 6 steps",
        "seed 0",
        f"lightprobe {version('lightprobe')}",
    ):
        assert words in page
    assert datetime.now().strftime("evaluated %Y-%m-") in page
    assert "lightprobe train SCENE -o RUN --preset quick --seed 0 --decompose.pass1-iterations 12" in page
    assert "lightprobe eval RUN --methods probe-net+optimize --no-unseen" in page
    assert str(run.path) not in page


@pytest.mark.slow
def test_the_confidence_is_that_of_the_runs_own_accuracy(trained, tmp_path):
    scene, run = trained
    succeed("eval", run.path, "--no-unseen", "--methods", "constant")
    stored = read_hdr(run.prediction_file("test_00", ".confidence.exr", "constant"))
    photo = load_photo(scene / "test" / "test_00.png", camera=scene / "transforms_test.json")
    predictor = Predictor.load(run.path)
    assert predictor.accuracy is not None
    for scale, same in ((predictor.accuracy.estimated_scale, True), (1.0, False)):
        predictor.accuracy = replace(predictor.accuracy, estimated_scale=scale)
        predictor.predict(*photo, Method.CONSTANT).save_confidence(tmp_path / "confidence.exr")
        assert np.allclose(stored, read_hdr(tmp_path / "confidence.exr"), atol=2e-3) == same
