"""`--preset paper` from end to end with few iterations: what it trains, and what predict and eval then do."""

import json

import numpy as np
import pytest

from lightprobe.cli.main import main
from lightprobe.core.checkpoint import load_tensors
from lightprobe.core.run import RunFolder
from lightprobe.imaging import read_hdr
from lightprobe.light import culled_stacking
from lightprobe.models.decomposition import LIGHTS_FILE
from tests.toy_scene import write_toy_scene

# Only sizes and lengths: what is done stays the paper's.
CUT = [
    *("--preset", "paper", "--device", "cpu", "--distill.steps", "3", "--decompose.unwrap-seconds", "0"),
    *(
        "--decompose.pass1-iterations",
        "4",
        "--decompose.pass2-iterations",
        "3",
        "--decompose.checkpoint-every",
        "3",
    ),
    *(
        "--decompose.lattice-cells",
        "10",
        "--decompose.hash-log2-size",
        "10",
        "--decompose.texture-size",
        "64",
    ),
]


def succeed(*arguments) -> None:
    assert main([str(argument) for argument in arguments]) == 0


@pytest.fixture(scope="module")
def trained(tmp_path_factory):
    folder = tmp_path_factory.mktemp("paper")
    scene = write_toy_scene(folder / "scene", train=3, test=1)
    succeed("train", scene, "-o", folder / "run", *CUT)
    return scene, RunFolder(folder / "run")


@pytest.mark.slow
def test_the_run_says_what_it_was(trained):
    _, run = trained
    first, second, third = (run.config(section) for section in ("decompose", "distill", "predict"))
    assert (first["sdf"], first["start"], first["light_update"]) == ("mlp", "sphere", "gradient")
    assert (first["pass1_iterations"], first["pass3_iterations"], first["validation_photos"]) == (4, 0, 0)
    names = ("network", "alpha_rule", "lessons", "sphere_steps")
    assert [second[name] for name in names] == ["plain", "r2", "teacher", 0]
    assert third == {
        "method": "probe-mlp",
        "light_resolution": 128,
        "max_pixels": 1_048_576,
        "sampled_share": 0.25,
        "unseen_share": 0.0,
    }
    assert "held-out" not in run.log_file.read_text()  # no guard
    assert json.loads(run.verdict_file.read_text())["held_out"] is False
    lights = load_tensors(run.mesh_folder / LIGHTS_FILE)
    assert {light.shape for light in lights.values()} == {(6, 128, 128, 3)}
    assert len(lights) == 3


@pytest.mark.slow
def test_predict_writes_the_paper_s_map(trained, tmp_path, capsys, monkeypatch):
    scene, run = trained
    stacked = []
    stack = culled_stacking.stack_probes_culled
    monkeypatch.setattr(
        culled_stacking, "stack_probes_culled", lambda *given: stacked.append(1) or stack(*given)
    )
    photo = scene / "test/test_00.png"
    succeed("predict", run.path, photo, "-o", tmp_path / "light.exr", "--device", "cpu")
    assert "(probe-mlp;" in capsys.readouterr().out
    assert stacked  # not every pair of pixel and texel
    image = read_hdr(tmp_path / "light.exr")
    assert image.shape == (256, 512, 3)  # 2 R x 4 R
    assert np.isfinite(image).all()
    assert (image >= 0).all()
    assert image.max() > 0
    small = ("--light-resolution", "16", "-o", tmp_path / "small.exr")
    succeed("predict", run.path, photo, *small, "--device", "cpu")
    assert read_hdr(tmp_path / "small.exr").shape == (32, 64, 3)


@pytest.mark.slow
def test_eval_scores_the_paper_s_method_first(trained):
    _, run = trained
    succeed("eval", run.path, "--methods", "probe-mlp", "--no-unseen", "--device", "cpu")
    metrics = json.loads(run.metrics_file.read_text())
    assert metrics["default_method"] == "probe-mlp"
    assert np.isfinite(metrics["mean"]["psnr"])
    name = next(iter(metrics["photos"]))
    assert read_hdr(run.prediction_file(name, ".exr")).shape == (256, 512, 3)
    report = run.report_file.read_text()
    assert "lightprobe train SCENE -o RUN --preset paper --seed 0 --decompose.pass1-iterations 4" in report
    assert "--predict." not in report  # the preset says how it predicts
