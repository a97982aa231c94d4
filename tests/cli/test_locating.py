"""A new photo without a camera: locate, and predict, which locates it first."""

import json
import shutil

import pytest
import torch

from lightprobe.cli.main import main
from lightprobe.core.run import RunFolder
from lightprobe.imaging import read_ldr, read_mask, write_png
from lightprobe.light.environment import Environment
from lightprobe.localization import KnownViews
from lightprobe.models import Decomposition
from lightprobe.scene.record import scene_record
from tests.cli.commands import succeed
from tests.insertion.glbs import box, write
from tests.painted_object import SIMILARITY, painted_asset, painted_scene, photo_of, view_from

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """A run without a model, of a known object; what photos are located by is not in it yet."""
    folder, asset = tmp_path_factory.mktemp("located"), painted_asset()
    scene = painted_scene(folder / "scene", asset)
    lights = {photo.name: Environment(torch.ones(6, 8, 8, 3)) for photo in scene.train}
    made = RunFolder.create(folder / "run")
    made.record_scene(scene_record(scene) | {"root": str(folder / "scene")})
    Decomposition(asset, lights, SIMILARITY).save(made)
    return made


@pytest.fixture(scope="module")
def photo(tmp_path_factory):
    color, cover = photo_of(painted_asset(), view_from((2.5, 1.5, 1.2), shift=0.15), 20)
    file = tmp_path_factory.mktemp("photos") / "new.png"
    write_png(file, color)
    return file, cover


@pytest.fixture(scope="module")
def known_run(run):
    """The run with its views, which cannot be read from the scene's folder: its layout is not known."""
    scene = painted_scene(run.path.parent / "again", painted_asset())
    KnownViews.of(Decomposition.load(run, torch.device("cpu")), scene).save(run.views_file)
    return run


def test_predict_without_a_camera_locates_the_photo_first(known_run, photo, tmp_path, capsys):
    file, cover = photo
    succeed("predict", known_run.path, file, "-o", tmp_path / "light.exr", "--device", "cpu")
    told = capsys.readouterr()
    assert "pose good" in told.out
    assert "photo good" in told.out
    assert (tmp_path / "light.exr").is_file()
    assert abs(read_mask(tmp_path / "new.mask.png") - cover).mean() < 0.01
    assert json.loads((tmp_path / "new.camera.json").read_text())["width"] == 128
    assert (tmp_path / "new.overlay.png").is_file()


def test_locate_writes_where_it_is_told(known_run, photo, tmp_path, capsys):
    file, _ = photo
    camera = tmp_path / "c" / "mine.json"
    succeed("locate", known_run.path, file, "-o", tmp_path, "--save-camera", camera, "--device", "cpu")
    assert camera.is_file()
    assert not (tmp_path / "new.camera.json").exists()
    assert "pose good" in capsys.readouterr().out
    again = tmp_path / "again.exr"  # the files are what predict takes
    succeed(
        "predict", known_run.path, file, "--camera", camera, "--mask", tmp_path / "new.mask.png", "-o", again
    )


def test_an_object_is_put_into_a_photo_that_was_located(known_run, photo, tmp_path, capsys):
    glb, out = write(tmp_path / "box.glb", box()), tmp_path / "out.png"
    words = ["--object", glb, "-o", out, "--device", "cpu", "--json"]
    succeed("insert", known_run.path, photo[0], *words)
    answer = json.loads(capsys.readouterr().out)
    assert answer["location"]["width"] == 128  # the camera, without the pixels
    assert answer["location"]["verdict"]["status"] == "good"
    assert read_ldr(out)[0].shape == read_ldr(photo[0])[0].shape


def test_gone_photos_are_one_sentence(run, photo, tmp_path, capsys):
    moved = shutil.copytree(run.path, tmp_path / "run")
    (moved / "mesh" / "views.safetensors").unlink(missing_ok=True)
    record = json.loads((moved / "scene.json").read_text())
    (moved / "scene.json").write_text(json.dumps(record | {"root": str(tmp_path / "gone")}))
    assert main(["locate", str(moved), str(photo[0])]) == 2
    assert "no longer in" in capsys.readouterr().err
