import numpy as np
import pytest

from lightprobe.prediction.color_scale import RANGE, TICKS, confidence_colors, css_gradient, ticks

LUMA = np.array([0.2126, 0.7152, 0.0722])


def test_colors_brighten_over_the_range_and_stay_at_its_ends():
    values = np.linspace(0, 1, 101)
    luma = confidence_colors(values) @ LUMA
    inside = (values >= RANGE[0]) & (values <= RANGE[1])
    assert (np.diff(luma[inside]) > 0.005).all()
    assert (luma[values < RANGE[0]] == luma[inside][0]).all()
    assert np.ptp(luma) > 0.6


def test_a_confidence_has_the_same_color_in_every_picture():
    alone, beside = confidence_colors(np.full((2, 4), 0.45)), confidence_colors(np.array([[0.3, 0.45, 0.5]]))
    assert alone.shape == (2, 4, 3)
    assert alone[0, 0] == pytest.approx(beside[0, 1])


def test_the_bar_has_the_pictures_colors():
    stops = [
        f"#{''.join(f'{round(255 * c):02x}' for c in color)}" for color in confidence_colors(np.array(TICKS))
    ]
    assert css_gradient() == f"linear-gradient(to right, {', '.join(stops)})"


def test_ticks_stand_where_their_colors_are_and_name_the_factor():
    assert [place for place, _, _ in ticks()] == pytest.approx([0, 0.25, 0.5, 0.75, 1])
    assert [words for _, *words in ticks()] == [
        ["≤ 0.3", "≥ ×3.3"],
        ["0.4", "×2.5"],
        ["0.5", "×2"],
        ["0.6", "×1.7"],
        ["0.7", "×1.4"],
    ]
