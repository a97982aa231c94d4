"""Masks drawn from a pose."""

import numpy as np

from lightprobe.localization.silhouette import inside_share, silhouette
from tests.painted_object import view_from


def test_the_mask_is_the_object_s_coverage(asset, camera, photo):
    mask = silhouette(asset, camera)
    assert mask.shape == photo[1].shape
    assert mask.dtype == np.float32
    assert np.abs(mask - photo[1]).mean() < 0.003
    assert 0 < ((mask > 0) & (mask < 1)).sum() < 400  # its rim is soft


def test_the_share_within_the_photo(asset):
    assert inside_share(asset, view_from((2.6, 0, 1))) == 1
    assert 0.2 < inside_share(asset, view_from((2.6, 0, 1), shift=1.0)) < 0.8
    assert inside_share(asset, view_from((2.6, 0, 1), shift=4.0)) == 0
