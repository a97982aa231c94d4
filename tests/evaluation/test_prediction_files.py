from pathlib import Path

import numpy as np
import pytest
import torch

from lightprobe.core.config.prediction import Sun
from lightprobe.evaluation.prediction_files import write_prediction
from lightprobe.imaging import read_hdr, read_ldr
from lightprobe.light.environment import Environment
from lightprobe.light.files import light_file
from lightprobe.light.sources import SplitLight
from lightprobe.prediction import Prediction, PhotoVerdict

GOOD = PhotoVerdict(0.01, 0.95, 0.95, 0.0, 0.2, 0.99, 0.001)


def prediction() -> Prediction:
    """A light that is brighter above than below, more trusted along +x; without its suns it has a third of
    it.
    """
    light = torch.ones(6, 8, 8, 3) * torch.tensor([0.5, 0.25, 1.0])
    light[4] *= 4
    trust = torch.full((6, 8, 8), 0.125)
    trust[0] = 0.75
    split = SplitLight(Environment(light / 3), ())
    return Prediction(Environment(light), trust, {"total": 1.0}, GOOD, split=split)


@pytest.mark.parametrize(("height", "sun", "share"), [(None, Sun.INSIDE, 1.0), (64, Sun.SEPARATE, 1 / 3)])
def test_a_map_has_its_picture_and_its_confidence_beside_it(
    tmp_path: Path, height: int | None, sun: Sun, share: float
) -> None:
    write_prediction(prediction(), tmp_path / "a.exr", height, sun)
    assert {path.name for path in tmp_path.iterdir()} == {"a.exr", "a.png", "a.confidence.exr"}
    rows = height or 16
    light, confidence = read_hdr(tmp_path / "a.exr"), read_hdr(tmp_path / "a.confidence.exr")
    assert light.shape == (rows, 2 * rows, 3)
    assert light[0, 0] == pytest.approx(share * np.array([2.0, 1.0, 4.0]), rel=1e-2)
    assert light[-1, 0] == pytest.approx(share * np.array([0.5, 0.25, 1.0]), rel=1e-2)
    assert confidence.shape[:2] == (16, 32)
    assert float(confidence[8, 16].flat[0]) == pytest.approx(
        0.75, abs=1e-3
    )  # the middle column looks along +x
    assert float(confidence[8, 0].flat[0]) == pytest.approx(0.125, abs=1e-3)
    picture, _ = read_ldr(tmp_path / "a.png")
    assert picture.shape == light.shape
    factor = -np.log(1 - picture[-1, 0]) / light[-1, 0]  # 1 - exp(-factor radiance), one factor for all
    assert factor == pytest.approx(np.full(3, factor.mean()), rel=0.03)
    assert picture[0, 0] == pytest.approx(1 - np.exp(-factor.mean() * light[0, 0]), abs=0.02)


def test_what_was_told_of_an_older_map_goes(tmp_path: Path) -> None:
    light_file(tmp_path / "a.exr").write_text(
        '{"format": "lightprobe light", "map": {"file": "a.exr", "sun": "separate"}}'
    )
    write_prediction(prediction(), tmp_path / "a.exr")
    assert not light_file(tmp_path / "a.exr").exists()


def test_a_map_can_be_written_as_radiance(tmp_path: Path) -> None:
    write_prediction(prediction(), tmp_path / "b.hdr")
    assert {path.name for path in tmp_path.iterdir()} == {"b.hdr", "b.png", "b.confidence.exr"}
    assert read_hdr(tmp_path / "b.hdr")[0, 0] == pytest.approx([2.0, 1.0, 4.0], rel=0.01)
