"""What the page's worker leaves, in this process."""

import struct

import numpy as np
import pytest

from lightprobe.core.errors import InputError
from lightprobe.imaging import read_ldr
from lightprobe.reconstruction import decompose
from lightprobe.scene import load_scene
from lightprobe.training import Progress
from lightprobe.view.worker import Worker, reworded
from tests.insertion.glbs import box, write
from tests.view.finished_run import SETTINGS, begun_run


def stages():
    """Return a list, and what notes in it what a worker says that it does."""
    said = []
    return said, said.append


@pytest.mark.slow
def test_a_photo_leaves_its_light_and_takes_an_object_in(run, tmp_path):
    worker, (said, tell) = Worker("cpu"), stages()
    light, inserted = tmp_path / "light", tmp_path / "inserted"
    photo = run.path.parent / "scene" / "test" / "test_00.png"
    write(tmp_path / "box.glb", box())
    for folder in (light, inserted):
        folder.mkdir()
    asked = {"run": str(run.path), "folder": str(light), "upload": str(photo), "name": "mine.png"}
    assert worker.answer({**asked, "task": "load"}, tell) == {}
    told = worker.answer({**asked, "task": "predict"}, tell)
    assert said == ["loading the object", "predicting the light", "writing", "drawing"]
    names = {file["name"] for file in told["files"]}
    assert names == {path.name for path in light.iterdir()}
    assert {
        "light.exr",
        "light.light.json",
        "confidence.png",
        "balls.png",
        "render.png",
        "photo.jpg",
    } <= names
    assert (told["pose"], type(told["verdict"])) == (None, str)
    placed = {"at": (0.3, 0.7), "scale": None, "turn": 0.0, "photo": str(photo), "prediction": str(light)}
    asked = {
        **asked,
        **placed,
        "folder": str(inserted),
        "upload": str(tmp_path / "box.glb"),
        "task": "insert",
    }
    made = worker.answer(asked, tell)
    assert {file["name"] for file in made["files"]} == {path.name for path in inserted.iterdir()}
    before, after = read_ldr(photo)[0], read_ldr(inserted / made["picture"])[0]
    assert before.shape == after.shape
    assert np.abs(before - after).max() > 0.1
    assert made["at"] == pytest.approx((0.3, 0.7), abs=0.2)


@pytest.mark.slow
def test_the_newest_checkpoint_is_sent_as_numbers(tmp_path):
    run, worker = begun_run(tmp_path), Worker("cpu")
    asked = {"task": "preview", "run": str(run.path), "folder": str(tmp_path)}
    with pytest.raises(InputError, match="no checkpoint yet"):
        worker.answer(asked, print)

    class EnoughError(Exception):
        """Ends a training in the middle."""

    def on_step(name, done, steps, loss):
        if (name, done) == ("pass1", 3):
            raise EnoughError

    with pytest.raises(EnoughError):
        decompose(load_scene(tmp_path / "scene"), SETTINGS, progress=Progress(run.checkpoints, on_step))
    told = worker.answer(asked, print)
    data = (tmp_path / "preview.bin").read_bytes()
    vertices, faces, *middle = struct.unpack_from("<II3d", data)
    assert (told["step"], told["stage"], told["faces"]) == (2, "pass1", faces)
    assert len(data) == 32 + 12 * (2 * vertices + faces)
    positions = np.frombuffer(data, "<f4", 3 * vertices, 32).reshape(-1, 3) + middle
    assert np.median(np.linalg.norm(positions, axis=1)) == pytest.approx(1, abs=0.25)  # the toy scene's ball


def test_a_sentence_names_the_file_as_the_person_does():
    assert reworded({"upload": "/tmp/x/photo-1.png", "name": "a.png"}, "/tmp/x/photo-1.png is no photo.") == (
        "a.png is no photo."
    )
    assert reworded({}, "A sentence.") == "A sentence."
