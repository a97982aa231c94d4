"""Composed photos show object and light, and the tables of what is located count what they say."""

from pathlib import Path

import numpy as np
import pytest
import torch

import composed_photos
import measure_locate
from lightprobe.imaging import read_hdr, read_ldr
from lightprobe.localization import PoseStatus
from lightprobe.scene.photo import Photo
from tests.known_scene import known_scene


@pytest.fixture(scope="module")
def scene(tmp_path_factory):
    return known_scene(tmp_path_factory.mktemp("known"))[1]


def test_a_composed_photo_has_its_light_behind_the_object(scene, tmp_path):
    photo = scene.test[0]
    picture = composed_photos.composed(photo)
    color, alpha = read_ldr(photo.image_path)
    assert np.allclose(picture[alpha == 1], color[alpha == 1])
    middle_top = photo.camera.camera_to_world[:3, :3] @ [0, (photo.camera.cy - 0.5) / photo.camera.fy, -1]
    up = torch.from_numpy(middle_top / np.linalg.norm(middle_top)).float()[None]
    light = torch.from_numpy(np.ascontiguousarray(read_hdr(photo.truth.environment)[..., :3], np.float32))
    seen = composed_photos.equirect.sample(light, up)[0].numpy()
    assert np.allclose(picture[0, photo.camera.width // 2], seen, rtol=0.05)
    (file,) = composed_photos.write_composed([photo], tmp_path)
    assert read_ldr(file)[1] is None


def test_a_photo_without_a_known_light_is_left_out(scene, tmp_path):
    plain = Photo("x", scene.test[0].camera, scene.test[0].image_path)
    assert composed_photos.write_composed([plain], tmp_path) == []
    with pytest.raises(ValueError, match="not known"):
        composed_photos.composed(plain)


def test_rows_count_right_wrong_and_doubted(scene, monkeypatch, capsys):
    answers = iter([(0.5, PoseStatus.GOOD), (40.0, PoseStatus.GOOD)])

    def answer(subject, file, focal, given):
        error, status = next(answers)
        return measure_locate.Answer(status, 1.0, None, error)

    monkeypatch.setattr(measure_locate, "answer", answer)
    files = {photo.name: Path(photo.name) for photo in scene.test}
    subject = measure_locate.Subject("known", scene, None, None, files)
    row = measure_locate.pose_row(subject, known=True)
    assert [cell.strip() for cell in row.split("|")[1:8]] == ["known", "2", "50 %", "50 %", "20.25", "1", "0"]
    assert "40.00 px, good" in capsys.readouterr().out


def test_photos_without_the_object(scene, tmp_path):
    subject = measure_locate.Subject("known", scene, None, None, {"own": tmp_path / "own.png"})
    others = {"known": subject.files, "vase": {str(k): tmp_path / f"{k}.png" for k in range(9)}}
    found = list(measure_locate.wrong_files(subject, others, tmp_path))
    kinds = [kind for kind, file in found if file.is_file()]
    assert kinds.count("background") == 2
    assert kinds.count("noise") == 4
    assert [file.stem for kind, file in found if kind == "vase"] == ["0", "1", "2", "3"]
    assert "known" not in [kind for kind, _ in found]


def test_a_scene_that_is_not_there_is_named(tmp_path):
    with pytest.raises(SystemExit, match="no scene vase in"):
        measure_locate.scene_of("vase", tmp_path)
