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
