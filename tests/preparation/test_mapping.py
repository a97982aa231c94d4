"""Structure from motion on features whose cameras are known."""

import numpy as np
import pytest

from lightprobe.preparation.mapping import Lenses, reconstruct
from tests.preparation.ring import SIZE, ball_points, photographed, ring_cameras

pytest.importorskip("pycolmap")
PHOTOS, POINTS = 6, 90
TRUE = 300.0  # pixels, of `ring_cameras`


def test_photos_whose_files_tell_absurd_lengths_share_the_middle_one():
    """One length far off, as digital zoom writes it, must not lose the photos that tell nothing."""
    cameras = [ring_cameras(24, 0.8 + 0.3 * (i % 2))[i] for i in range(PHOTOS)]
    photos, matches, _ = photographed(cameras, ball_points(POINTS))
    rows = next(iter(matches.values()))
    pairs = {(i, j): rows for i in range(PHOTOS) for j in range(i + 1, PHOTOS)}
    told = [65.0, 1.45, None, 1.55, 0.33, None]
    models = reconstruct(photos, pairs, told, Lenses.BY_SIZE)
    assert list(models[0].photo) == list(range(PHOTOS))
    assert np.ptp(models[0].lens[:, 0]) == 0
    assert models[0].lens[0, 0] == pytest.approx(TRUE, rel=0.02)
    assert models[0].errors.mean() < 0.01 * SIZE
