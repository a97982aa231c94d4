"""How the pictures of several programs are compared."""

import json

import numpy as np
import pytest

from compare_renderers import Rendered, difference, report
from lightprobe.imaging import read_ldr, srgb_encode


def rendered(level: float, cover: np.ndarray) -> Rendered:
    return Rendered(np.full((*cover.shape, 3), level, np.float32), cover)


def test_only_pixels_that_both_cover_wholly_count():
    first, second = np.ones((4, 4), np.float32), np.ones((4, 4), np.float32)
    first[0], second[:, 0] = 0.5, 0
    a, b = rendered(0.5, first), rendered(0.5 + 10 / 255, second)
    a.color[0], b.color[:, 0] = 1, 0
    assert difference(a, b) == pytest.approx(10, rel=1e-5)
    assert difference(a, a) == 0


def test_linear_premultiplied_pictures_become_straight_srgb():
    cover = np.array([[1.0, 0.5, 0.0]], np.float32)
    picture = Rendered.of_linear(0.25 * np.repeat(cover[..., None], 3, 2), cover)
    assert picture.color[0, :2] == pytest.approx(float(srgb_encode(np.array(0.25))), abs=1e-5)
    assert picture.on_white()[0, 2] == pytest.approx(1)


def test_the_report_has_all_pairs_and_a_sheet(tmp_path, capsys):
    cover = np.ones((8, 8), np.float32)
    report({name: rendered(level, cover) for name, level in (("a", 0.0), ("b", 0.2), ("c", 0.3))}, tmp_path)
    found = json.loads((tmp_path / "differences.json").read_text())
    assert found == pytest.approx({"a - b": 51, "a - c": 76.5, "b - c": 25.5}, rel=1e-4)
    assert "51.00 of 255" in capsys.readouterr().out
    assert read_ldr(tmp_path / "sheet.png")[0].shape == (16, 24, 3)
