"""Predictions from new photos, as a person asks for them."""

import json
import shutil

import numpy as np
import pytest

from lightprobe.imaging import read_hdr, read_ldr, write_png
from tests.cli.commands import fails, succeed
from tests.toy_scene import SIZE


@pytest.mark.slow
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
    assert "warning" not in capsys.readouterr().err
    succeed("predict", run.path, image, "--save-camera", tmp_path / "camera.json")
    assert "write no file" in capsys.readouterr().err
    assert not (tmp_path / "camera.json").exists()
    assert read_ldr(run.prediction_file("test_00", ".png"))[0].shape == light.shape
    assert run.prediction_file("test_00", ".confidence.exr").read_bytes() == (tmp_path / "c.exr").read_bytes()


@pytest.mark.slow
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
    words = ["predict", run.path, scene / "test/test_00.png", "--light-resolution", "100"]
    fails(words, capsys, ["light_resolution must be a power of two"])


@pytest.mark.slow
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
        f"{image.stem}{suffix}" for image in images for suffix in (".exr", ".confidence.exr", ".light.json")
    }
    assert not np.array_equal(*(read_hdr(out / f"{image.stem}.exr") for image in images))
    fails(["predict", run.path, *images, "-o", tmp_path / "one.exr"], capsys, ["named like one map"])
    fails(["predict", run.path, images[0], images[0], "-o", tmp_path / "twice"], capsys, ["same name"])


@pytest.mark.slow
def test_a_camera_of_another_photo_is_noticed(trained, tmp_path, capsys):
    scene, run = trained
    record = run.scene()["photos"]["train"]["train_03"]["camera"]
    shifted = {**record, "cx": record["cx"] + SIZE / 4}
    (tmp_path / "camera.json").write_text(json.dumps(shifted))
    image = scene / "train" / "train_03.png"
    succeed("predict", run.path, image, "--camera", tmp_path / "camera.json", "-o", tmp_path / "light.exr")
    assert "overlap by only" in capsys.readouterr().err


@pytest.mark.slow
def test_a_photo_that_shows_nothing_of_the_object_costs_no_other_its_map(trained, tmp_path, capsys):
    scene, run = trained
    good = scene / "test" / "test_00.png"
    color, alpha = read_ldr(good)
    noise, out = tmp_path / "test_01.png", tmp_path / "lights"
    write_png(noise, np.random.default_rng(0).random(color.shape), alpha)
    camera = ["--camera", scene / "transforms_test.json", "-o"]
    told = f"{noise} gets no map. No light makes this object look like this photo"
    fails(["predict", run.path, noise, good, *camera, out], capsys, [told])
    assert {path.name for path in out.iterdir()} == {"test_00.exr", "test_00.light.json"}
    alone = tmp_path / "alone" / "light.exr"
    fails(["predict", run.path, noise, *camera, alone], capsys, [told])
    assert not alone.parent.exists()


def test_maps_are_refused_under_names_that_hide_what_they_are(trained, tmp_path, capsys):
    scene, run = trained
    image, out = scene / "test" / "test_00.png", tmp_path / "light.exr"
    for names in (
        ("-o", tmp_path / "light.png"),
        ("-o", out, "--confidence", tmp_path / "c.png"),
        ("-o", out, "--confidence", out),
    ):
        fails(["predict", run.path, image, *names], capsys, [])
    assert not list(tmp_path.iterdir())


def test_without_a_model_predict_says_what_it_does(trained, tmp_path, capsys):
    scene, run = trained
    shutil.copytree(run.path, tmp_path / "run", ignore=shutil.ignore_patterns("model"))
    succeed("predict", tmp_path / "run", scene / "test" / "test_00.png")
    printed = capsys.readouterr().out
    assert "No trained model" in printed
    assert "(solve;" in printed
