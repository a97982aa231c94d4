"""The server's routes without a browser: what they answer, what they refuse, and that they stay in their
folders.
"""

import asyncio
import json
import struct

import numpy as np
import pytest
from starlette.testclient import TestClient

from lightprobe.core.errors import InputError
from lightprobe.imaging import read_hdr, write_exr
from lightprobe.view import uploads as uploads_module
from lightprobe.view.app import STATIC, inline_script
from lightprobe.view.sources import Sources
from lightprobe.view.uploads import UploadKind
from lightprobe.web.listening import server_settings
from tests.fuzz.connection import Watched, exchange
from tests.view.finished_run import side_light
from tests.web.answers import sentence


def exr(path, image):
    write_exr(path, np.asarray(image, np.float32))
    return path.read_bytes()


def glb(document):
    text = json.dumps(document).encode()
    text += b" " * (-len(text) % 4)
    return b"glTF" + struct.pack("<III4s", 2, 20 + len(text), len(text), b"JSON") + text


@pytest.mark.slow
def test_the_page_and_its_parts_come_from_the_package(client):
    assert "importmap" in client.get("/").text
    assert json.loads(inline_script((STATIC / "index.html").read_text()))["imports"]
    for path in ("js/app.js", "css/base.css", "vendor/three/three.module.min.js"):
        assert client.get(f"/static/{path}").status_code == 200
    for path in ("/static/../app.py", "/static/%2e%2e/app.py", "/static/..%2fapp.py", "/app.py"):
        sentence(client.get(path), 404)


def test_a_run_tells_its_photos_cameras_and_lights(client):
    about = client.get("/api/runs/0").json()
    assert [photo["split"] for photo in about["photos"]] == ["train"] * 12 + ["test"]
    assert [photo["light"] for photo in about["photos"]] == [True] * 12 + [False]
    assert about["object"]
    assert client.get("/api/runs/0/object.glb").content.startswith(b"glTF")
    assert client.get("/api/runs/0/photos/0/picture").content.startswith(b"\x89PNG")
    for path in ("/api/runs/1", "/api/runs/-1", "/api/runs/x", "/api/runs/0/photos/99/picture"):
        sentence(client.get(path), 422)
    assert "no light of its own" in sentence(client.get("/api/runs/0/photos/12/light"), 422)


def test_a_light_comes_as_half_floats_from_the_bottom_up(client, run):
    answer = client.get("/api/runs/0/photos/1/light")
    height = int(answer.headers["x-height"])
    texels = np.frombuffer(answer.content, np.float16).reshape(height, 2 * height, 4)
    stored = read_hdr(run.environment_file("train_01"))
    assert np.abs(texels[::-1, :, :3] - stored).max() < 2e-3
    assert (texels[..., 3] == 1).all()


def test_very_bright_lights_keep_their_level(client, tmp_path):
    image = np.full((8, 16, 3), 0.5)
    image[2, 3] = 1e6
    given = client.post("/api/lights", content=exr(tmp_path / "sun.exr", image)).json()
    answer = client.get(f"/api/lights/{given['id']}")
    texels = np.frombuffer(answer.content, np.float16).astype(np.float64)
    assert np.isfinite(texels).all()
    assert texels.max() * float(answer.headers["x-scale"]) == pytest.approx(1e6, rel=1e-3)


def test_files_that_are_no_light_are_refused_by_name(client, tmp_path):
    nan = np.full((4, 8, 3), np.nan)
    for data, words in (
        (exr(tmp_path / "nan.exr", nan), "NaN"),
        (exr(tmp_path / "square.exr", np.ones((8, 8, 3))), "W = 2H"),
        (b"no picture", "no OpenEXR"),
        (b"\x76\x2f\x31\x01 cut off", "mine.exr"),
        (b"", "empty"),
    ):
        text = sentence(
            client.post("/api/lights", content=data, headers={"x-file-name": "..%2Fmine.exr"}), 422
        )
        assert words in text
        assert "light-" not in text  # what it is called here
        assert "/" not in text


def test_what_http_itself_refuses_is_a_sentence_too(client):
    assert sentence(client.delete("/api/lights"), 405) == "Method Not Allowed."
    sentence(client.put("/api/scenes/0/box", content=b"{", headers={"content-type": "application/json"}), 422)
    sentence(
        client.put("/api/scenes/0/box", content=b"\xbf", headers={"content-type": "application/json"}), 400
    )


def test_files_are_sent_whole_whatever_part_is_asked_for(client):
    for asked in ("bytes=1-3", "images", "bytes=9-1,,"):
        answer = client.get("/static/js/app.js", headers={"range": asked})
        assert (answer.status_code, answer.content) == (200, (STATIC / "js" / "app.js").read_bytes())


def test_a_client_that_goes_while_it_sends_leaves_no_error_and_no_file(client, tmp_path):
    settings = server_settings(Watched(client.app))
    data = b"POST /api/lights HTTP/1.1\r\nhost: testserver\r\nx-lightprobe: 1\r\ncontent-length: 9\r\n\r\nabc"
    (answer,), _ = asyncio.run(exchange(settings, data))
    assert (answer.error, answer.gone) == (None, True)
    assert list((tmp_path / "session" / "uploads").iterdir()) == []


def test_hostile_names_are_only_shown(client, tmp_path):
    data = exr(tmp_path / "x.exr", side_light(0).panorama())
    name = "..%2F..%2F..%2Fevil%00%0A<script>.exr"
    given = client.post("/api/lights", content=data, headers={"x-file-name": name}).json()
    kept = sorted(path.name for path in (tmp_path / "session" / "uploads").iterdir())
    assert kept == [f"light-{given['id']}.exr"]


def test_a_file_that_is_too_large_is_refused_before_it_is_read(client, tmp_path, monkeypatch):
    """By what the request says of its length, or after as many bytes as may come."""
    monkeypatch.setitem(uploads_module.LIMITS, UploadKind.PHOTO, 2**20)
    text = sentence(client.post("/api/runs/0/predictions", content=b"x" * (2**20 + 1)), 413)
    assert "too large: at most 1 MB" in text
    pieces = (b"x" * 2**18 for _ in range(9))  # of unknown length
    sentence(client.post("/api/runs/0/predictions", content=pieces), 413)
    assert list((tmp_path / "session" / "uploads").iterdir()) == []


def test_a_photo_becomes_a_task_and_a_text_does_not(client, run):
    photo = (run.path.parent / "scene" / "test" / "test_00.png").read_bytes()
    task = client.post("/api/runs/0/predictions", content=photo, headers={"x-file-name": "a.png"}).json()
    assert (task["kind"], task["title"]) == ("predict", "a.png")
    assert "b.png" in sentence(
        client.post("/api/runs/0/predictions", content=b"hello", headers={"x-file-name": "b.png"}), 422
    )
    assert client.post(f"/api/tasks/{task['id']}/stop").status_code == 200
    sentence(client.get("/api/tasks/none"), 422)
    sentence(client.get(f"/api/tasks/{task['id']}/files/..%2F..%2Fx"), 404)


@pytest.mark.parametrize("buffers", [[], [{"uri": "../../etc/passwd", "byteLength": 9}]])
def test_a_glb_that_cannot_be_used_is_refused_by_name(client, buffers):
    content = glb({"asset": {"version": "2.0"}, "buffers": buffers})
    text = sentence(client.post("/api/objects", content=content, headers={"x-file-name": "mine.glb"}), 422)
    assert "mine.glb" in text
    assert "object-" not in text


def test_without_the_pages_header_nothing_is_changed(client):
    bare = TestClient(client.app, raise_server_exceptions=False)
    for path in ("/api/lights", "/api/objects", "/api/runs/0/predictions", "/api/runs/0/preview"):
        sentence(bare.post(path, content=b"x"), 403)


def test_a_training_is_told_from_where_the_page_left_off(client, run):
    first = client.get("/api/runs/0/training").json()
    assert [record["step"] for record in first["records"]] == [1, 2, 7]
    assert first["phases"][0]["finished"]
    again = client.get(f"/api/runs/0/training?after={first['next']}").json()
    assert again["records"] == []
    assert client.get("/api/runs/0/training?after=999999").json()["from"] == 0


def test_links_out_of_a_run_are_not_followed(tmp_path, run, client_of):
    copy = tmp_path / "run"
    copy.mkdir()
    (copy / "config.json").write_text("{}")
    (copy / "mesh").symlink_to(run.mesh_folder)
    assert "lies outside" in sentence(client_of(copy).get("/api/runs/0/object.glb"), 422)


def test_a_folder_that_is_no_run_is_named(tmp_path):
    with pytest.raises(InputError, match="neither a run"):
        Sources.of([tmp_path])
