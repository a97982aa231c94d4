"""What the report says of a preparation: masks that all lose the same part agree with their hull, not with
the hint.
"""

from types import SimpleNamespace

import numpy as np
import pytest

from lightprobe.core.errors import InputError
from lightprobe.core.files import write_json
from lightprobe.preparation.masks import Cutout, View
from lightprobe.preparation.output import _lost, _warnings, finished, hint_overlaps
from lightprobe.preparation.rounds import WRITTEN, Cutting
from tests.preparation.ring import SIZE, ball_points, photographed, ring_cameras


@pytest.mark.parametrize("content", ["[0]", "3", '"a"'])
def test_a_damaged_record_of_masks_is_one_sentence(tmp_path, content):
    (tmp_path / ".prepare").mkdir()
    (tmp_path / ".prepare" / WRITTEN).write_text(content)
    write_json(tmp_path / "prepare.json", {"key": "k"})
    write_json(tmp_path / "transforms.json", {})
    with pytest.raises(InputError, match=r"written\.json is damaged.*prepare the scene anew"):
        finished(tmp_path, "k")


def test_photos_of_another_reconstruction_are_told_from_photos_that_fit_nothing():
    photos = [SimpleNamespace(name=f"{i}.png", checksum=i) for i in range(5)]
    features, _, solution = photographed(ring_cameras(5), ball_points(120))
    seen = [SimpleNamespace(sharpness=1.0, features=each) for each in features]
    kept = SimpleNamespace(apart=((1, 2, 3), (3, 4)), solution=solution)
    choice = SimpleNamespace(kept=kept, trap=None)
    view = View(ring_cameras(1)[0], np.zeros((SIZE, SIZE, 3), np.uint8), None, False)
    cutting = Cutting(choice, {0: view, 1: view}, Cutout({}, {}, None, None), np.ones(5, np.int8))
    lost = _lost(photos, seen, {}, cutting)
    assert lost["2.png"].startswith("fits 1.png and 1 more, apart")
    assert lost["3.png"].startswith("fits 1.png and 1 more")  # the larger of its two
    assert lost["4.png"].startswith("fits 3.png, apart")
    warnings = _warnings(photos, cutting, SimpleNamespace(doubt=None), 1.0)
    assert next(text for text in warnings if "fit together" in text).startswith(
        "2 photos, such as 2.png, fit together"
    )


def test_a_found_mask_is_held_against_the_hint_that_it_came_from():
    hint, found = np.zeros((2, SIZE, SIZE), bool)
    hint[20:100, 40:80] = True
    found[60:100, 40:80] = True  # without the upper half
    views = {
        i: View(camera, np.zeros((SIZE, SIZE, 3), np.uint8), None, False)
        for i, camera in enumerate(ring_cameras(3))
    }
    views[1] = View(views[1].camera, views[1].color, hint, False)
    views[2] = View(views[2].camera, views[2].color, hint, True)  # given, not found: nothing to compare
    cutting = Cutting(None, views, Cutout(dict.fromkeys(views, found), {}, None, None), np.ones(3, np.int8))
    assert hint_overlaps(cutting) == {1: pytest.approx(0.5)}
