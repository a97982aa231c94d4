"""Photos are looked at once, in batches, and what was kept is taken again."""

import numpy as np
import pytest
from PIL import Image

from lightprobe.preparation import looking
from lightprobe.preparation.cache import Cache
from lightprobe.preparation.looking import look_at_all
from lightprobe.preparation.photos import source_photos

pytest.importorskip("pycolmap")


@pytest.fixture
def photos(tmp_path):
    folder, rng = tmp_path / "photos", np.random.default_rng(0)
    folder.mkdir()
    for index in range(5):
        noise = rng.integers(0, 256, (12, 16, 3), np.uint8)
        Image.fromarray(np.kron(noise, np.ones((8, 8, 1), np.uint8))).save(folder / f"{index}.png")
    return source_photos(folder)


def test_what_one_batch_found_is_kept_when_the_next_one_fails(photos, tmp_path, monkeypatch):
    monkeypatch.setattr(looking, "_BATCH", 2)
    cache, decoded, told = Cache(tmp_path), [], []
    read = looking.working_pictures

    def reading(photo):
        if len(decoded) == 3:
            raise KeyboardInterrupt
        decoded.append(photo.name)
        return read(photo)

    monkeypatch.setattr(looking, "working_pictures", reading)
    with pytest.raises(KeyboardInterrupt):
        look_at_all(photos, cache)
    monkeypatch.setattr(looking, "working_pictures", lambda photo: decoded.append(photo.name) or read(photo))
    decoded.clear()
    first = look_at_all(photos, cache, lambda *step: told.append(step))
    assert decoded == ["2", "3", "4"]
    assert told == [(2, 5), (4, 5), (5, 5)]
    again = look_at_all(photos, cache, lambda *step: told.append(step))
    assert told[3:] == [(5, 5)]
    assert len(decoded) == 3
    for one, other in zip(first, again, strict=True):
        assert len(one.features.points) > 20
        assert np.array_equal(one.features.points, other.features.points)
        assert np.array_equal(one.color, other.color)
        assert one.color.shape == (96, 128, 3)


def test_features_do_not_depend_on_the_batch(photos, tmp_path, monkeypatch):
    together = look_at_all(photos, Cache(tmp_path / "a"))
    monkeypatch.setattr(looking, "_BATCH", 1)
    for one, other in zip(together, look_at_all(photos, Cache(tmp_path / "b")), strict=True):
        assert np.array_equal(one.features.points, other.features.points)
        assert np.array_equal(one.features.descriptors, other.features.descriptors)


def test_the_detail_is_a_square_around_the_largest_piece_with_a_margin_inside_the_picture():
    mask = np.zeros((60, 80), bool)
    mask[20:40, 30:40] = True
    mask[0:3, 70:73] = True  # a speck
    assert looking._around(mask, (120, 160)) == (44, 96, 34, 86)
    mask[20:60, 0:40] = True
    assert looking._around(mask, (120, 160)) == (0, 92, 28, 120)
    assert looking._around(np.zeros((60, 80), bool), (120, 160)) is None


def test_features_of_the_detail_lie_around_the_mask_that_is_given(tmp_path):
    if not looking.learned.is_installed():
        pytest.skip("the weights of learned features are not installed")
    folder, rng = tmp_path / "photos", np.random.default_rng(0)
    (folder / "masks").mkdir(parents=True)
    for index in range(4):
        noise = np.kron(rng.integers(0, 256, (24, 32, 3), np.uint8), np.ones((8, 8, 1), np.uint8))
        Image.fromarray(noise).save(folder / f"{index}.png")
        mask = np.zeros((192, 256), np.uint8)
        mask[64:128, 100:160] = 255
        Image.fromarray(mask).save(folder / "masks" / f"{index}.png")
    for each in look_at_all(source_photos(folder), Cache(tmp_path)):
        left, right, top, bottom = each.features.box
        assert (left, right, top, bottom) == (88, 172, 54, 138)
        x, y = each.features.points[each.features.close].T
        assert len(x) > 20
        assert ((x >= left) & (x <= right) & (y >= top) & (y <= bottom)).all()
