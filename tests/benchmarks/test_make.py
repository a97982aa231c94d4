"""The benchmark scenes: what is refused, and one object in both forms, small."""

import hashlib
import json
import shutil

import numpy as np
import pytest

from benchmarks import make, score
from benchmarks.__main__ import main
from benchmarks.results import Role, role
from benchmarks.shoot import DESIGNS, objects
from lightprobe.evaluation.oracle import can_be_oracle
from lightprobe.scene import load_scene


@pytest.fixture(scope="module")
def data(path_tracer, tmp_path_factory):
    folder = tmp_path_factory.mktemp("make") / "data"
    assert main(["make", str(folder), "--tiny", "--objects", "engine", "--jobs", "1"]) == 0
    return folder


def test_every_object_is_designed_and_two_are_untouched():
    assert len(DESIGNS) == len(set(DESIGNS)) == 9
    assert set(DESIGNS) == set(objects.OBJECTS) - {"random"}
    assert len(make.UNTOUCHED & set(DESIGNS)) == 2


def test_the_help_names_every_object_and_which_are_untouched():
    for name in DESIGNS:
        assert name in make.__doc__
    assert make.__doc__.count("(untouched)") == len(make.UNTOUCHED)


def test_roles_are_told_of_both_forms():
    assert {name for name in DESIGNS if role(name) is Role.UNTOUCHED} == make.UNTOUCHED
    assert all(role(f"{name}-shoot") is role(name) is not Role.YOURS for name in DESIGNS)


@pytest.mark.long
def test_both_forms_are_whole_scenes(data):
    sizes, shoot = make.TINY, dict(make.TINY.shoot)
    studio, tables = (load_scene(data / make.scene_name("engine", form)) for form in make.FORMS)
    assert (len(studio.train), len(studio.test), len(studio.relight)) == (sizes.photos, sizes.test, 8)
    assert len(tables.train) == shoot["places"] * shoot["photos"]
    assert (len(tables.test), len(tables.relight)) == (shoot["test_places"] * shoot["test_photos"], 8)
    assert can_be_oracle(studio)
    assert len({photo.light_group for photo in tables.train}) == shoot["places"]
    assert all(photo.truth.environment is not None for photo in (*studio.test, *tables.test))


@pytest.mark.long
def test_the_scorer_finds_the_true_lights_of_both_forms_right(data, tmp_path):
    for form in make.FORMS:
        photos = score.true_photos(data / make.scene_name("engine", form))
        assert photos
        for photo in photos:
            true = score.read_exr(photo.environment, "RGB") * photo.gain
            np.testing.assert_allclose(score.scores(true, photo), 0, atol=1e-6)


@pytest.mark.long
def test_the_light_of_a_test_photo_is_in_its_own_exposure(data):
    scene = data / "engine-shoot"
    frame = next(f for f in json.loads((scene / "shoot.json").read_text())["frames"] if f["split"] == "test")
    light = score.read_exr(scene / "light" / f"{frame['place']}.exr", "RGB")
    shown = score.read_exr(scene / "env_test" / f"{frame['name']}.exr", "RGB")
    below = light * frame["gain"] < 60000
    np.testing.assert_allclose(shown[below], (light * frame["gain"])[below], rtol=1e-5)


@pytest.mark.long
def test_sums_list_every_file_and_equal_calls_make_equal_files(data, tmp_path):
    lines = (data / "engine" / "SHA256SUMS").read_text().splitlines()
    listed = dict(reversed(line.split("  ", 1)) for line in lines)
    folder = data / "engine"
    files = {str(path.relative_to(folder)) for path in folder.rglob("*") if path.is_file()}
    assert set(listed) == files - {"SHA256SUMS"}
    assert listed["mesh.obj"] == hashlib.sha256((folder / "mesh.obj").read_bytes()).hexdigest()
    again = tmp_path / "again"
    words = ["make", str(again), "--tiny", "--objects", "engine", "--forms", "studio", "--jobs", "1"]
    assert main(words) == 0
    assert (again / "engine" / "SHA256SUMS").read_text().splitlines() == lines


@pytest.mark.long
def test_a_second_call_makes_what_is_missing_and_nothing_else(data):
    photo = data / "engine" / "train" / "r_000.png"
    kept, missing = photo.stat().st_mtime_ns, data / "engine-shoot"
    shutil.rmtree(missing)
    assert main(["make", str(data), "--tiny", "--objects", "engine", "--jobs", "1"]) == 0
    assert (missing / "SHA256SUMS").exists()
    assert photo.stat().st_mtime_ns == kept


def test_scenes_of_other_sizes_are_not_mixed(path_tracer, tmp_path, capsys):
    (tmp_path / "settings.json").write_text(json.dumps({"tiny": True}))
    assert main(["make", str(tmp_path), "--objects", "duck"]) == 3
    assert "holds scenes of other sizes; name a new folder." in capsys.readouterr().err


def test_too_few_jobs_are_refused(tmp_path, capsys):
    assert main(["make", str(tmp_path / "data"), "--jobs", "0"]) == 3
    assert capsys.readouterr().err.strip() == "--jobs 0 is too few; give 1 or more."
    assert not (tmp_path / "data").exists()
