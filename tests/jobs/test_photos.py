"""Which photos need not be located, and what is read of them."""

import shutil

import numpy as np
import pytest

from lightprobe.core.run import RunFolder
from lightprobe.imaging import read_mask
from lightprobe.jobs.photos import known_photo, own_entry
from lightprobe.jobs.request import PredictRequest
from lightprobe.scene import load_pixels, load_scene
from lightprobe.scene.record import scene_record
from tests.scene.worlds import views, write_nerd
from tests.toy_scene import write_toy_scene


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


def test_an_upload_of_the_scenes_own_photo_needs_no_camera_under_any_name(run, tmp_path):
    upload = shutil.copy(tmp_path / "scene/test/test_00.png", tmp_path / "upload.png")
    assert known_photo(run, PredictRequest(photo=upload)) is None
    known = known_photo(run, PredictRequest(photo=upload, name="mine.png"))
    assert known.camera.to_json() == run.scene()["photos"]["test"]["test_00"]["camera"]


def test_an_own_photo_has_the_mask_that_it_was_learnt_with(tmp_path):
    root = write_nerd(tmp_path / "scene", views(18))
    folder = RunFolder.create(tmp_path / "run")
    folder.record_scene(scene_record(load_scene(root)))
    request = PredictRequest(photo=root / "images" / "view_03.png")
    mask = root / "masks" / "view_03.png"
    pixels, _ = load_pixels(known_photo(folder, request))
    np.testing.assert_allclose(pixels.alpha, read_mask(mask), atol=1 / 255)
    mask.write_bytes((root / "masks" / "view_04.png").read_bytes())  # another one now
    assert known_photo(folder, request) is None
