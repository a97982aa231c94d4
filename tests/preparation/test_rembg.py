"""rembg is asked where it is installed, and named where it is not."""

import sys
import types

import numpy as np
import pytest

from lightprobe.core.errors import ConfigError
from lightprobe.preparation.cutting import rembg_mask

COLOR = np.zeros((6, 8, 3), np.uint8)


def stand_in(monkeypatch, mask):
    def remove(picture, only_mask):
        assert only_mask
        assert picture.shape == COLOR.shape
        return mask

    monkeypatch.setitem(sys.modules, "rembg", types.SimpleNamespace(remove=remove))


def test_its_mask_is_taken(monkeypatch):
    mask = np.zeros((6, 8), np.uint8)
    mask[2:4, 3:5] = 255
    stand_in(monkeypatch, mask)
    assert np.array_equal(rembg_mask(COLOR), mask == 255)


def test_without_it_one_sentence_says_so(monkeypatch):
    monkeypatch.setitem(sys.modules, "rembg", None)
    with pytest.raises(ConfigError, match="pip install rembg"):
        rembg_mask(COLOR)


def test_something_else_than_a_mask_is_refused(monkeypatch):
    stand_in(monkeypatch, np.zeros((3, 3), np.uint8))
    with pytest.raises(ConfigError, match="no mask of the photo's size"):
        rembg_mask(COLOR)
