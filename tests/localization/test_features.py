"""Features of a photo."""

import sys

import numpy as np
import pytest

from lightprobe.core.errors import ConfigError
from lightprobe.localization.features import find_features, load_opencv


def test_features_stay_inside_the_mask_and_under_their_number(photo):
    color, cover = photo
    every, some = find_features(color, 400), find_features(color, 20)
    assert len(some.place) == 20 < len(every.place)
    assert np.array_equal(some.descriptor, every.descriptor[:20])
    inside = find_features(color, 400, cover > 0.9)
    x, y = inside.place.astype(int).T
    assert len(inside.place) > 10
    assert (cover[y, x] > 0.9).all()
    assert inside.descriptor.dtype == np.uint8
    assert inside.descriptor.max() > 50


def test_places_are_those_of_the_photo_at_any_size(photo):
    color = photo[0]
    large = np.kron(color, np.ones((7, 7, 1), np.float32))  # is reduced, where the small one is magnified
    places = [find_features(c, 30).place / n for c, n in ((color, len(color)), (large, len(large)))]
    apart = np.linalg.norm(places[0][:, None] - places[1][None], axis=2).min(1)
    assert np.median(apart) < 0.01


def test_a_featureless_photo_has_none():
    assert find_features(np.full((40, 60, 3), 0.4, np.float32), 50).descriptor.shape == (0, 128)


def test_without_opencv_one_sentence_says_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "cv2", None)
    with pytest.raises(ConfigError, match=r"pip install 'lightprobe\[photos\]'"):
        load_opencv()
