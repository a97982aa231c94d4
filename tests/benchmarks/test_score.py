"""The scorer that stands alone: the same spheres' errors as the evaluation's, and plain words about files."""

import json

import numpy as np
import pytest
import torch

from benchmarks import score
from benchmarks.__main__ import main
from demo_scene.files import write_exr
from demo_scene.lights import Kind, make_light
from lightprobe.evaluation.three_spheres import SPHERES, ThreeSpheres, sphere_scores
from tests.shapes import camera_at


def light(index: int) -> np.ndarray:
    return make_light(list(Kind)[index % 4], 5, index).radiance.astype(np.float32)


@pytest.fixture
def scene(tmp_path):
    """A scene of two test photos, and the folder of their predicted maps, which are right."""
    folder, predictions = tmp_path / "pot", tmp_path / "predicted"
    folder.mkdir()
    (predictions / "pot").mkdir(parents=True)
    frames = []
    for k in range(2):
        write_exr(folder / f"env_{k}.exr", light(k), "RGB")
        write_exr(predictions / "pot" / f"r_{k}.exr", light(k) * 3, "RGB")
        pose = camera_at([3, k, 1]).camera_to_world.tolist()
        frames.append({"file_path": f"./test/r_{k}", "transform_matrix": pose, "env_path": f"./env_{k}.exr"})
    (folder / "transforms_test.json").write_text(json.dumps({"frames": frames}))
    return folder, predictions


@pytest.mark.parametrize(("index", "other"), [(0, 1), (1, 2), (2, 3), (3, 0)])
def test_spheres_have_the_errors_of_the_evaluation(scene, index, other):
    photo, mine, true = score.true_photos(scene[0])[1], light(index), light(other)
    spheres = ThreeSpheres(torch.from_numpy(photo.pose[:3, 3]), torch.from_numpy(photo.pose[:3, 1]))
    expected = sphere_scores(*(spheres.light(torch.from_numpy(m)) for m in (mine, true)))
    found = score.sphere_errors(mine, true, photo.pose)
    assert found == pytest.approx([expected[f"{name}_si_rmse"] for name in SPHERES], rel=2e-3)


def test_right_maps_have_no_errors_but_their_factor(scene, capsys):
    assert main(["score", str(scene[0].parent), str(scene[1])]) == 0
    own, grey = capsys.readouterr().out.splitlines()[2:]
    cells = [cell.strip() for cell in own.split("|")[1:-1]]
    assert cells[:2] == ["pot", "2"]
    assert float(cells[2]) == pytest.approx(np.log(3), abs=0.1)  # less where the floor is not small
    assert max(map(float, cells[3:])) < 0.1
    assert grey.startswith("| pot, grey map | 2 |")
    assert float(grey.split("|")[5]) > 0.1


def test_one_factor_changes_only_the_raw_error(scene):
    photo = score.true_photos(scene[0])[0]
    once, twice = score.scores(light(1), photo), score.scores(light(1) * 0.5, photo)
    assert once[0] != pytest.approx(twice[0], abs=0.05)
    assert once[2:] == pytest.approx(twice[2:], abs=1e-6)


def test_a_map_of_another_size_is_as_good(scene):
    photo, true = score.true_photos(scene[0])[0], light(0)
    large = true.repeat(4, axis=0).repeat(4, axis=1)
    assert max(score.scores(large, photo)) < 0.01
    for other in (score.sampled(true, 48), score.resized(true, 32)):
        assert max(score.scores(other, photo)[2:4]) < 0.1  # a sun of a few texels is blurred


def test_photos_without_a_map_are_named(scene, capsys):
    (scene[1] / "pot" / "r_1.exr").unlink()
    assert main(["score", str(scene[0]), str(scene[1])]) == 1
    printed = capsys.readouterr()
    assert "| pot | 1 |" in printed.out
    assert printed.err == "No map for pot/r_1.\n"


def test_files_that_cannot_be_scored_are_named(scene, tmp_path, capsys):
    map_, empty = scene[1] / "pot" / "r_0.exr", tmp_path / "empty"
    empty.mkdir()
    write_exr(map_, np.ones((8, 8, 3), np.float32), "RGB")
    assert main(["score", str(scene[0]), str(scene[1])]) == 2
    assert f"{map_} is not twice as wide" in capsys.readouterr().err
    map_.write_bytes(b"no picture")
    assert main(["score", str(scene[0]), str(scene[1])]) == 2
    assert f"{map_} is no EXR" in capsys.readouterr().err
    assert main(["score", str(empty), str(scene[1])]) == 2
    assert "holds no scene" in capsys.readouterr().err
    (scene[0] / "transforms_test.json").write_text('{"frames": []}')
    assert main(["score", str(scene[0]), str(scene[1])]) == 2
    assert "names no true light" in capsys.readouterr().err
    (scene[0] / "transforms_test.json").write_text('{"frames": [{"env_path": "./env_0.exr"}]}')
    assert main(["score", str(scene[0]), str(scene[1])]) == 2
    assert "is no scene whose test photos" in capsys.readouterr().err


def test_a_shoots_light_is_multiplied_by_the_photos_gain(tmp_path):
    (tmp_path / "light").mkdir()
    write_exr(tmp_path / "light" / "hall.exr", light(2), "RGB")
    frame = {"name": "IMG_1", "place": "hall", "gain": [2.0, 1.0, 0.5]}
    frame["transform_matrix"] = camera_at([3, 0, 1]).camera_to_world.tolist()
    frames = [frame | {"split": "test"}, frame | {"split": "train", "name": "IMG_0"}]
    (tmp_path / "shoot.json").write_text(json.dumps({"frames": frames}))
    (photo,) = score.true_photos(tmp_path)
    assert photo.name == "IMG_1"
    assert max(score.scores(light(2) * [2.0, 1.0, 0.5], photo)) < 0.01
