"""Which mask is whose, masks that show no background, masks of turned photos, and colours that are not sRGB."""

import json
import shutil
import warnings

import numpy as np
import pytest
from PIL import Image

from lightprobe.core.errors import InputError, LightprobeWarning
from lightprobe.imaging import write_mask
from lightprobe.scene import load_alpha, load_photo, load_scene
from lightprobe.scene.inspect import inspect
from lightprobe.scene.masks import MaskFolder
from tests.imaging.icc_profiles import P3_PRIMARIES, icc, own_srgb
from tests.scene.worlds import (
    expected_camera,
    names,
    picture,
    views,
    write_blender,
    write_nerd,
    write_nerfstudio,
)

COUNT = 18


@pytest.fixture
def blender(tmp_path):
    """A Blender scene with opaque photos, train/r_0.png to r_14.png and test/r_0.png to r_2.png, and no masks
    yet.
    """
    root = write_blender(tmp_path / "scene", views(COUNT))
    for i, view in enumerate(views(COUNT)):
        split, number = ("train", i) if i < 15 else ("test", i - 15)
        color, mask = picture(view)
        Image.fromarray(color).save(root / split / f"r_{number}.png")
        (root / "apart" / split).mkdir(parents=True, exist_ok=True)
        Image.fromarray(mask).save(root / "apart" / split / f"r_{number}.png")
    return root


@pytest.mark.slow
def test_a_mask_that_two_photos_would_share_is_refused(blender):
    shutil.copytree(blender / "apart" / "train", blender / "masks")
    pattern = r"masks/r_0\.png could be the mask of 2 photos named r_0, .*masks/(train|test)/r_0\.png"
    with pytest.raises(InputError, match=pattern):
        load_scene(blender)
    assert sum("could be the mask of 2 photos" in problem for problem in inspect(blender).problems) == 6


def test_masks_in_folders_like_the_photos(blender):
    shutil.copytree(blender / "apart", blender / "masks")
    scene = load_scene(blender)
    for photo, view in zip(scene.train + scene.test, sorted_views(scene), strict=True):
        np.testing.assert_array_equal(load_alpha(photo), picture(view)[1] / 255)


def sorted_views(scene):
    """The views of a scene's photos in its order: r_0, r_1, r_10, ..."""
    shots = views(COUNT)
    train = [shots[int(photo.image_path.stem[2:])] for photo in scene.train]
    return train + [shots[15 + int(photo.image_path.stem[2:])] for photo in scene.test]


def test_a_bare_name_serves_the_only_photo_that_needs_it(blender):
    """Three test photos have masks at their own place; the others of these names are then meant by the bare
    names.
    """
    shutil.copytree(blender / "apart" / "train", blender / "masks")
    shutil.copytree(blender / "apart" / "test", blender / "masks" / "test")
    scene = load_scene(blender)
    assert all(photo.mask_path.parent.name == "masks" for photo in scene.train)
    assert all(photo.mask_path.parent.name == "test" for photo in scene.test)


def whiten(root, chosen):
    for name in chosen:
        Image.new("L", (72, 60), 255).save(root / "masks" / f"{name}.png")


@pytest.mark.slow
def test_masks_without_background_are_a_problem(tmp_path):
    root = write_nerd(tmp_path / "scene", views(COUNT))
    whiten(root, names(COUNT))
    with pytest.raises(InputError, match=r"18 of 18 masks show no background, such as that of view_01"):
        load_scene(root)
    assert any("18 of 18 masks show no background" in problem for problem in inspect(root).problems)


@pytest.mark.slow
def test_a_few_masks_without_background_are_warned_of(tmp_path):
    root = write_nerd(tmp_path / "scene", views(COUNT))
    whiten(root, ["view_03", "view_07"])
    with pytest.warns(LightprobeWarning, match=r"2 of 18 masks show no background, such as that of view_03"):
        load_scene(root)
    assert any("2 of 18 masks show no background" in problem for problem in inspect(root).problems)


def orient(path, orientation, *, turn=None):
    """Give a JPEG an EXIF orientation, its pixels stored so that it is displayed as before."""
    exif, image = Image.Exif(), Image.open(path)
    exif[0x0112] = orientation
    image = image.transpose(turn) if turn is not None else image
    image.save(path, exif=exif, quality=98, subsampling=0)


@pytest.mark.slow
@pytest.mark.parametrize("orientation", [3, 6])
def test_a_mask_without_a_tag_is_turned_with_its_photo(tmp_path, orientation):
    """The mask was drawn on the stored pixels by a program that knows no EXIF; a half turn leaves its size
    the same.
    """
    root = write_nerfstudio(tmp_path / "scene", views(COUNT))
    turn = {3: Image.Transpose.ROTATE_180, 6: Image.Transpose.ROTATE_90}[orientation]
    orient(root / "images" / "view_01.jpg", orientation, turn=turn)
    mask = root / "masks" / "view_01.png"
    Image.open(mask).transpose(turn).save(mask)
    photo = next(photo for photo in load_scene(root).train if photo.name == "view_01")
    np.testing.assert_array_equal(load_alpha(photo), picture(views(COUNT)[1])[1] / 255)
    assert inspect(root).hints == ()


@pytest.mark.parametrize("orientation", [3, 6])
def test_a_mask_of_ours_is_upright(tmp_path, orientation):
    """As `prepare` and `locate` write them beside photos that they copy or leave as they are."""
    root = write_nerfstudio(tmp_path / "scene", views(COUNT))
    turn = {3: Image.Transpose.ROTATE_180, 6: Image.Transpose.ROTATE_90}[orientation]
    orient(root / "images" / "view_01.jpg", orientation, turn=turn)
    upright = picture(views(COUNT)[1])[1] / 255
    write_mask(root / "masks" / "view_01.png", upright)
    photo = next(photo for photo in load_scene(root).train if photo.name == "view_01")
    np.testing.assert_allclose(load_alpha(photo), upright, atol=1 / 255)


def test_a_mask_with_a_tag_follows_it(tmp_path):
    root = write_nerfstudio(tmp_path / "scene", views(COUNT))
    orient(root / "images" / "view_01.jpg", 3, turn=Image.Transpose.ROTATE_180)
    exif = Image.Exif()
    exif[0x0112] = 1
    mask = root / "masks" / "view_01.png"
    Image.open(mask).save(mask, exif=exif)
    photo = next(photo for photo in load_scene(root).train if photo.name == "view_01")
    np.testing.assert_array_equal(load_alpha(photo), picture(views(COUNT)[1])[1] / 255)


@pytest.mark.slow
@pytest.mark.parametrize("turned", ["mask", "camera"])
def test_the_hull_names_the_photo_that_fits_only_when_turned(tmp_path, turned):
    """An upright mask beside a tagged photo, or a camera estimated on the stored pixels: only the hull tells."""
    root = write_nerfstudio(tmp_path / "scene", views(COUNT, zoom=1.3))
    photo, mask = root / "images" / "view_05.jpg", root / "masks" / "view_05.png"
    half = Image.Transpose.ROTATE_180
    if turned == "mask":
        orient(photo, 3, turn=half)
    else:
        orient(photo, 3)
    hints = inspect(root).hints
    assert len(hints) == 1
    subject = {
        "mask": "The masks of 1 of 18 photos (view_05) are upright",
        "camera": "The cameras of 1 of 18 photos",
    }
    assert hints[0].startswith(subject[turned])
    assert mask.exists()


def with_profile(root, chosen, profile):
    for name in chosen:
        path = root / "images" / f"{name}.png"
        Image.open(path).save(path, icc_profile=profile)


@pytest.mark.slow
def test_an_unreadable_profile_is_a_problem_and_one_warning(tmp_path):
    root = write_nerd(tmp_path / "scene", views(COUNT))
    with_profile(root, names(COUNT)[2:6], b"nonsense" * 40)
    sentence = r"4 of 18 photos are encoded with an ICC profile that cannot be read, such as view_02\.png"
    with pytest.warns(LightprobeWarning, match=sentence) as caught:
        load_scene(root)
    assert len(caught) == 1
    (problem,) = inspect(root).problems
    assert "4 of 18 photos" in problem


@pytest.mark.slow
def test_a_converted_profile_is_a_fact(tmp_path):
    root = write_nerd(tmp_path / "scene", views(COUNT))
    with_profile(root, names(COUNT)[2:6], icc("Wide Thing", P3_PRIMARIES, 2.2))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        load_scene(root)
    found = inspect(root)
    assert found.problems == ()
    assert "colours  converted to sRGB: ICC profile Wide Thing (4)" in found.lines()


@pytest.mark.slow
def test_an_srgb_profile_is_silent(tmp_path):
    root = write_nerd(tmp_path / "scene", views(COUNT))
    with_profile(root, names(COUNT), own_srgb())
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        load_scene(root)
    assert inspect(root).problems == ()


def test_a_new_photo_with_an_unreadable_profile(tmp_path):
    root = write_nerd(tmp_path / "scene", views(4))
    with_profile(root, ["view_01"], b"nonsense" * 40)
    (tmp_path / "c.json").write_text(json.dumps(expected_camera(views(4)[1]).to_json()))
    with pytest.warns(LightprobeWarning, match="an ICC profile that cannot be read"):
        load_photo(root / "images" / "view_01.png", tmp_path / "c.json", root / "masks" / "view_01.png")


# Photos and masks that could be each other's


def pairs(root, photos, masks):
    """Write photos and masks; return which mask each photo gets, by its path below `masks/`."""
    for number, name in enumerate((*photos, *masks)):
        place = root / ("images" if number < len(photos) else "masks") / name
        place.parent.mkdir(parents=True, exist_ok=True)
        Image.new("L", (30, 20)).save(place)
    files = [root / "images" / name for name in photos]
    folder = MaskFolder(root, files)
    return [mask and mask.relative_to(root / "masks").as_posix() for mask in map(folder.find, files)]


@pytest.mark.parametrize(
    ("photos", "masks", "expected"),
    [
        (["p.png", "p.jpg"], ["p.png.png", "p.jpg.png"], ["p.png.png", "p.jpg.png"]),
        (["p.png", "p.jpg"], ["p.png", "p.jpg"], ["p.png", "p.jpg"]),
        (["p.png", "p.jpg"], ["p.png", "p.jpg.png"], ["p.png", "p.jpg.png"]),
        (["p.png", "q.jpg"], ["p.png"], ["p.png", None]),
        (["p.png"], ["p.png", "p.jpg"], ["p.png"]),
        (["a/p.png", "b/p.png"], ["a/p.png", "b/p.png"], ["a/p.png", "b/p.png"]),
        (["IMG_1.JPG", "IMG_2.JPG"], ["img_1.png", "IMG_2.jpg.png"], ["img_1.png", "IMG_2.jpg.png"]),
        (["p.png", "P.png"], ["p.png", "P.png"], ["p.png", "P.png"]),
        (["\u00fc.png"], ["u\u0308.png"], ["u\u0308.png"]),
        (["p.q.png", "p.jpg"], ["p.q.png"], ["p.q.png", None]),
    ],
)
def test_masks_of_photos_of_like_names(tmp_path, photos, masks, expected):
    assert pairs(tmp_path, photos, masks) == expected


@pytest.mark.parametrize(
    ("photos", "masks", "said"),
    [
        (
            ["p.jpg", "p.png"],
            ["p.png"],
            r"masks/p\.png could be the mask of 2 photos .* in .*/masks/p\.jpg\.png",
        ),
        (["p.jpg", "p.png"], ["p.webp"], r"p\.webp could be the mask of 2 photos named p"),
        (
            ["p.webp"],
            ["p.png", "p.jpg"],
            r"p\.jpg and .*p\.png could both be the mask of .*p\.webp; remove one",
        ),
        (["p.jpg", "P.jpg"], ["p.png"], r"could be the mask of 2 photos named p"),
        (
            ["p.png", "left/p.png"],
            ["p.png"],
            r"could be the mask of 2 photos .*give each photo a mask of its own",
        ),
        (
            ["a/p.png", "b/p.png"],
            ["p.png"],
            r"could be the mask of 2 photos named p, .* in .*/masks/a/p\.png",
        ),
    ],
)
def test_masks_that_several_photos_would_share_and_several_masks_of_a_photo(tmp_path, photos, masks, said):
    with pytest.raises(InputError, match=said) as caught:
        pairs(tmp_path, photos, masks)
    assert str(caught.value).endswith(".")


def test_a_folder_of_masks_in_capitals(tmp_path):
    pairs(tmp_path, ["p.png"], ["p.png"])
    (tmp_path / "masks").rename(tmp_path / "Masks")
    image = tmp_path / "images/p.png"
    assert MaskFolder(tmp_path, [image]).find(image) == tmp_path / "Masks/p.png"
