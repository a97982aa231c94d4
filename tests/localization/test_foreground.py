"""What stands in front of the object is not in its mask."""

import numpy as np

from lightprobe.localization.appearance import PhotoPyramid
from lightprobe.localization.foreground import hidden_share


def test_nothing_in_front_leaves_the_object_whole(known, camera, pyramid):
    assert hidden_share(known, pyramid, camera).max() == 0


def test_a_bar_in_front_is_found(known, camera, photo):
    color, cover = photo
    bar = np.zeros(cover.shape, bool)
    bar[60:75, 50:128] = True
    spoilt = color.copy()
    spoilt[bar] = (0.01, 0.25, 0.02)
    hidden = hidden_share(known, PhotoPyramid(spoilt), camera) > 0.5
    inside = cover > 0.5
    assert hidden[bar & inside].mean() > 0.75
    assert hidden[~bar & inside].mean() < 0.05
    assert not hidden[~inside & ~bar].any()
