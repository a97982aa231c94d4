import numpy as np
import pytest
import scipy
from PIL import Image

from lightprobe.core.errors import InputError
from lightprobe.imaging import write_exr
from lightprobe.scene.frame import Problems
from lightprobe.scene.plain_photos import (
    copies,
    list_photos,
    measure_photo,
    measure_photos,
    sharpness,
    texture,
)
from tests.scene.plain_world import save, take, view


def motion(grey):
    return scipy.ndimage.uniform_filter1d(grey, 15, axis=1)


def test_blur_takes_sharpness_away():
    for index in range(0, 40, 10):
        sharp = view(index)
        noise = np.random.default_rng(index).normal(0, 2, sharp.shape)
        order = [sharpness(scipy.ndimage.gaussian_filter(sharp, sigma) + noise / 4) for sigma in (0, 2, 4)]
        assert order[0] > 1.2 * order[1] > 1.4 * order[2]
        assert sharpness(motion(sharp)) < 0.75 * order[0]
        assert sharpness(motion(sharp).T) == pytest.approx(sharpness(motion(sharp)))
        assert sharpness(0.4 * sharp) == pytest.approx(sharpness(sharp))


def test_texture_is_corners_and_neither_edges_nor_noise():
    v, u = np.mgrid[:480, :640]
    assert texture(view(0)) > 0.5
    assert texture(np.ones((1, 40))) == 0
    assert texture(128 + 60 * np.sin(u / 90)) == 0
    assert texture(128.0 + 60 * (u // 40 % 2)) == 0
    assert texture(np.random.default_rng(0).normal(128, 10, (480, 640))) == 0
    assert texture(128.0 + 60 * ((u // 40 + v // 40) % 2)) > 0.05
    assert texture(np.zeros((10, 12))) == 0


def test_what_is_measured_on_a_photo(tmp_path):
    grey = np.clip(view(0), 20, 230)
    grey[:48], grey[48:144] = 255, 0
    save(tmp_path / "a.jpg", grey, exposure=1 / 125)
    photo = measure_photo(tmp_path / "a.jpg")
    assert (photo.width, photo.height) == (640, 480)
    assert photo.focal == pytest.approx(26 / 34.61, rel=1e-3)
    assert photo.ev100 == pytest.approx(np.log2(16 * 125))
    assert photo.clipped == pytest.approx(0.1, abs=0.01)
    assert photo.dark == pytest.approx(0.2, abs=0.02)
    assert photo.thumbnail.shape == (36, 48)
    assert photo.encoding is None
    assert photo.up is None


def test_a_linear_photo_is_measured_like_any_other(tmp_path):
    save(tmp_path / "a.png", view(0))
    write_exr(tmp_path / "a.exr", np.dstack([40 * (view(0) / 255) ** 2.2] * 3))
    first, second = measure_photo(tmp_path / "a.png"), measure_photo(tmp_path / "a.exr")
    assert second.sharpness == pytest.approx(first.sharpness, abs=0.05)
    assert second.texture > 0.5
    assert second.clipped == 0


def test_copies_are_found_however_they_are_stored(tmp_path):
    take(tmp_path, 4)
    Image.open(tmp_path / "p01.jpg").save(tmp_path / "x.jpg", quality=40)
    Image.open(tmp_path / "p02.jpg").point(lambda value: value * 0.7).save(tmp_path / "y.png")
    photos = measure_photos(sorted(tmp_path.iterdir()), Problems())
    assert [photo.path.name for photo in copies(photos)] == ["x.jpg", "y.png"]


@pytest.mark.slow
def test_the_same_object_a_little_turned_is_no_copy(tmp_path):
    take(tmp_path, 12)
    assert copies(measure_photos(sorted(tmp_path.iterdir()), Problems())) == []


def test_one_of_a_raw_file_and_its_picture(tmp_path):
    for name in (
        "a.jpg",
        "a.DNG",
        "b.jpg",
        "sub/c.heic",
        "sub/c.cr3",
        "masks/a.png",
        ".hidden.jpg",
        "notes.txt",
    ):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_bytes(b"")
    names = [path.relative_to(tmp_path).as_posix() for path in list_photos(tmp_path)]
    assert names == ["a.DNG", "b.jpg", "sub/c.cr3"]
    (tmp_path / "images").mkdir()
    (tmp_path / "images" / "d.tif").write_bytes(b"")
    assert [path.name for path in list_photos(tmp_path)] == ["d.tif"]


def test_a_broken_photo_does_not_stop_the_others(tmp_path):
    take(tmp_path, 3)
    (tmp_path / "p01.jpg").write_bytes(b"\xff\xd8\xff\xe0 no more")
    problems = Problems(collect=True)
    assert len(measure_photos(sorted(tmp_path.iterdir()), problems)) == 2
    assert len(problems.messages) == 1
    assert "p01.jpg" in problems.messages[0]
    with pytest.raises(InputError, match=r"p01\.jpg"):
        measure_photos(sorted(tmp_path.iterdir()), Problems())
