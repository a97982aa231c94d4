"""Light for other programs, as the commands write it."""

import json
import math

import numpy as np
import pytest

from lightprobe.cli.main import main
from lightprobe.imaging import read_hdr, write_exr
from lightprobe.light import equirect
from tests.cli.commands import fails, succeed
from tests.export.glb_reader import Glb

KEYS = (
    "format version map units color_space axes up sources sources_sought spherical_harmonics webxr white_balance exposure "
    "photometry calibration confidence photo verdict background"
)


@pytest.mark.slow
def test_predict_writes_a_map_of_the_size_that_is_asked_for_and_what_else_is_known(trained, tmp_path):
    scene, run = trained
    image, out = scene / "test/test_00.png", tmp_path / "light.hdr"
    small = tmp_path / "small.exr"
    succeed(
        "predict", run.path, image, "-o", out, "--size", "256x128", "--sun", "separate", "--device", "cpu"
    )
    succeed("predict", run.path, image, "-o", small, "--size", "128", "--device", "cpu")
    assert read_hdr(out).shape == (128, 256, 3)
    assert read_hdr(small).shape == (64, 128, 3)
    told = json.loads((tmp_path / "light.light.json").read_text())
    assert told.keys() == set(KEYS.split())
    assert told["map"] == {"file": "light.hdr", "copies": [], "width": 256, "height": 128, "sun": "separate"}
    assert told["photo"]["file"] == "test_00.png"
    assert told["photo"]["camera"]["width"] > 0
    assert told["photometry"]["cd_per_m2_per_unit"] is None
    assert len(told["spherical_harmonics"]["coefficients_rgb"]) == 9
    assert len(told["webxr"]["sphericalHarmonicsCoefficients"]) == 27
    assert 0 < told["confidence"]["mean"] < 1
    for source in told["sources"]:
        assert math.hypot(*source["direction"]) == pytest.approx(1)
        assert {"direction", "angular_radius_deg", "irradiance_rgb", "uncertainty"} <= source.keys()


@pytest.mark.slow
def test_suns_and_lamps_that_are_not_looked_for_cannot_be_kept_out_of_a_map(trained, tmp_path, capsys):
    scene, run = trained
    words = ["predict", run.path, scene / "test/test_00.png", "-o", tmp_path / "light.exr", "--no-sources"]
    succeed(*words, "--device", "cpu")
    told = json.loads((tmp_path / "light.light.json").read_text())
    assert (told["sources_sought"], told["sources"]) == (False, [])
    fails([*words, "--sun", "separate"], capsys, ["not looked for"])


def test_export_with_a_light_has_its_lamps_beside_the_map_or_in_it(trained, tmp_path):
    _, run = trained
    direction = equirect.directions(64).numpy() @ np.array([0.48, 0.6, 0.64])
    light = (0.3 + 400.0 * (direction > math.cos(math.radians(4)))[..., None]).repeat(3, 2).astype(np.float32)
    write_exr(tmp_path / "studio.exr", light)
    succeed("export", run.path, "-o", tmp_path / "apart", "--env", tmp_path / "studio.exr")
    document = Glb((tmp_path / "apart/scene.glb").read_bytes()).document
    (lamp,) = document["extensions"]["KHR_lights_punctual"]["lights"]
    solid_angle = 2 * math.pi * (1 - math.cos(math.radians(4)))
    assert lamp["intensity"] == pytest.approx(400 * solid_angle, rel=0.15)
    assert read_hdr(tmp_path / "apart/light.exr").max() < 40
    succeed(
        "export", run.path, "-o", tmp_path / "inside", "--env", tmp_path / "studio.exr", "--sun", "inside"
    )
    inside = Glb((tmp_path / "inside/scene.glb").read_bytes()).document
    assert inside["extensionsUsed"] == ["EXT_lights_image_based"]
    assert np.array_equal(read_hdr(tmp_path / "inside/light.exr"), light)


def test_a_predicted_light_brings_its_own_lamps(trained, tmp_path):
    _, run = trained
    write_exr(tmp_path / "light.exr", np.full((16, 32, 3), 0.5, np.float32))
    lamp = {"direction": [0, 0, 1], "angular_radius_deg": 3, "irradiance_rgb": [2, 1, 1], "uncertainty": 0.1}
    told = {"format": "lightprobe light", "version": 1, "map": {"sun": "separate"}, "sources": [lamp]}
    (tmp_path / "light.light.json").write_text(json.dumps(told))
    succeed("export", run.path, "-o", tmp_path / "out", "--env", tmp_path / "light.exr")
    document = Glb((tmp_path / "out/scene.glb").read_bytes()).document
    assert document["extensions"]["KHR_lights_punctual"]["lights"][0]["intensity"] == 2
    (tmp_path / "light.light.json").write_text(json.dumps(told | {"sources": [{}]}))
    assert (
        main(["export", str(run.path), "-o", str(tmp_path / "bad"), "--env", str(tmp_path / "light.exr")])
        == 2
    )
    assert not (tmp_path / "bad").exists()


@pytest.mark.parametrize(
    ("words", "told"),
    [
        ("predict {run} {photo} -o l.exr --size 100", "--size '100'; give one of 128x64, 256x128, 512x256"),
        ("export {run} -o o --size 2x1", "--size '2x1'"),
        ("calibrate {run}", "--photo and one of --env, --albedo, --lux, or --reset"),
        ("calibrate {run} --photo {photo} --lux 5 --albedo .2", "one of"),
        ("calibrate {run} --photo {photo} --albedo 2 --at 1,1", "--albedo must be one number"),
        ("calibrate {run} --photo {photo} --albedo .2,.2 --at 1,1", "--albedo must be one number"),
        ("calibrate {run} --photo {photo} --albedo .2", "--albedo and --at belong together"),
        ("calibrate {run} --photo {photo} --albedo .2 --at 1", "--at must be two numbers"),
        ("calibrate {run} --photo {photo} --lux 5 --up", "--up is about a card"),
        *(
            (f"calibrate {{run}} --reset {more}", "--reset forgets")
            for more in ("--photo x", "--lux 5", "--at 1,2", "--mask x", "--camera x", "--up")
        ),
    ],
)
def test_bad_sizes_and_calibrations_are_one_sentence(trained, tmp_path, monkeypatch, capsys, words, told):
    monkeypatch.chdir(tmp_path)
    scene, run = trained
    fails(words.format(run=run.path, photo=scene / "test/test_00.png").split(), capsys, [told])
    assert not list(tmp_path.iterdir())


def test_calibrate_by_a_training_light_changes_nothing_and_can_be_undone(trained, tmp_path, capsys):
    scene, run = trained
    photo, env = scene / "train/train_03.png", run.environment_file("train_03")
    succeed("calibrate", run.path, "--photo", photo, "--env", env)
    factor = json.loads(run.calibration_file.read_text())["light_factor_rgb"]
    assert "Light of this run is now" in capsys.readouterr().out
    assert all(0.3 < value < 3 for value in factor)
    succeed("export", run.path, "-o", tmp_path / "files")
    exported, stored = read_hdr(tmp_path / "files/env/train_03.exr"), read_hdr(env)
    assert np.allclose(exported, stored * factor, rtol=1e-3, atol=1e-5)
    succeed("calibrate", run.path, "--reset")
    assert not run.calibration_file.exists()
    succeed("calibrate", run.path, "--reset")
    assert "no calibration" in capsys.readouterr().out
