"""Textures are averaged in linear light, and what alpha hides keeps its colour where alpha cuts nothing out."""

import numpy as np
import pytest
from PIL import Image

from lightprobe.imaging import srgb_decode
from lightprobe.insertion.materials import _eight_bits, _levels


def texture(codes):
    return Image.fromarray(np.broadcast_to(np.asarray(codes, np.uint8), (8, 8, 4)).copy())


def test_colours_stay_where_alpha_is_none():
    for srgb in (True, False):
        for level in _levels(texture([180, 128, 60, 0]), srgb=srgb, cut=False):
            np.testing.assert_allclose(
                level[..., :3], [180, 128, 60] * np.ones((*level.shape[:2], 1)), atol=1
            )
            assert not level[..., 3].any()


def test_light_is_averaged_and_not_its_codes():
    board = np.indices((8, 8)).sum(0) % 2 * 255
    picture = Image.fromarray(np.dstack([board] * 3 + [np.full_like(board, 255)]).astype(np.uint8))
    last = _levels(picture, srgb=True, cut=False)[-1][0, 0]
    assert srgb_decode(np.float32(last[0] / 255)) == pytest.approx(0.5, abs=0.01)
    assert _levels(picture, srgb=False, cut=False)[-1][0, 0, 0] == pytest.approx(127.5, abs=1)


def test_what_is_cut_out_does_not_bleed_into_the_rest():
    codes = np.zeros((8, 8, 4), np.uint8)
    codes[:, ::2] = (200, 100, 50, 255)
    for level in _levels(Image.fromarray(codes), srgb=True, cut=True)[1:]:
        np.testing.assert_allclose(level[..., :3], [200, 100, 50] * np.ones((*level.shape[:2], 1)), atol=2)
        np.testing.assert_allclose(level[..., 3], 127.5, atol=1)


def test_grey_of_sixteen_bits_keeps_its_range():
    grey = Image.fromarray(np.full((4, 4), 30000, np.uint16))
    assert np.asarray(_eight_bits(grey))[0, 0].tolist() == [117, 117, 117, 255]
