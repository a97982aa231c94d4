"""Masks and boxes that are drawn go into their scene, and nowhere else."""

import json

import numpy as np
import pytest
from PIL import Image

from lightprobe.core.errors import ConfigError, InputError
from lightprobe.imaging import read_mask, write_png
from lightprobe.scene.masks import mask_turn
from lightprobe.view.scenes import mask_picture, save_box, save_mask
from lightprobe.view.sources import Sources
from tests.web.answers import sentence


@pytest.fixture
def prepared(tmp_path):
    folder = tmp_path / "cup"
    write_png(folder / "images" / "a.png", np.full((30, 40, 3), 0.5, np.float32))
    (folder / "prepare.json").write_text(
        json.dumps({"mask_stability": {"a": 0.7}, "doubtful_masks": ["a"], "warnings": ["Look.", 7]})
    )
    return Sources.of([folder]).scenes[0]


def painted(path, height, width, share=0.5):
    mask = np.zeros((height, width, 3), np.float32)
    mask[:, : round(share * width)] = 1
    write_png(path, mask, srgb=False)
    return path


def test_a_painted_mask_is_written_at_the_size_of_its_photo(prepared, tmp_path):
    assert mask_picture(prepared, 0).startswith(b"\x89PNG")
    written = save_mask(prepared, 0, painted(tmp_path / "p.png", 60, 80))
    assert written == prepared.folder / "masks" / "a.png"
    mask = read_mask(written)
    assert mask.shape == (30, 40)
    assert mask[:, :19].min() > 0.95
    assert mask[:, 21:].max() < 0.05
    about = prepared.to_json()
    assert about["photos"] == [
        {"name": "a", "file": "a.png", "stability": 0.7, "doubtful": True, "corrected": False}
    ]
    assert about["warnings"] == ["Look."]


def test_the_mask_of_a_photo_that_is_stored_turned_is_upright_in_training_too(prepared, tmp_path):
    photo, exif = prepared.folder / "images" / "a.png", Image.Exif()
    exif[0x0112] = 3
    Image.new("RGB", (40, 30)).save(photo, exif=exif)
    written = save_mask(prepared, 0, painted(tmp_path / "p.png", 60, 80))
    assert mask_turn(written, photo, (40, 30)) == 1


@pytest.mark.parametrize(
    ("size", "share", "words"), [((60, 60), 0.5, "but the photo is 40 x 30"), ((60, 80), 0, "no object")]
)
def test_a_mask_that_cannot_be_meant_is_refused(prepared, tmp_path, size, share, words):
    with pytest.raises(InputError, match=words):
        save_mask(prepared, 0, painted(tmp_path / "p.png", *size, share))
    assert not (prepared.folder / "masks").exists()


def test_a_folder_of_masks_that_lies_elsewhere_is_not_written(prepared, tmp_path):
    (tmp_path / "elsewhere").mkdir()
    (prepared.folder / "masks").symlink_to(tmp_path / "elsewhere")
    with pytest.raises(InputError, match="lies outside"):
        save_mask(prepared, 0, painted(tmp_path / "p.png", 60, 80))
    assert list((tmp_path / "elsewhere").iterdir()) == []


def test_a_photo_that_lies_elsewhere_is_not_shown(prepared, tmp_path):
    write_png(tmp_path / "secret.png", np.zeros((3, 3, 3), np.float32))
    (prepared.folder / "images" / "z.png").symlink_to(tmp_path / "secret.png")
    photos = prepared
    with pytest.raises(InputError, match="lies outside"):
        photos.image(1)
    for number in (-1, 2):
        with pytest.raises(InputError, match="no such photo"):
            photos.image(number)


def test_a_box_is_kept_or_becomes_an_option(prepared, tmp_path):
    assert save_box(prepared, 0, (0.25, 0.1, 0.5, 0.9)).startswith("lightprobe prepare PHOTOS -o ")
    assert json.loads((prepared.folder / "hint.json").read_text()) == {"photo": "a", "box": [10, 3, 20, 27]}
    assert prepared.to_json()["hint"] == "a=10,3,20,27"
    with pytest.raises(InputError, match="draw it"):
        save_box(prepared, 0, (0.5, 0.1, 0.5, 0.9))
    plain = Sources.of([prepared.folder / "images"]).scenes[0]
    assert save_box(plain, 0, (0, 0, 1, 1)).endswith("-o SCENE --hint a.png=0,0,40,30")
    with pytest.raises(ConfigError, match="no masks yet"):
        save_mask(plain, 0, tmp_path / "p.png")


def test_a_mask_that_is_no_picture_is_refused_without_the_place_where_it_lies(prepared, client_of):
    answer = client_of(prepared.folder).put("/api/scenes/0/photos/0/mask", content=b"no picture")
    assert sentence(answer, 422).startswith("The mask is not a PNG")
