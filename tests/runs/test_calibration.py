"""Calibrations of a run whose object came out brighter than it is, by what is known of one photo."""

import dataclasses
import json
import math
import warnings

import numpy as np
import pytest
import torch

from lightprobe.core.config.prediction import Sun
from lightprobe.core.errors import ConfigError, InputError, LightprobeWarning
from lightprobe.core.run import RunFolder
from lightprobe.evaluation import relight
from lightprobe.export.light_file import candela_per_unit, write_sources
from lightprobe.imaging import read_ldr, write_exr, write_png
from lightprobe.light.environment import Environment
from lightprobe.light.files import light_file
from lightprobe.models import Decomposition
from lightprobe.models.calibration import Calibration
from lightprobe.prediction import Predictor
from lightprobe.runs import calibration as calibrations
from lightprobe.runs.calibration import Point, calibrate_by_albedo, calibrate_by_light, calibrate_by_meter
from lightprobe.runs.outputs import export_run, render_run
from lightprobe.scene import load_photo
from lightprobe.scene.record import scene_record
from tests.known_scene import CPU, known_scene

FACTOR = torch.tensor(
    [1.3, 1.0, 0.8]
)  # of the true light over the run's: base colours came out so many times too bright


@pytest.fixture(scope="module")
def lit(tmp_path_factory):
    """A run, a photo of the true object, its camera file and its true light."""
    folder = tmp_path_factory.mktemp("calibration")
    true, scene = known_scene(folder)
    photo = scene.test[0]
    textures = true.asset.textures
    bright = dataclasses.replace(textures, base_color=(textures.base_color * FACTOR).clamp(max=1))
    run = RunFolder.create(folder / "run")
    run.record_scene(scene_record(scene))
    lights = {one.name: Environment(torch.ones(6, 16, 16, 3)) for one in scene.train}
    decomposition = Decomposition(dataclasses.replace(true.asset, textures=bright), lights, true.similarity)
    decomposition.save(run)
    light = Environment.load(photo.truth.environment).scaled(0.6)
    image, cover = relight(true, light, photo.camera)
    shot = folder / "shot.png"
    write_png(shot, (image / cover.clamp(min=1e-6)[..., None]).numpy(), cover.numpy(), bits=16)
    write_exr(folder / "light.exr", light.panorama())
    (folder / "camera.json").write_text(json.dumps(photo.camera.to_json()))
    return run, true, shot, folder, folder / "camera.json", light


@pytest.fixture
def clean(lit):
    yield lit
    calibrations.reset_calibration(lit[0].path)


def test_a_known_light_tells_the_factor(clean):
    run, true, shot, folder, camera, _ = clean
    before = run.asset_file.read_bytes()
    found = calibrate_by_light(run.path, shot, folder / "light.exr", camera=camera)
    assert found.factor == pytest.approx(FACTOR.tolist(), rel=0.03)
    assert run.asset_file.read_bytes() == before
    loaded = Decomposition.load(run, CPU)
    error = (loaded.asset.textures.base_color - true.asset.textures.base_color).abs().mean()
    assert float(error) < 0.02
    assert torch.equal(
        loaded.trained.textures.base_color,
        Decomposition.load(run, CPU, calibrated=False).asset.textures.base_color,
    )
    (name,) = list(loaded.lights)[:1]
    assert loaded.lights[name].mean().tolist() == pytest.approx(found.factor)
    again = calibrate_by_light(run.path, shot, folder / "light.exr", camera=camera)
    assert again == found  # not on top of itself


@pytest.mark.long
def test_a_map_that_was_predicted_before_is_told_to_be_too_dark(clean, tmp_path):
    run, _, shot, folder, camera, light = clean
    light.save(tmp_path / "light.exr")
    write_sources(tmp_path / "light.exr", 64, (), Sun.INSIDE)
    file = light_file(tmp_path / "light.exr")
    file.write_text(json.dumps({**json.loads(file.read_text()), "calibration": None}))
    picture = tmp_path / "picture.png"
    with warnings.catch_warnings():
        warnings.simplefilter("error", LightprobeWarning)
        render_run(run.path, tmp_path / "light.exr", camera, picture)
    calibrate_by_light(run.path, shot, folder / "light.exr", camera=camera)
    with pytest.warns(LightprobeWarning, match="was predicted without a calibration"):
        render_run(run.path, tmp_path / "light.exr", camera, picture)
    with pytest.warns(LightprobeWarning, match="was predicted without a calibration"):
        export_run(run.path, tmp_path / "files", environment=tmp_path / "light.exr")


def test_a_light_of_another_photo_is_doubtful(clean):
    run, _, shot, folder, camera, light = clean
    write_exr(folder / "mirrored.exr", light.panorama()[::-1])
    with pytest.warns(LightprobeWarning, match=r"mirrored\.exr explains only \d+ % of what shot\.png"):
        calibrate_by_light(run.path, shot, folder / "mirrored.exr", camera=camera)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        calibrate_by_light(run.path, shot, folder / "light.exr", camera=camera)


def test_a_point_of_known_albedo_on_the_object_tells_the_factor(clean):
    run, _, shot, _, camera, _ = clean
    color = (Decomposition.load(run, CPU).asset.textures.base_color / FACTOR).mean((0, 1))
    point = Point(28, 28, tuple(color.tolist()))
    found = calibrate_by_albedo(run.path, shot, point, camera=camera)
    assert found.factor == pytest.approx(FACTOR.tolist(), rel=0.5)  # the albedo is only the object's mean


def test_predictions_are_as_bright_as_the_calibration_says(clean):
    run, _, shot, _, camera, _ = clean
    pixels, view = load_photo(shot, camera=camera)
    before = Predictor.load(run.path).predict(pixels, view, sources=True)
    Calibration((2.0, 1.0, 0.5), "x").save(run.calibration_file)
    after = Predictor.load(run.path).predict(pixels, view, sources=True)
    scaled = before.environment.texels * torch.tensor([2.0, 1.0, 0.5])
    torch.testing.assert_close(after.environment.texels, scaled)
    assert after.calibration is not None
    for one, other in zip(before.split.sources, after.split.sources, strict=True):
        assert other.irradiance == pytest.approx(
            [2 * one.irradiance[0], one.irradiance[1], one.irradiance[2] / 2]
        )


def test_a_card_and_a_meter_measure_the_predicted_light(clean, monkeypatch):
    run, _, shot, folder, camera, _ = clean
    flat = torch.full((6, 8, 8, 3), 2.0)  # irradiance 2 pi whichever way a card faces
    monkeypatch.setattr(calibrations._Opened, "predicted", lambda self: flat)
    color, alpha = read_ldr(shot)
    color = np.where(alpha[..., None] > 0, color, 0.5)
    color[:6, :6] = 0.18 * torch.tensor([3.0, 2.0, 1.0]).numpy()  # of a grey card under radiance 3, 2 and 1
    with_card, mask = folder / "card.png", folder / "card_mask.png"
    write_png(with_card, color, bits=16)
    write_png(mask, np.repeat(alpha[..., None], 3, 2), srgb=False)
    card = calibrate_by_albedo(run.path, with_card, Point(2, 2, (0.18, 0.18, 0.18)), camera=camera, mask=mask)
    assert card.factor == pytest.approx((1.5, 1.0, 0.5), rel=1e-2)
    opened = calibrations._Opened.of(run.path, shot, camera, None, "cpu")
    photo = dataclasses.replace(opened.photo, ev100=10.0)
    monkeypatch.setattr(
        calibrations._Opened, "of", staticmethod(lambda *_: dataclasses.replace(opened, photo=photo))
    )
    lux = candela_per_unit(10.0) * 2 * math.pi * 1.25
    meter = calibrate_by_meter(run.path, shot, lux, camera=camera)
    assert meter.factor == pytest.approx((1.25, 1.25, 1.25), rel=1e-2)


@pytest.mark.parametrize("place", ["beside", "in front"])
def test_a_card_at_the_object_is_no_part_of_it(clean, monkeypatch, place):
    run, _, shot, folder, camera, _ = clean
    flat = torch.full((6, 8, 8, 3), 2.0)
    monkeypatch.setattr(calibrations._Opened, "predicted", lambda self: flat)
    monkeypatch.setattr(calibrations, "_PATCH", 0.1)  # 6 of 56 pixels
    color, alpha = read_ldr(shot)
    row = 28
    column = int(np.flatnonzero(alpha[row] > 0)[0]) - 2 if place == "beside" else 28
    color = np.where(alpha[..., None] > 0, color, 0.18 * 3)
    alpha = alpha.copy()
    if place == "in front":
        color[20:36, 20:36], alpha[20:36, 20:36] = 0.18 * 3, 0
    with_card, mask = folder / "card.png", folder / "card_mask.png"
    write_png(with_card, color, bits=16)
    write_png(mask, np.repeat(alpha[..., None], 3, 2), srgb=False)
    at = Point(column + 0.5, row + 0.5, (0.18, 0.18, 0.18))
    card = calibrate_by_albedo(run.path, with_card, at, camera=camera, mask=mask)
    assert card.source == "a card in card.png"
    assert card.factor == pytest.approx((1.5, 1.5, 1.5), rel=1e-2)


def test_a_point_on_the_outline_is_neither_the_object_nor_a_card(clean):
    run, _, shot, _, camera, _ = clean
    _, alpha = read_ldr(shot)
    row, column = (int(each[0]) for each in np.nonzero((alpha > 0.2) & (alpha < 0.8)))
    point = Point(column + 0.5, row + 0.5, (0.2, 0.2, 0.2))
    with pytest.raises(InputError, match="on the object's outline"):
        calibrate_by_albedo(run.path, shot, point, camera=camera)
    assert not run.calibration_file.exists()


def test_what_cannot_be_is_one_sentence_and_stores_nothing(clean):
    run, _, shot, folder, camera, _ = clean
    write_exr(folder / "dark.exr", np.full((16, 32, 3), 1e-6, np.float32))
    write_exr(folder / "glaring.exr", np.full((16, 32, 3), 1e3, np.float32))
    card, outside = Point(2, 2, (0.18, 0.18, 0.18)), Point(900, 2, (0.18, 0.18, 0.18))
    for calibrate, known, error, words in (
        (calibrate_by_light, folder / "glaring.exr", InputError, "cannot be"),
        (calibrate_by_light, folder / "dark.exr", InputError, "own light"),
        (calibrate_by_meter, 500.0, InputError, "EXIF.*--albedo"),
        (calibrate_by_albedo, card, InputError, "black or clipped"),  # a cut-out photo shows no card
        (calibrate_by_albedo, outside, ConfigError, "outside of the photo"),
        (calibrate_by_meter, -1.0, ConfigError, "--lux"),
    ):
        with pytest.raises(error, match=words):
            calibrate(run.path, shot, known, camera=camera)
    assert not run.calibration_file.exists()
