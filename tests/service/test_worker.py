"""Real predictions by the worker: in this process, and once through the whole service."""

import base64
import json
import shutil

import numpy as np
import pytest

from lightprobe.core.config.prediction import Method, Sun
from lightprobe.core.errors import InputError
from lightprobe.export.light_file import read_sources
from lightprobe.imaging import read_hdr, write_png
from lightprobe.prediction import Predictor
from lightprobe.scene import load_photo
from lightprobe.service.server import worker_arguments
from lightprobe.service.worker import Worker, reworded
from tests.service.serving import serving
from tests.view.finished_run import finished_run


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    """A folder with one run, of the toy scene's ball."""
    folder = tmp_path_factory.mktemp("service")
    made = finished_run(folder)
    (folder / "runs").mkdir()
    shutil.move(made.path, folder / "runs" / "ball")
    return folder / "runs"


@pytest.fixture
def asked(runs, tmp_path):
    """A request for the light in a test photo."""
    photo = tmp_path / "photo-1.png"
    shutil.copy(runs.parent / "scene" / "test" / "test_00.png", photo)
    return {
        "task": "predict",
        "run": str(runs / "ball"),
        "folder": f"{tmp_path}/",
        "photo": str(photo),
        "name": "mine.png",
        "camera": None,
        "mask": None,
        "method": "solve",
        "size": None,
        "sun": "inside",
        "sources": False,
        "background": True,
        "outputs": ["exr", "hdr", "png", "confidence", "mask", "overlay"],
    }


def worker(pixels=10**6):
    return Worker("cpu", 1, 2**30, pixels)


@pytest.mark.slow
def test_a_prediction_leaves_what_was_asked_for(runs, asked, tmp_path):
    told = worker().answer(asked, lambda stage: None)
    assert told["files"] == [
        "light.exr",
        "light.hdr",
        "light.png",
        "confidence.exr",
        "mask.png",
        "overlay.png",
    ]
    assert told["light"]["photo"]["file"] == "mine.png"
    assert (told["light"]["sources"], told["light"]["sources_sought"]) == ([], False)
    assert told["worker"]["objects"] == ["ball"]
    assert told["worker"]["held"] > 0
    assert told["seconds"]["load"] > 0
    predictor = Predictor.load(runs / "ball")
    record = json.loads((runs / "ball" / "scene.json").read_text())
    (tmp_path / "own.json").write_text(json.dumps(record["photos"]["test"]["test_00"]["camera"]))
    same = predictor.predict(*load_photo(asked["photo"], tmp_path / "own.json"), Method.SOLVE)
    assert np.array_equal(read_hdr(tmp_path / "light.exr"), same.environment.panorama())


@pytest.mark.slow
def test_lamps_are_looked_for_and_taken_out_where_that_is_asked_for(asked, tmp_path):
    one = worker()
    told = one.answer({**asked, "sources": True, "sun": "separate", "size": "256x128"}, lambda stage: None)
    assert told["light"]["sources_sought"]
    copies = ["light.hdr"]
    assert told["light"]["map"] == {
        "file": "light.exr",
        "copies": copies,
        "width": 256,
        "height": 128,
        "sun": "separate",
    }
    assert [read_sources(tmp_path / name)[1] for name in ("light.exr", *copies)] == [Sun.SEPARATE] * 2
    assert read_hdr(tmp_path / "light.exr").shape == (128, 256, 3)
    assert one.answer(asked, lambda stage: None)["seconds"]["load"] == 0


def test_too_many_pixels_are_refused_before_they_are_decoded(asked, tmp_path):
    with pytest.raises(InputError, match="more than the 0 million"):
        worker(pixels=1000).answer(asked, lambda stage: None)
    write_png(tmp_path / "mask-1.png", np.zeros((2000, 1000, 3), np.float32))
    with pytest.raises(InputError, match="1000 x 2000 pixels"):
        worker().answer({**asked, "mask": str(tmp_path / "mask-1.png")}, lambda stage: None)


@pytest.mark.slow
def test_a_first_object_that_cannot_be_used_is_left_to_the_request_for_it(runs, asked, tmp_path):
    shutil.copytree(runs / "ball", tmp_path / "runs" / "a")
    (tmp_path / "runs" / "a" / "scene.json").write_text("{")
    begun = worker()
    begun.warm_up(tmp_path / "runs")
    with pytest.raises(InputError, match=r"scene\.json"):
        begun.answer({**asked, "run": str(tmp_path / "runs" / "a")}, lambda stage: None)
    assert begun.answer(asked, lambda stage: None)["verdict"]["status"] == "good"


def test_a_sentence_says_nothing_of_places_here(asked):
    request = {**asked, "camera": f"{asked['folder']}given-camera.json"}
    sentence = f"{request['photo']} and {request['camera']} for {request['run']}, {request['folder']}x.png."
    assert reworded(request, sentence) == "mine.png and the camera for ball, x.png."


@pytest.mark.slow
def test_the_service_predicts_with_real_workers(runs, tmp_path, monkeypatch):
    with serving(tmp_path, monkeypatch, runs=runs, worker=worker_arguments) as served:
        photo = (runs.parent / "scene" / "test" / "test_00.png").read_bytes()
        first, again = (
            served.predict(object="ball", content=photo, sources="false").json() for _ in range(2)
        )
        assert first["files"][0]["base64"] == again["files"][0]["base64"]
        assert first["seconds"]["load"] == again["seconds"]["load"] == 0
        (tmp_path / "light.exr").write_bytes(base64.b64decode(first["files"][0]["base64"]))
        assert read_hdr(tmp_path / "light.exr").shape == (64, 128, 3)
        cut = served.predict(object="ball", content=photo[:900])
        assert cut.status_code == 422
        assert cut.json()["sentence"].startswith("good.png cannot be decoded")
