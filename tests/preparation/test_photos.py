"""Which photos a folder holds, what their files tell, and what is refused."""

import numpy as np
import pytest
from PIL import Image

from lightprobe.core.errors import InputError
from lightprobe.imaging import write_exr, write_png
from lightprobe.preparation.looking import refuse_copies
from lightprobe.preparation.photos import copies, even_contrast, given_mask, source_photos, working_pictures


def write_noise(path, seed=0, shape=(30, 40), **options):
    path.parent.mkdir(parents=True, exist_ok=True)
    pixels = np.random.default_rng(seed).integers(0, 256, (*shape, 3), np.uint8)
    Image.fromarray(pixels).save(path, **options)


def test_photos_are_those_of_images_with_masks_beside_them(tmp_path):
    for seed in range(4):
        write_noise(tmp_path / "images" / f"{seed}.jpg", seed)
    write_png(tmp_path / "masks" / "2.png", np.ones((30, 40, 3)) * (np.arange(40) < 20)[:, None])
    photos = source_photos(tmp_path)
    assert [photo.name for photo in photos] == ["0", "1", "2", "3"]
    assert [photo.mask is not None for photo in photos] == [False, False, True, False]
    assert working_pictures(photos[2]).alpha.mean() == pytest.approx(0.5, abs=0.03)
    assert working_pictures(photos[1]).alpha is None


@pytest.mark.parametrize("scale", [0.002, 1.0, 200.0])
def test_radiance_in_any_unit_is_looked_at_alike(tmp_path, scale):
    light = np.random.default_rng(0).random((30, 40, 3)).astype(np.float32)
    for number in range(4):
        write_exr(tmp_path / f"{number}.exr", scale * np.roll(light, number, 1))
    small = np.zeros_like(light)
    small[10:12, 10:12] = light[:2, :2]  # less than a percent of the picture
    write_exr(tmp_path / "4.exr", scale * small)
    assert 100 < working_pictures(source_photos(tmp_path)[4]).color[10:12, 10:12].mean() < 250
    color = working_pictures(source_photos(tmp_path)[0]).color
    assert 150 < color.mean() < 210
    assert color.std() > 40


@pytest.mark.parametrize("orientation", [3, 6, 8])
def test_a_mask_without_a_tag_is_turned_with_its_photo(tmp_path, orientation):
    exif, turn = Image.Exif(), {3: 180, 6: 90, 8: 270}[orientation]
    exif[0x0112] = orientation
    for seed in range(4):
        write_noise(
            tmp_path / "images" / f"{seed}.jpg", seed, shape=(30, 40) if turn == 180 else (40, 30), exif=exif
        )
    upright = np.arange(40)[None] < 10 + np.zeros((30, 1))
    (tmp_path / "masks").mkdir()
    Image.fromarray(upright).rotate(turn, expand=True).save(tmp_path / "masks" / "0.png")
    photo = source_photos(tmp_path)[0]
    assert (photo.width, photo.height) == (40, 30)
    np.testing.assert_array_equal(given_mask(photo, (30, 40)), upright)


def test_scenes_and_runs_in_a_folder_hold_no_photos_of_it(tmp_path):
    for seed, name in enumerate(
        ["0", "1", "sub/2", "3", "scene/images/0", "run/report/a", "run/scene/images/4"]
    ):
        write_noise(tmp_path / f"{name}.jpg", seed)
    (tmp_path / "scene" / ".prepare").mkdir()
    (tmp_path / "run" / "config.json").write_text("{}")
    assert [photo.path.stem for photo in source_photos(tmp_path)] == ["0", "1", "3", "2"]


def test_too_few_photos_are_one_sentence(tmp_path):
    for seed in range(3):
        write_noise(tmp_path / f"{seed}.jpg", seed)
    with pytest.raises(InputError, match="holds 3 photos; cameras cannot be found from fewer than 4"):
        source_photos(tmp_path)


def test_copies_of_one_photo_are_one_sentence(tmp_path):
    for number in range(30):
        write_noise(tmp_path / f"{number:02d}.jpg", 0)
    photos = source_photos(tmp_path)
    assert copies(photos)["07"] == "00"
    with pytest.raises(InputError, match=r"Of 30 photos 29 are copies of others, such as 01 of 00"):
        refuse_copies(photos, 4)


def test_a_mask_of_another_shape_is_one_sentence(tmp_path):
    for seed in range(4):
        write_noise(tmp_path / "images" / f"{seed}.jpg", seed)
    write_png(tmp_path / "masks" / "2.png", np.ones((40, 30, 3)))
    with pytest.raises(InputError, match="is 30 x 40, but its photo 2"):
        working_pictures(source_photos(tmp_path)[2])


def test_a_cutout_brings_its_mask(tmp_path):
    alpha = (np.arange(40) < 10) * np.ones((30, 1))
    for number in range(4):
        write_png(tmp_path / f"{number}.png", np.full((30, 40, 3), 0.2 * (number + 1)), alpha)
    photos = source_photos(tmp_path)
    assert photos[0].cutout
    assert working_pictures(photos[0]).alpha.mean() == pytest.approx(0.25, abs=0.02)


def test_a_brighter_light_changes_nothing_that_features_see():
    luminance = np.random.default_rng(0).uniform(0.02, 0.4, (40, 40))
    one, other = (even_contrast(factor * luminance).astype(int) for factor in (1.0, 2.3))
    assert np.abs(one - other).max() <= 1
    assert one.std() > 20


def test_a_blurred_photo_is_less_sharp(tmp_path):
    from scipy.ndimage import gaussian_filter

    from lightprobe.preparation.photos import sharpness

    picture = np.random.default_rng(0).uniform(0, 255, (80, 80))
    assert sharpness(gaussian_filter(picture, 2)) < 0.5 * sharpness(picture)
