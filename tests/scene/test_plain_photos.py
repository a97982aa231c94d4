"""What is said of photos before cameras are sought; each finding by a folder that has it and nothing else."""

import numpy as np
import pytest
import scipy
from PIL import Image

from lightprobe.core.errors import InputError
from lightprobe.imaging import write_exr
from lightprobe.scene.frame import Problems
from lightprobe.scene.plain_photos import (
    copies,
    inspect_plain,
    is_plain,
    list_photos,
    measure_photo,
    measure_photos,
    sharpness,
    texture,
)
from tests.imaging.icc_profiles import P3_PRIMARIES, icc
from tests.imaging.videos import pan, write_video
from tests.scene.plain_world import save, take, view
from tests.scene.worlds import views, write_nerd


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


def said(found, kind, *words):
    """Assert that exactly one of the problems, hints or pieces of advice has all the words."""
    matching = [line for line in getattr(found, kind) if all(word in line for word in words)]
    assert len(matching) == 1, getattr(found, kind)


@pytest.mark.slow
def test_good_photos(tmp_path):
    for index in range(26):
        save(tmp_path / f"p{index}.jpg", view(index), exposure=1 / (30 * (1 + index)))
    found = inspect_plain(tmp_path)
    assert found.problems == found.hints == found.advice == []
    lines = found.lines()
    assert "readable 26, of which 26 differ and 0 are blurred" in lines
    assert "focal    0.75 to 0.75 of the longer side (26 of 26 photos)" in lines
    assert "no problems" in lines


def test_too_few(tmp_path):
    found = inspect_plain(take(tmp_path, 5))
    said(found, "problems", "5 different photos", "8 or more")
    said(found, "advice", "20 more photos")


@pytest.mark.slow
def test_rather_few(tmp_path):
    found = inspect_plain(take(tmp_path, 12))
    assert found.problems == []
    said(found, "advice", "13 more photos", "every 15 degrees")


@pytest.mark.slow
def test_many_copies_of_one(tmp_path):
    for index in range(30):
        save(tmp_path / f"p{index}.jpg", view(0))
    found = inspect_plain(tmp_path)
    said(found, "hints", "29 photos show the same", "copies add nothing")
    said(found, "problems", "1 different photo of")


@pytest.mark.slow
@pytest.mark.parametrize(("bad", "kind"), [(3, "hints"), (9, "problems")])
def test_blur(tmp_path, bad, kind):
    take(tmp_path, 12)
    for index in range(bad):
        save(tmp_path / f"p{index:02d}.jpg", scipy.ndimage.gaussian_filter(view(index), 9))
    found = inspect_plain(tmp_path)
    said(found, kind, f"{bad} of 12 photos are blurred", "p00.jpg")
    said(found, "advice", "at rest")


@pytest.mark.slow
def test_no_texture(tmp_path):
    for index in range(10):
        v, u = np.mgrid[:480, :640]
        save(
            tmp_path / f"p{index}.png",
            128 + 90 * np.sin((u + 60 * index) / 100) * np.cos((v + 40 * index) / 90),
        )
    said(inspect_plain(tmp_path), "problems", "10 of 10 photos", "without texture")
    said(inspect_plain(tmp_path), "advice", "newspaper")


def test_exposure(tmp_path):
    take(tmp_path, 10)
    save(tmp_path / "p03.jpg", view(3) * 2.2)
    save(tmp_path / "p04.jpg", view(4) * 0.01)
    found = inspect_plain(tmp_path)
    said(found, "hints", "1 of 10 photos is at white", "p03.jpg")
    said(found, "hints", "1 of 10 photos is as good as black", "p04.jpg")


def test_focal_lengths(tmp_path):
    take(tmp_path, 10)
    save(tmp_path / "p00.jpg", view(0), focal_35=None)
    save(tmp_path / "p05.jpg", view(5), focal_35=52)
    found = inspect_plain(tmp_path)
    said(found, "hints", "1 of 10 photos is without a focal length", "p00.jpg")
    said(found, "hints", "2 focal lengths, from 0.75 to 1.50")


@pytest.mark.slow
def test_one_light(tmp_path):
    said(inspect_plain(take(tmp_path, 26, exposure=1 / 60)), "advice", "under other lights")


def test_small_photos(tmp_path):
    for index in range(9):
        save(tmp_path / f"p{index}.jpg", view(index, (320, 240)))
    said(inspect_plain(tmp_path), "hints", "9 of 9 photos are of fewer than 640 pixels")


def test_profiles_are_facts_and_broken_files_problems(tmp_path):
    take(tmp_path, 10)
    Image.open(tmp_path / "p01.jpg").save(
        tmp_path / "p01.jpg", icc_profile=icc("Wide Thing", P3_PRIMARIES, 2.2)
    )
    (tmp_path / "p02.jpg").write_bytes(b"\xff\xd8\xff")
    found = inspect_plain(tmp_path)
    assert "colours  converted to sRGB: ICC profile Wide Thing (1)" in found.lines()
    said(found, "problems", "p02.jpg", "damaged")


def test_a_video(tmp_path):
    write_video(tmp_path / "a.mp4", pan(100))
    for path in (tmp_path / "a.mp4", tmp_path):
        assert is_plain(path)
        found = inspect_plain(path)
        assert found.problems == []
        said(found, "hints", "one light")
        assert any(line.startswith("frames   100, of which 60 would be used") for line in found.lines())
    write_video(tmp_path / "still.mp4", pan(1) * 40)
    said(inspect_plain(tmp_path / "still.mp4"), "problems", "1 different sharp frame of 40")
    (tmp_path / "cut.mp4").write_bytes((tmp_path / "a.mp4").read_bytes()[:3000])
    said(inspect_plain(tmp_path / "cut.mp4"), "problems", "cut.mp4", "damaged")


def test_what_is_plain(tmp_path):
    assert not is_plain(write_nerd(tmp_path / "scene", views(4)))
    assert is_plain(take(tmp_path / "photos", 2))
    (tmp_path / "empty").mkdir()
    assert not is_plain(tmp_path / "empty")
    assert not is_plain(tmp_path / "none")
    assert not is_plain(tmp_path / "photos" / "p00.jpg")
