import numpy as np

from lightprobe.evaluation.views import halves


def test_halves_split_the_object_evenly_and_completely():
    alpha = np.zeros((20, 30), np.float32)
    alpha[3:15, 4:9] = 1
    alpha[10:12, 9:28] = 0.8
    inside = alpha > 0.5
    masks = halves(alpha)
    assert len(masks) == 4
    for first, second in (masks[:2], masks[2:]):
        assert np.array_equal(first | second, inside)
        assert not (first & second).any()
        assert 0.25 < first.sum() / inside.sum() < 0.75
    left, right, above, below = masks
    assert np.nonzero(left)[1].max() < np.nonzero(right)[1].min() + 1
    assert np.nonzero(above)[0].max() < np.nonzero(below)[0].min() + 1
