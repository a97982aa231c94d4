"""Where the files of located photos go, and which photos need not be located."""

import shutil
from pathlib import Path

import numpy as np
import pytest
from lightprobe.runs.locations import LocationFiles, locate_photos, own_entry, photo_mask
from lightprobe.runs.new_photos import NewPhotos, PhotoFiles

from lightprobe.core.errors import ConfigError
from lightprobe.core.run import RunFolder
from lightprobe.imaging import read_mask
from lightprobe.scene import load_scene
from lightprobe.scene.record import scene_record
from tests.scene.worlds import views, write_nerd
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
    assert own_entry(run, own)
    (tmp_path / "copies").mkdir()
    copy, impostor = tmp_path / "copies/train_00.png", tmp_path / "copies/train_02.png"
    shutil.copy(own, copy)
    shutil.copy(other, impostor)
    assert own_entry(run, copy)
    assert own_entry(run, impostor) is None  # another photo by the name of one
    assert own_entry(run, tmp_path / "missing.png") is None


def test_an_own_photo_has_the_mask_that_it_was_learnt_with(tmp_path):
    root = write_nerd(tmp_path / "scene", views(18))
    folder = RunFolder.create(tmp_path / "run")
    folder.record_scene(scene_record(load_scene(root)))
    image, mask = root / "images" / "view_03.png", root / "masks" / "view_03.png"
    files = [PhotoFiles(image, None, LocationFiles())]
    photos = NewPhotos(folder, files, None, background=True)
    assert not photos.lack_cameras
    np.testing.assert_allclose(photos.read(0).pixels.alpha, read_mask(mask), atol=1 / 255)
    mask.write_bytes((root / "masks" / "view_04.png").read_bytes())  # another one now
    assert NewPhotos(folder, files, None, background=True).lack_cameras


def test_photos_whose_files_would_meet_are_refused_before_any_work(run, tmp_path):
    photo, other = tmp_path / "a/x.png", tmp_path / "b/x.jpg"
    for second in (other, photo):
        with pytest.raises(ConfigError, match=f"^{photo} and {second} have the same name"):
            locate_photos(run.path, [photo, second])
    with pytest.raises(ConfigError, match="No photo is named"):
        locate_photos(run.path, [])
