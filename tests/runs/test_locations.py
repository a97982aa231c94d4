"""Where the files of located photos go, and which photos need not be located."""

import shutil
from pathlib import Path

import pytest

from lightprobe.core.errors import ConfigError
from lightprobe.core.run import RunFolder
from lightprobe.runs.locations import LocationFiles, is_own_photo, locate_photos, photo_mask
from lightprobe.scene import load_scene
from lightprobe.scene.record import scene_record
from tests.toy_scene import write_toy_scene


def test_files_that_are_not_chosen_stand_in_the_folder():
    files = LocationFiles(mask=Path("m.png")).within(Path("maps"), Path("photos/new.jpg"))
    assert files == LocationFiles(Path("maps/new.camera.json"), Path("m.png"), Path("maps/new.overlay.png"))
    longest = LocationFiles().within(Path("maps"), Path("x" * 250 + ".jpg"))
    assert max(len(path.name) for path in (longest.camera, longest.mask, longest.overlay)) <= 255


@pytest.mark.parametrize(
    ("files", "count", "words"),
    [
        (LocationFiles(camera=Path("c.txt")), 1, r"--save-camera c\.txt must end with \.json"),
        (LocationFiles(overlay=Path("o.png")), 2, r"--save-overlay names one file.*2 photos"),
    ],
)
def test_names_that_cannot_serve_are_refused(files, count, words):
    with pytest.raises(ConfigError, match=words):
        files.check(count)


def test_a_mask_of_many_is_chosen_by_the_photo_s_name(tmp_path):
    assert photo_mask(Path("a/b.jpg"), tmp_path) == tmp_path / "b.png"
    assert photo_mask(Path("a/b.jpg"), Path("m.png")) == Path("m.png")


@pytest.fixture
def run(tmp_path):
    folder = RunFolder.create(tmp_path / "run")
    folder.record_scene(scene_record(load_scene(write_toy_scene(tmp_path / "scene", train=3, test=1))))
    return folder


def test_own_photos_are_known_by_file_or_by_name_and_content(run, tmp_path):
    own, other = tmp_path / "scene/train/train_00.png", tmp_path / "scene/train/train_01.png"
    assert is_own_photo(run, own)
    (tmp_path / "copies").mkdir()
    copy, impostor = tmp_path / "copies/train_00.png", tmp_path / "copies/train_02.png"
    shutil.copy(own, copy)
    shutil.copy(other, impostor)
    assert is_own_photo(run, copy)
    assert not is_own_photo(run, impostor)  # another photo by the name of one
    assert not is_own_photo(run, tmp_path / "missing.png")


def test_photos_whose_files_would_meet_are_refused_before_any_work(run, tmp_path):
    with pytest.raises(ConfigError, match="same name"):
        locate_photos(run.path, [tmp_path / "a/x.png", tmp_path / "b/x.jpg"])
    with pytest.raises(ConfigError, match="No photo is named"):
        locate_photos(run.path, [])
