import json
import math

import numpy as np
import pytest

from lightprobe.core.run import RunFolder
from lightprobe.imaging import read_ldr
from lightprobe.jobs.insertion import doubt_about_up
from tests.cli.commands import fails, succeed
from tests.insertion.glbs import box, write


@pytest.fixture(scope="module")
def thing(tmp_path_factory):
    return write(tmp_path_factory.mktemp("thing") / "box.glb", box())


@pytest.mark.slow
def test_a_thing_is_put_into_a_photo_of_the_run(trained, thing, tmp_path, capsys):
    scene, run = trained
    photo, light = scene / "test" / "test_00.png", tmp_path / "light.exr"
    succeed("predict", run.path, photo, "-o", light)
    for name, more in (("own.png", []), ("placed.png", ["--env", light, "--at", "30,30", "--scale", "0.4"])):
        succeed("insert", run.path, photo, "--object", thing, "-o", tmp_path / name, "--turn", "20", *more)
        assert f"Picture: {tmp_path / name}" in capsys.readouterr().out
        color, alpha = read_ldr(tmp_path / name)
        assert color.shape == read_ldr(photo)[0].shape
        assert alpha is not None  # of a cut-out photo
        stem = name.removesuffix(".png")
        assert {p.name for p in tmp_path.glob(f"{stem}.*")} == {
            name,
            f"{stem}.beauty.exr",
            f"{stem}.shadow.exr",
            f"{stem}.mask.exr",
        }


@pytest.mark.slow
def test_what_cannot_be_inserted_leaves_no_file(trained, thing, tmp_path, capsys):
    scene, run = trained
    photo, folder = scene / "test" / "test_00.png", tmp_path / "out"
    folder.mkdir()
    outside = box()
    outside.document["images"] = [{"uri": "secret.png"}]
    bad = write(tmp_path / "outside.glb", outside)
    for name, object_, more, word in (
        ("a.png", bad, [], "refers to other files"),
        ("a.jpg", thing, [], ".png"),
        ("a.png", thing, ["--at", "here"], "--at"),
        ("a.png", thing, ["--at", "500,500"], "outside"),
        ("a.png", thing, ["--scale", "nan"], "--scale"),
        ("a.png", tmp_path / "none.glb", [], "does not exist"),
    ):
        arguments = ["insert", run.path, photo, "--object", object_, "-o", folder / name, *more]
        fails(arguments, capsys, [word])
        assert not list(folder.iterdir())


@pytest.mark.parametrize("read", ["photo", "mask", "env"])
def test_what_is_read_is_not_replaced_by_the_picture_or_a_layer(trained, thing, tmp_path, capsys, read):
    scene, run = trained
    photo, layer = scene / "test" / "test_00.png", tmp_path / "out.beauty.exr"
    copies = {"photo": tmp_path / "photo.png", "mask": tmp_path / "mask.png", "env": layer}
    copies[read].write_bytes(photo.read_bytes())
    before, image = copies[read].read_bytes(), copies["photo"] if read == "photo" else photo
    output = tmp_path / "out.png" if read == "env" else copies[read]
    more = [] if read == "photo" else [f"--{read}", copies[read]]
    fails(["insert", run.path, image, "--object", thing, "-o", output, *more], capsys, ["would be replaced"])
    assert [path.name for path in tmp_path.iterdir()] == [copies[read].name]
    assert copies[read].read_bytes() == before


def turned_scene(run, folder, degrees):
    """A run folder with the scene of another one, its world turned about x."""
    record = json.loads(run.scene_file.read_text())
    cos, sin = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
    turn = np.array([[1, 0, 0, 0], [0, cos, -sin, 0], [0, sin, cos, 0], [0, 0, 0, 1]])
    for photo in record["photos"]["train"].values():
        photo["camera"]["camera_to_world"] = (turn @ photo["camera"]["camera_to_world"]).tolist()
    turned = RunFolder.create(folder)
    turned.scene_file.write_text(json.dumps(record))
    return turned


@pytest.mark.parametrize(
    ("degrees", "told"), [(0, None), (30, None), (60, "60 degrees"), (108, "108 degrees")]
)
def test_a_scene_whose_z_axis_is_not_up_is_told(trained, tmp_path, degrees, told):
    sentences = doubt_about_up(turned_scene(trained[1], tmp_path / "run", degrees))
    assert len(sentences) == (told is not None)
    assert all(told in sentence for sentence in sentences)


def test_without_the_scene_s_cameras_nothing_is_said_about_up(tmp_path):
    assert doubt_about_up(RunFolder.create(tmp_path / "run")) == []
