"""A prediction and its files: no light goes nowhere, and what is written reads back."""

import math

import numpy as np
import pytest
import torch

from lightprobe.core.errors import ConfigError, ConvergenceError
from lightprobe.imaging import read_hdr
from lightprobe.light.environment import Environment
from lightprobe.light.files import panorama, write_map
from lightprobe.prediction import Prediction
from lightprobe.prediction.prediction import check_names
from lightprobe.prediction.verdict import PhotoVerdict

GOOD = PhotoVerdict(0.01, 0.99, 0.99, 0.0, 0.2, 0.99, 0.0)


def light():
    return torch.rand(6, 8, 8, 3, generator=torch.Generator().manual_seed(0))


def trust():
    return torch.rand(6, 8, 8, generator=torch.Generator().manual_seed(1))


def test_a_map_that_is_no_light_goes_nowhere(tmp_path):
    for odd in (light() * math.nan, light() * math.inf, -light()):
        with pytest.raises(ConvergenceError, match="negative, infinite or NaN"):
            Prediction(Environment(odd), trust(), {}, GOOD)
    with pytest.raises(ConvergenceError, match="NaN"):
        Prediction(Environment(light()), trust() * math.nan, {}, GOOD)
    with pytest.raises(ConvergenceError, match=r"l\.exr holds NaN"):
        write_map(tmp_path / "l.exr", np.full((8, 16, 3), np.nan, np.float32))
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(("name", "tolerance"), [("light.exr", 1e-6), ("light.hdr", 0.01)])
def test_files_hold_the_map_and_its_confidence(tmp_path, name, tolerance):
    prediction = Prediction(Environment(light()), trust(), {}, GOOD)
    prediction.save(tmp_path / name, tmp_path / "trust.exr")
    expected = panorama(light())
    found = read_hdr(tmp_path / name)
    assert found.shape == (16, 32, 3)  # 2 R x 4 R
    assert np.abs(found - expected).max() <= tolerance * expected.max()
    confidence = read_hdr(tmp_path / "trust.exr")
    np.testing.assert_allclose(confidence[..., 0], panorama(trust()[..., None])[..., 0], atol=1e-6)


def test_without_a_name_there_is_no_confidence(tmp_path):
    Prediction(Environment(light()), trust(), {}, GOOD).save(str(tmp_path / "light.exr"))
    assert [path.name for path in tmp_path.iterdir()] == ["light.exr"]


@pytest.mark.parametrize(
    ("names", "words"),
    [
        (("light.png", None), r"light\.png"),
        (("light.exr", "trust.hdr"), r"name it \.exr"),
        (("light.exr", "light.exr"), "give them two names"),
    ],
)
def test_wrong_names_are_refused_before_anything_is_written(tmp_path, names, words):
    paths = [None if name is None else tmp_path / name for name in names]
    with pytest.raises(ConfigError, match=words):
        check_names(*paths)
    with pytest.raises(ConfigError, match=words):
        Prediction(Environment(light()), trust(), {}, GOOD).save(*paths)
    assert not list(tmp_path.iterdir())


def test_a_notebook_shows_map_confidence_and_verdict():
    doubtful = PhotoVerdict(0.2, 0.4, 0.99, 0.0, 0.2, 0.99, 0.0)
    prediction = Prediction(Environment(light()), trust(), {"total": 1.5}, doubtful)
    shown = prediction._repr_html_()
    assert shown.count('<img src="data:image/png;base64,') == 2
    assert "photo doubtful; " in shown
    assert "1.50 s" in shown
    assert prediction._repr_png_() == Environment(light())._repr_png_()
