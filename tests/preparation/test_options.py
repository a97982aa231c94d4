"""A hint is a mask or a box in one photo; anything else is one sentence."""

import numpy as np
import pytest
from PIL import Image

from lightprobe.core.errors import ConfigError, InputError, LightprobeWarning
from lightprobe.imaging import write_mask, write_png
from lightprobe.preparation.options import STORED, all_hints, read_hint, store_hint, stored_hint
from lightprobe.preparation.photos import SourcePhoto


@pytest.fixture(scope="module")
def photos(tmp_path_factory):
    return stored(tmp_path_factory.mktemp("photos"), "IMG_1.jpg", "IMG_2.jpg")


def stored(folder, *files, orientation=1):
    """Return grey photos of 40 x 30, upright, as they are stored in a folder."""
    exif = Image.Exif()
    exif[0x0112] = orientation
    for file in files:
        (folder / file).parent.mkdir(exist_ok=True)
        Image.new("RGB", (40, 30) if orientation < 5 else (30, 40)).save(folder / file, exif=exif)
    return [
        SourcePhoto(file.replace("/", "_")[:-4], folder / file, 40, 30, file, None, None, False)
        for file in files
    ]


def test_a_box_is_a_mask(photos):
    index, mask = read_hint("IMG_2.jpg=5,10,15,30", photos)
    assert index == 1
    assert mask.shape == (30, 40)
    assert mask.sum() == 10 * 20
    assert mask[10:30, 5:15].all()


def test_a_mask_file_may_be_smaller_than_its_photo(photos, tmp_path):
    write_png(tmp_path / "m.png", np.ones((15, 20, 3)) * (np.arange(20) < 5)[:, None])
    index, mask = read_hint(f"IMG_1={tmp_path / 'm.png'}", photos)
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
        ("IMG_1.jpg=1,-5,20,20", "does not lie in IMG_1.jpg"),
    ],
)
def test_what_is_no_hint_is_one_sentence(photos, hint, words):
    with pytest.raises(ConfigError, match=words):
        read_hint(hint, photos)


def test_an_empty_mask_and_one_of_another_shape_are_one_sentence(photos, tmp_path):
    write_png(tmp_path / "black.png", np.zeros((30, 40, 3)))
    write_png(tmp_path / "tall.png", np.ones((40, 30, 3)))
    with pytest.raises(InputError, match="shows nothing"):
        read_hint(f"IMG_1={tmp_path / 'black.png'}", photos)
    with pytest.raises(InputError, match="30 x 40, but IMG_1"):
        read_hint(f"IMG_1={tmp_path / 'tall.png'}", photos)


def test_a_box_that_was_drawn_in_a_scene_is_a_hint(photos, tmp_path):
    assert stored_hint(tmp_path) is None
    store_hint(tmp_path, "IMG_2", (5.2, 9.9, 15, 30))
    assert stored_hint(tmp_path) == "IMG_2=5,10,15,30"
    assert read_hint(stored_hint(tmp_path), photos)[1].sum() == 10 * 20


@pytest.mark.parametrize(
    ("drawn", "areas"),
    [("IMG_1", {0: 8, 1: 200}), ("IMG_2", {1: 8})],
    ids=["beside the other", "in its place"],
)
def test_a_box_that_was_drawn_counts_beside_the_option(photos, tmp_path, drawn, areas):
    store_hint(tmp_path, drawn, (1, 1, 5, 3))
    hints = all_hints("IMG_2.jpg=5,10,15,30", tmp_path, photos)
    assert {index: mask.sum() for index, mask in hints.items()} == areas


def test_a_drawn_box_that_fits_no_photo_costs_no_other_hint(photos, tmp_path):
    store_hint(tmp_path, "IMG_9", (1, 1, 5, 3))
    with pytest.warns(LightprobeWarning, match=r"drawn in the scene is not used.*hint\.json.*IMG_9"):
        assert list(all_hints("IMG_2.jpg=5,10,15,30", tmp_path, photos)) == [1]
    with pytest.raises(ConfigError, match=r"hint\.json"):
        all_hints(None, tmp_path, photos)


@pytest.mark.parametrize(
    "text",
    [
        "[]",
        "{}",
        '{"photo": "a", "box": [1, 2, 3]}',
        '{"photo": "a", "box": [1, 2, 3, "/etc/x.png"]}',
        '{"photo": 7, "box": [1, 2, 3, 4]}',
    ],
)
def test_a_stored_hint_that_is_no_box_is_refused(tmp_path, text):
    (tmp_path / STORED).write_text(text)
    with pytest.raises(InputError, match="draw the box again"):
        stored_hint(tmp_path)


@pytest.mark.parametrize("numbers", ["1..2,4,50,60", ".,4,50,60", "1,2,3", "1,2,3,4,5", "1,2,3,4.5.6"])
def test_a_mistyped_box_is_one_sentence(photos, numbers):
    with pytest.raises(InputError, match=f"{numbers} does not exist"):
        read_hint(f"IMG_1.jpg={numbers}", photos)


def test_a_name_of_several_photos_needs_its_folder(tmp_path):
    photos = stored(tmp_path, "a/IMG_0.jpg", "b/IMG_0.jpg", "b/IMG_1.jpg")
    with pytest.raises(
        ConfigError, match=r"there are 2 photos .*; say which one: a/IMG_0\.jpg, b/IMG_0\.jpg"
    ):
        read_hint("IMG_0.jpg=5,10,15,30", photos)
    for name, index in (("a/IMG_0.jpg", 0), ("b/IMG_0", 1), ("b_IMG_0", 1), ("IMG_1", 2), ("b/IMG_1.jpg", 2)):
        assert read_hint(f"{name}=5,10,15,30", photos)[0] == index


@pytest.mark.parametrize("orientation", [3, 6])
def test_a_mask_file_is_turned_as_masks_of_a_scene_are(tmp_path, orientation):
    upright = (np.arange(30)[:, None] < 10) & (np.arange(40) < 10)
    photos = stored(tmp_path, "IMG_1.jpg", orientation=orientation)
    turn = {3: Image.Transpose.ROTATE_180, 6: Image.Transpose.ROTATE_90}[orientation]
    Image.fromarray(upright).transpose(turn).save(tmp_path / "untagged.png")
    write_mask(tmp_path / "tagged.png", upright.astype(np.float32))
    for mask in ("untagged.png", "tagged.png"):
        np.testing.assert_array_equal(read_hint(f"IMG_1={tmp_path / mask}", photos)[1], upright)
