"""A hint is a mask or a box in one photo; anything else is one sentence."""

from pathlib import Path

import numpy as np
import pytest

from lightprobe.core.errors import ConfigError, InputError
from lightprobe.imaging import write_png
from lightprobe.preparation.hints import STORED, read_hint, store_hint, stored_hint
from lightprobe.preparation.photos import SourcePhoto

PHOTOS = [SourcePhoto(n, Path(f"/x/{n}.jpg"), 40, 30, n, None, None, False) for n in ("IMG_1", "IMG_2")]


def test_a_box_is_a_mask():
    index, mask = read_hint("IMG_2.jpg=5,10,15,30", PHOTOS)
    assert index == 1
    assert mask.shape == (30, 40)
    assert mask.sum() == 10 * 20
    assert mask[10:30, 5:15].all()


def test_a_mask_file_may_be_smaller_than_its_photo(tmp_path):
    write_png(tmp_path / "m.png", np.ones((15, 20, 3)) * (np.arange(20) < 5)[:, None])
    index, mask = read_hint(f"IMG_1={tmp_path / 'm.png'}", PHOTOS)
    assert index == 0
    assert mask.shape == (30, 40)
    assert (mask[:, :9] > 0.9).all()
    assert (mask[:, 11:] < 0.1).all()


@pytest.mark.parametrize(
    ("hint", "words"),
    [
        ("IMG_2.jpg", "write PHOTO=MASK.png"),
        ("IMG_9.jpg=1,2,3,4", "there is no photo 'IMG_9.jpg'"),
        ("IMG_1.jpg=10,10,5,20", "does not lie in IMG_1.jpg"),
        ("IMG_1.jpg=0,0,50,20", "which is 40 x 30"),
    ],
)
def test_what_is_no_hint_is_one_sentence(hint, words):
    with pytest.raises(ConfigError, match=words):
        read_hint(hint, PHOTOS)


def test_an_empty_mask_and_one_of_another_shape_are_one_sentence(tmp_path):
    write_png(tmp_path / "black.png", np.zeros((30, 40, 3)))
    write_png(tmp_path / "tall.png", np.ones((40, 30, 3)))
    with pytest.raises(InputError, match="shows nothing"):
        read_hint(f"IMG_1={tmp_path / 'black.png'}", PHOTOS)
    with pytest.raises(InputError, match="30 x 40, but IMG_1"):
        read_hint(f"IMG_1={tmp_path / 'tall.png'}", PHOTOS)


def test_a_box_that_was_drawn_in_a_scene_is_a_hint(tmp_path):
    assert stored_hint(tmp_path) is None
    store_hint(tmp_path, "IMG_2", (5.2, 9.9, 15, 30))
    assert stored_hint(tmp_path) == "IMG_2=5,10,15,30"
    assert read_hint(stored_hint(tmp_path), PHOTOS)[1].sum() == 10 * 20


@pytest.mark.parametrize(
    "text", ["[]", "{}", '{"photo": "a", "box": [1, 2, 3]}', '{"photo": "a", "box": [1, 2, 3, "/etc/x.png"]}',
             '{"photo": 7, "box": [1, 2, 3, 4]}']
)  # fmt: skip
def test_a_stored_hint_that_is_no_box_is_refused(tmp_path, text):
    (tmp_path / STORED).write_text(text)
    with pytest.raises(InputError, match="draw the box again"):
        stored_hint(tmp_path)
