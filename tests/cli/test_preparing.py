"""prepare at the command line: what it says when it cannot, and training on photos without cameras."""

import shutil
import sys

import numpy as np
import pytest
from PIL import Image, ImageFilter

from lightprobe.cli.main import main
from lightprobe.preparation import Prepared
from lightprobe.runs import preparing
from tests.cli.commands import fails, succeed
from tests.toy_scene import TINY_WITHOUT_TRIALS, write_toy_scene


@pytest.fixture
def photos(tmp_path):
    folder = tmp_path / "photos"
    folder.mkdir()
    for index in range(5):
        pixels = np.random.default_rng(index).integers(0, 256, (60, 80, 3), np.uint8)
        Image.fromarray(pixels).save(folder / f"IMG_{index}.jpg")
    return folder


def test_what_cannot_be_prepared_is_one_sentence(photos, tmp_path, capsys):
    out = tmp_path / "scene"
    fails(["prepare", tmp_path / "nowhere", "-o", out], capsys, ["nowhere does not exist"])
    fails(["prepare", photos, "-o", out, "--hint", "IMG_9.jpg=1,2,3,4"], capsys, ["no photo 'IMG_9.jpg'"])
    fails(["prepare", photos, "-o", out, "--hint", "IMG_1.jpg"], capsys, ["PHOTO=MASK.png"])
    fails(["prepare", photos, "-o", out, "--up-photo", "IMG_9"], capsys, ["--up-photo", "IMG_9"])
    fails(["prepare", photos, "-o", out, "--up", "1,2"], capsys, ["three numbers"])
    fails(["prepare", photos, "-o", out, "--height", "-3"], capsys, ["--height -3 is no length"])
    assert not out.exists()
    (photos / "IMG_4.jpg").unlink()
    (photos / "IMG_3.jpg").unlink()
    fails(["prepare", photos, "-o", out], capsys, ["holds 3 photos"])
    assert not out.exists()


def test_a_damaged_photo_is_named(photos, tmp_path, capsys):
    (photos / "IMG_2.jpg").write_bytes((photos / "IMG_2.jpg").read_bytes()[:300])
    fails(["prepare", photos, "-o", tmp_path / "scene"], capsys, ["IMG_2.jpg", "damaged"])


@pytest.mark.slow
@pytest.mark.parametrize("blur", [0, 12])
def test_photos_that_nothing_joins_are_one_sentence(photos, tmp_path, capsys, blur):
    """Photos of nothing in common, and photos that are all blurred."""
    for path in sorted(photos.iterdir()):
        with Image.open(path) as image:
            image.resize((320, 240)).filter(ImageFilter.GaussianBlur(blur)).save(path)
    code = main(["prepare", str(photos), "-o", str(tmp_path / "scene")])
    said = capsys.readouterr().err.splitlines()[-1]
    assert code == 2
    assert said.startswith("lightprobe: No cameras were found")
    assert "overlap, sharp" in said
    assert [path.name for path in (tmp_path / "scene").iterdir()] == [
        ".prepare"
    ]  # what a next call goes on from


@pytest.mark.parametrize("name", ["pycolmap"])
def test_a_missing_library_is_named_with_its_remedy(photos, tmp_path, capsys, monkeypatch, name):
    monkeypatch.setitem(sys.modules, name, None)
    fails(["prepare", photos, "-o", tmp_path / "scene"], capsys, [name, "pip install 'lightprobe[photos]'"])


def test_a_scene_with_cameras_is_named_as_such(tmp_path, capsys):
    scene = write_toy_scene(tmp_path / "scene", train=3, test=1)
    fails(["prepare", scene, "-o", tmp_path / "out"], capsys, ["has cameras", "lightprobe train"])


@pytest.mark.long
def test_training_on_plain_photos_makes_their_scene_in_the_run(photos, tmp_path, monkeypatch):
    scene, seen = write_toy_scene(tmp_path / "toy"), []

    def stand_in(folder, output, options, on_progress):
        seen.append((folder, output))
        shutil.copytree(scene, output)
        return Prepared(output, {"warnings": []})

    monkeypatch.setattr(preparing, "prepare", stand_in)
    run = tmp_path / "run"
    succeed("fit", photos, "-o", run, *TINY_WITHOUT_TRIALS)
    assert seen == [(photos, run / "scene")]
    assert (run / "mesh" / "object.glb").is_file()
