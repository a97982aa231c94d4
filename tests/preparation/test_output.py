"""What the report says of a preparation: masks that all lose the same part agree with their hull, not with the hint."""

import numpy as np
import pytest

from lightprobe.preparation.masks import Cutout, View
from lightprobe.preparation.output import hint_overlaps
from lightprobe.preparation.rounds import Cutting
from tests.preparation.ring import SIZE, ring_cameras


def test_a_found_mask_is_held_against_the_hint_that_it_came_from():
    hint, found = np.zeros((2, SIZE, SIZE), bool)
    hint[20:100, 40:80] = True
    found[60:100, 40:80] = True  # without the upper half
    views = {
        i: View(camera, np.zeros((SIZE, SIZE, 3), np.uint8), None, False) for i, camera in enumerate(ring_cameras(3))
    }
    views[1] = View(views[1].camera, views[1].color, hint, False)
    views[2] = View(views[2].camera, views[2].color, hint, True)  # given, not found: nothing to compare
    cutting = Cutting(None, views, Cutout(dict.fromkeys(views, found), {}, None, None), np.ones(3, np.int8))
    assert hint_overlaps(cutting) == {1: pytest.approx(0.5)}
