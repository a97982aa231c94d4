"""The whole program on a toy scene: learn, resume, predict, render, relight, evaluate, export."""

import json
import os
import re
import shutil
import subprocess
import sys
from datetime import datetime
from importlib.metadata import version
from pathlib import Path
from urllib.parse import unquote

import numpy as np
import pytest
import torch
from PIL import Image

from lightprobe.cli.main import COMMANDS, main
from lightprobe.core.config import DecomposeConfig, DistillConfig
from lightprobe.core.run import RunFolder
from lightprobe.imaging import read_hdr, read_ldr, srgb_encode, write_exr, write_png
from lightprobe.scene.camera import Camera
from tests.toy_scene import SIZE, TINY, TINY_DISTILL, write_toy_scene

PHASES = ("decompose", "distill")


def succeed(*arguments) -> None:
    assert main([str(argument) for argument in arguments]) == 0


@pytest.fixture(scope="module")
def trained(tmp_path_factory):
    """A scene folder and a run on it, trained for a few steps."""
    folder = tmp_path_factory.mktemp("toy")
    scene = write_toy_scene(folder / "scene")
    succeed("train", scene, "-o", folder / "run", *TINY, *TINY_DISTILL)
    return scene, RunFolder(folder / "run")


def test_training_leaves_the_documented_files(trained):
    _, run = trained
    files = {str(p.relative_to(run.path)) for p in run.path.rglob("*") if p.is_file()}
    names = {f"train_{i:02d}" for i in range(18)}
    assert {"config.json", "scene.json", "metrics.jsonl", "log.txt", "timings.json"} <= files
    assert {f"mesh/{n}" for n in ("object.glb", "base_color.png", "orm.png", "normal.png")} <= files
    assert {f"env/{name}.exr" for name in names} <= files
    assert {"model/config.json"} <= files
    steps = sorted(p.name for p in run.checkpoints.folder.iterdir())
    assert steps == ["step-000000025", "step-000000030"]
    assert not list(run.path.rglob(".partial-*"))
    stages = [json.loads(line)["stage"] for line in run.metrics_log.read_text().splitlines()]
    assert stages == ["pass1", "pass2", "pass3", "distill"]


def test_the_same_command_again_changes_nothing(trained):
    scene, run = trained
    before = {p: p.read_bytes() for p in run.path.rglob("*") if p.is_file() and p.name != "log.txt"}
    succeed("train", scene, "-o", run.path, *TINY, *TINY_DISTILL)
    assert {p: p.read_bytes() for p in run.path.rglob("*") if p.is_file() and p.name != "log.txt"} == before


def test_another_scene_or_option_is_refused_with_the_difference(trained, tmp_path, capsys):
    scene, run = trained
    assert main(["fit", str(scene), "-o", str(run.path), *TINY, "--seed", "3"]) == 3
    assert "decompose.seed = 0, not 3" in capsys.readouterr().err
    other = write_toy_scene(tmp_path / "other", train=5)
    assert main(["fit", str(other), "-o", str(run.path), *TINY]) == 3
    assert "--restart" in capsys.readouterr().err


def test_predict_writes_map_picture_and_confidence(trained, tmp_path, capsys):
    scene, run = trained
    out = tmp_path / "deep" / "light.exr"
    image, cameras = scene / "test" / "test_00.png", scene / "transforms_test.json"
    succeed("predict", run.path, image, "--camera", cameras, "-o", out, "--confidence", tmp_path / "c.exr")
    light = read_hdr(out)
    assert light.shape[1] == 2 * light.shape[0]
    assert light.min() >= 0
    assert light.max() > 0
    confidence = read_hdr(tmp_path / "c.exr")
    assert confidence.min() >= 0
    assert confidence.max() <= 1
    printed = capsys.readouterr()
    assert str(out) in printed.out
    assert "warning" not in printed.err
    assert not run.prediction_file("test_00", ".exr").exists()
    succeed("predict", run.path, image)  # a photo of the run's own scene
    assert run.prediction_file("test_00", ".exr").read_bytes() == out.read_bytes()
    assert read_ldr(run.prediction_file("test_00", ".png"))[0].shape == light.shape
    assert run.prediction_file("test_00", ".confidence.exr").read_bytes() == (tmp_path / "c.exr").read_bytes()


def test_predict_takes_the_run_s_settings_and_the_command_line_s_before_them(trained, tmp_path):
    scene, run = trained
    kept = run.config_file.read_bytes()
    photo, out = scene / "test/test_00.png", tmp_path / "light.exr"
    succeed("predict", run.path, photo, "-o", out, "--light-resolution", "8", "--device", "cpu")
    assert read_hdr(out).shape == (16, 32, 3)
    settings = json.loads(kept)
    settings["predict"] |= {"light_resolution": 16, "method": "constant"}
    try:
        run.config_file.write_text(json.dumps(settings))
        succeed("predict", run.path, photo, "-o", out, "--device", "cpu")
        assert read_hdr(out).shape == (32, 64, 3)
        assert np.ptp(read_hdr(out)) < 1e-6  # but for rounding
        del settings["predict"]  # as runs of before there were settings
        run.config_file.write_text(json.dumps(settings))
        succeed("predict", run.path, photo, "-o", out, "--device", "cpu")
        assert read_hdr(out).shape == (64, 128, 3)
    finally:
        run.config_file.write_bytes(kept)


def test_unusable_settings_of_a_prediction_are_refused(trained, capsys):
    scene, run = trained
    assert main(["predict", str(run.path), str(scene / "test/test_00.png"), "--light-resolution", "100"]) == 3
    assert "light_resolution must be a power of two" in capsys.readouterr().err


def test_several_photos_are_predicted_into_a_folder(trained, tmp_path, capsys):
    scene, run = trained
    images = sorted((scene / "test").glob("*.png"))
    masks = tmp_path / "masks"
    for image in images:
        alpha = read_ldr(image)[1]
        write_png(masks / image.name, np.repeat(alpha[..., None], 3, 2))
    out = tmp_path / "lights"
    succeed("predict", run.path, *images, "--mask", masks, "-o", out, "--confidence", out)
    assert {p.name for p in out.iterdir()} == {
        f"{image.stem}{suffix}" for image in images for suffix in (".exr", ".confidence.exr")
    }
    assert not np.array_equal(*(read_hdr(out / f"{image.stem}.exr") for image in images))
    assert main(["predict", str(run.path), *map(str, images), "-o", str(tmp_path / "one.exr")]) == 3
    assert main(["predict", str(run.path), str(images[0]), str(images[0]), "-o", str(tmp_path / "twice")]) == 3
    assert "same name" in capsys.readouterr().err


def test_a_camera_of_another_photo_is_noticed(trained, tmp_path, capsys):
    scene, run = trained
    record = run.scene()["photos"]["train"]["train_03"]["camera"]
    shifted = {**record, "cx": record["cx"] + SIZE / 4}
    (tmp_path / "camera.json").write_text(json.dumps(shifted))
    image = scene / "train" / "train_03.png"
    succeed("predict", run.path, image, "--camera", tmp_path / "camera.json", "-o", tmp_path / "light.exr")
    assert "overlap by only" in capsys.readouterr().err


def test_a_photo_that_shows_nothing_of_the_object_is_refused_and_costs_no_other_its_map(trained, tmp_path, capsys):
    scene, run = trained
    good = scene / "test" / "test_00.png"
    color, alpha = read_ldr(good)
    noise, out = tmp_path / "test_01.png", tmp_path / "lights"
    write_png(noise, np.random.default_rng(0).random(color.shape), alpha)
    camera = ["--camera", str(scene / "transforms_test.json")]
    assert main(["predict", str(run.path), str(noise), str(good), *camera, "-o", str(out)]) == 2
    printed = capsys.readouterr()
    assert f"{noise} gets no map. No light makes this object look like this photo" in printed.err
    assert [path.name for path in out.iterdir()] == ["test_00.exr"]
    alone = tmp_path / "alone" / "light.exr"
    assert main(["predict", str(run.path), str(noise), *camera, "-o", str(alone)]) == 2
    assert not alone.parent.exists()


def test_maps_are_refused_under_names_that_hide_what_they_are(trained, tmp_path, capsys):
    scene, run = trained
    image, out = scene / "test" / "test_00.png", tmp_path / "light.exr"
    for names in (("-o", tmp_path / "light.png"), ("-o", out, "--confidence", tmp_path / "c.png"),
                  ("-o", out, "--confidence", out)):  # fmt: skip
        assert main(["predict", str(run.path), str(image), *map(str, names)]) == 3
    assert not list(tmp_path.iterdir())
    assert capsys.readouterr().out == ""


def test_without_a_model_predict_says_what_it_does(trained, tmp_path, capsys):
    scene, run = trained
    shutil.copytree(run.path, tmp_path / "run", ignore=shutil.ignore_patterns("model"))
    succeed("predict", tmp_path / "run", scene / "test" / "test_00.png")
    printed = capsys.readouterr().out
    assert "No trained model" in printed
    assert "(solve;" in printed


@pytest.mark.slow
def test_the_readme_s_python_examples_run(trained, tmp_path, monkeypatch):
    scene, run = trained
    (tmp_path / "photos").mkdir()
    (tmp_path / "runs").mkdir()
    shutil.copytree(scene, tmp_path / "photos" / "cup")
    shutil.copytree(run.path, tmp_path / "runs" / "cup")
    color, alpha = read_ldr(scene / "test" / "test_00.png")
    Image.fromarray((255 * srgb_encode(torch.from_numpy(color)).numpy()).astype(np.uint8)).save(tmp_path / "new.jpg")
    write_png(tmp_path / "new_mask.png", np.repeat(alpha[..., None], 3, 2))
    (tmp_path / "new.json").write_text(json.dumps(run.scene()["photos"]["test"]["test_00"]["camera"]))
    stored = {phase: {k: v for k, v in run.config(phase).items() if k not in ("seed", "hdri")} for phase in PHASES}
    short = {"decompose": DecomposeConfig.from_json(stored["decompose"]),
             "distill": DistillConfig.from_json(stored["distill"])}  # fmt: skip
    monkeypatch.setattr("lightprobe.reconstruction.phase1.DecomposeConfig", lambda: short["decompose"])
    monkeypatch.setattr("lightprobe.distillation.training.DistillConfig", lambda: short["distill"])
    monkeypatch.chdir(tmp_path)
    readme = (Path(__file__).parents[2] / "README.md").read_text()
    names: dict = {}
    for example in re.findall(r"```python\n(.*?)```", readme, re.DOTALL):
        exec(example, names)
    assert names["image"].shape == (SIZE, SIZE, 3)
    assert names["scores"]["psnr_masked"] > 5
    assert read_hdr(tmp_path / "light.exr").shape == (64, 128, 3)
    assert read_hdr(tmp_path / "seen.exr").shape[:2] == (64, 128)


def test_render_writes_the_camera_s_picture(trained, tmp_path, capsys):
    scene, run = trained
    record = json.loads(run.scene_file.read_text())["photos"]["test"]["test_01"]["camera"]
    (tmp_path / "camera.json").write_text(json.dumps(record))
    env = run.environment_file("train_00")
    for suffix in ("png", "exr"):
        out = tmp_path / f"view.{suffix}"
        succeed("render", run.path, "--camera", tmp_path / "camera.json", "--env", env, "-o", out)
    many = ["render", run.path, "--camera", scene / "transforms_test.json", "--env", env, "-o", tmp_path / "frame.png"]
    assert main([str(word) for word in many]) == 2
    assert "holds 2 cameras" in capsys.readouterr().err
    succeed(*many, "--frame", "test_01")
    assert (tmp_path / "frame.png").read_bytes() == (tmp_path / "view.png").read_bytes()
    color, alpha = read_ldr(tmp_path / "view.png")
    linear = read_hdr(tmp_path / "view.exr")
    assert linear.shape == (SIZE, SIZE, 4)
    assert np.abs(alpha - linear[..., 3]).max() < 0.005
    solid = alpha > 0.99
    assert solid.mean() == pytest.approx(np.pi * (1.25 / np.sqrt(3.2**2 - 1)) ** 2, rel=0.15)
    assert np.abs(np.minimum(linear[solid, :3], 1) - color[solid]).max() < 0.02


def test_relight_writes_turntable_and_test_views(trained, tmp_path):
    _, run = trained
    env = run.environment_file("train_01")
    succeed("relight", run.path, "--env", env, "-o", tmp_path, "--frames", 3, "--side", 24)
    names = sorted(str(p.relative_to(tmp_path)) for p in tmp_path.rglob("*.png"))
    assert names == [
        "test/test_00.png",
        "test/test_01.png",
        "turntable/000.png",
        "turntable/001.png",
        "turntable/002.png",
    ]
    assert read_ldr(tmp_path / "turntable" / "001.png")[1].max() == 1


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
    assert page.count("<section>") == 2
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
        addresses = re.findall(r'href="([^"]+)"', report.read_text())
        assert len(addresses) == 2 + 2 * 2  # the object and the numbers, and each photo's map and confidence
        assert all((report.parent / unquote(address)).is_file() for address in addresses)
        assert any(f"predictions/{method}/test_00.exr" in address for address in addresses)


def test_the_report_says_how_the_run_was_made(trained):
    _, run = trained
    succeed("eval", run.path, "--no-unseen", "--methods", "probe-net+optimize")
    page = run.report_file.read_text()
    for words in (
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


def test_export_writes_every_environment_twice(trained, tmp_path):
    _, run = trained
    succeed("export", run.path, "-o", tmp_path)
    assert (tmp_path / "mesh.glb").is_file()
    exr, hdr = (read_hdr(tmp_path / "env" / f"train_00{suffix}") for suffix in (".exr", ".hdr"))
    assert np.abs(exr - hdr).max() <= exr.max() / 128


def test_a_moved_scene_is_found_by_its_new_place(trained, tmp_path, capsys):
    scene, run = trained
    quickly = ("--no-unseen", "--methods", "constant")
    os.rename(scene, tmp_path / "moved")
    try:
        assert main(["eval", str(run.path)]) == 2
        assert "--scene" in capsys.readouterr().err
        succeed("eval", run.path, "--scene", tmp_path / "moved", *quickly)
    finally:
        os.rename(tmp_path / "moved", scene)
        succeed("eval", run.path, "--scene", scene, *quickly)


@pytest.mark.slow
def test_a_phase_can_be_restarted_with_other_options(trained, tmp_path):
    _, run = trained
    before = run.asset_file.read_bytes()
    short = [*TINY_DISTILL[2:], "--distill.steps", "3", "--device", "cpu"]
    assert main(["distill", str(run.path), *short]) == 3
    succeed("distill", run.path, "--restart", *short)
    assert run.config("distill")["steps"] == 3
    assert run.asset_file.read_bytes() == before
    maps = run.path.parent / "maps"
    write_exr(maps / "grey.exr", np.full((16, 32, 3), 0.5, np.float32))
    succeed("distill", run.path, "--restart", "--hdri", maps, *short)
    assert run.config("distill")["hdri"] == str(maps.resolve())
    succeed("distill", run.path, "--restart", *TINY_DISTILL, "--device", "cpu")


@pytest.mark.parametrize("command", COMMANDS)
def test_help_of_every_command_shows_an_example(command, capsys):
    with pytest.raises(SystemExit) as end:
        main([command, "--help"])
    assert end.value.code == 0
    assert f"lightprobe {command}" in capsys.readouterr().out.partition("Examples:")[2]


def test_help_shows_the_values_of_the_chosen_preset(capsys):
    with pytest.raises(SystemExit):
        main(["fit", "--help", "--preset", "paper"])
    assert "40000" in capsys.readouterr().out


def test_help_loads_no_torch():
    code = "import sys; from lightprobe.cli.main import main; main(['--help']); sys.exit('torch' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], capture_output=True).returncode == 0


def test_written_cameras_can_be_read_back(trained):
    _, run = trained
    for photo in run.scene()["photos"]["train"].values():
        assert Camera.from_json(photo["camera"], source="x").width == SIZE
