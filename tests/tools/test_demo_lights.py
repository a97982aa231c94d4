import numpy as np
import pytest

from demo_scene.lights import (
    HEIGHT,
    PHOTOGRAPHED,
    Kind,
    directions,
    luminance,
    make_light,
    photographed_light,
    reduce_area,
    solid_angles,
)
from demo_scene.sky import sun_color
from demo_scene.studio import softbox


def test_directions_follow_the_written_convention():
    np.testing.assert_allclose(directions(128)[31, 63], [-0.008570, 0.698324, 0.715731], atol=1e-6)
    np.testing.assert_allclose(
        directions(64)[31:33, 63:65].mean(axis=(0, 1)), [1, 0, 0], atol=1e-2
    )  # the middle is +x
    assert 2 * 128 * solid_angles(128).sum() == pytest.approx(4 * np.pi, rel=1e-3)


@pytest.mark.slow
@pytest.mark.parametrize("kind", list(Kind))
def test_lights_are_positive_finite_and_reproducible(kind):
    first, again, other = make_light(kind, 1, 0), make_light(kind, 1, 0), make_light(kind, 1, 1)
    assert first.radiance.shape == (HEIGHT, 2 * HEIGHT, 3)
    assert np.isfinite(first.radiance).all()
    assert first.radiance.min() > 0
    assert np.array_equal(first.radiance, again.radiance)
    assert not np.allclose(first.radiance, other.radiance)


@pytest.mark.slow
def test_some_sun_is_thousands_of_times_brighter_than_its_sky():
    peaks = []
    for index in range(6):
        bright = luminance(make_light(Kind.OUTDOORS, 7, index).radiance)
        peaks.append(bright.max() / np.median(bright))
    assert max(peaks) > 1000


def test_the_sun_reddens_and_sets():
    noon, evening, night = (sun_color(np.radians(degrees), 1.0) for degrees in (60, 3, -3))
    assert noon[2] / noon[0] > 0.7
    assert evening[2] / evening[0] < 0.3
    assert evening.sum() < noon.sum()
    assert night.max() == 0


def test_reducing_keeps_the_power():
    radiance = np.random.default_rng(0).random((64, 128, 3))
    small = reduce_area(radiance, 4)
    fine_power = (radiance * np.sin(np.pi * (np.arange(64) + 0.5) / 64)[:, None, None]).sum() / 16
    row_weight = np.sin(np.pi * (np.arange(64) + 0.5) / 64).reshape(16, 4).mean(axis=1)
    assert (small * row_weight[:, None, None]).sum() == pytest.approx(fine_power)


def test_a_softbox_stands_where_it_is_put():
    toward = np.array([0.6, 0.64, 0.48])
    lamp = softbox(directions(128), toward, 0.3, (0.2, 0.2), False)
    center = (directions(128) * (lamp * solid_angles(128))[..., None]).sum(axis=(0, 1))
    np.testing.assert_allclose(center / np.linalg.norm(center), toward, atol=0.01)


@pytest.mark.parametrize("name", PHOTOGRAPHED)
def test_photographed_lights_are_turns_of_one_map(name):
    one, again, other = (photographed_light(name, 1, index) for index in (0, 0, 2))
    assert one.radiance.shape == (HEIGHT, 2 * HEIGHT, 3)
    assert np.isfinite(one.radiance).all()
    assert one.radiance.min() >= 0
    assert np.array_equal(one.radiance, again.radiance)
    turn = round((other.shift_degrees - one.shift_degrees) * HEIGHT / 180)
    assert turn != 0
    np.testing.assert_array_equal(np.roll(one.radiance, turn, axis=1), other.radiance)
