"""The service over HTTP: what it answers, what it refuses, and that it goes on whatever becomes of its
workers.
"""

import base64
import io
import json
import os
import signal
import socket
import time
import zipfile

import httpx2
import pytest

from lightprobe.service.fields import FIELDS
from tests.service.serving import PNG, log_lines, serving
from tests.web.answers import sentence

TOKEN = "a-token-that-is-long-enough"


@pytest.fixture
def served(tmp_path, monkeypatch):
    with serving(tmp_path, monkeypatch, workers=2) as one:
        yield one


def test_an_answer_is_json_an_archive_or_the_map(served):
    answer = served.predict(
        headers={"x-request-id": "mine-1"}, size="512x256", formats="exr,hdr", method="solve"
    )
    told = answer.json()
    assert (told["object"], told["request"], answer.headers["x-request-id"]) == ("cup", "mine-1", "mine-1")
    assert {file["name"]: base64.b64decode(file["base64"]) for file in told["files"]} == {
        "light.exr": b"exr",
        "light.hdr": b"hdr",
    }
    asked = told["light"]["asked"]
    assert (asked["size"], asked["method"], asked["sources"], asked["camera"]) == (
        "512x256",
        "solve",
        True,
        None,
    )
    archive = served.predict(headers={"accept": "application/zip"})
    with zipfile.ZipFile(io.BytesIO(archive.content)) as files:
        assert set(files.namelist()) == {"answer.json", "light.light.json", "light.exr", "confidence.exr"}
        assert json.loads(files.read("answer.json"))["method"] == "solve"
    for kind, content in (("image/x-exr", b"exr"), ("image/vnd.radiance", b"hdr")):
        alone = served.predict(headers={"accept": kind})
        assert (alone.headers["content-type"], alone.content) == (kind, content)
        assert alone.headers["x-lightprobe-verdict"] == "good"
    assert "application/zip" in sentence(served.predict(headers={"accept": "text/html"}), 406)


def test_what_cannot_be_is_one_sentence(served):
    for fields, words in (
        ({"method": "magic"}, "'method' must be one of"),
        ({"size": "9x9"}, "--size"),
        ({"camera": "{"}, "camera"),
        ({"camera": "[" * 10**5}, "nested"),
        ({"camera": "{}"}, "the camera"),
        ({"formats": "gif"}, "'formats'"),
        ({"sources": "maybe"}, "true or false"),
        ({"deadline": "-1"}, "'deadline'"),
        ({"nix": "1"}, "no field 'nix'"),
        ({"sun": "separate", "sources": "false"}, "'sun'"),
    ):
        assert words in sentence(served.predict(**fields), 422), fields
    assert "README.md is not a PNG" in sentence(served.predict("../README.md", content=b"text"), 422)
    assert "empty" in sentence(served.predict(content=b""), 422)
    assert sentence(served.predict("fails.png"), 422) == "This cannot be done."
    path = "/objects/cup/predict"
    assert "There is no photo" in sentence(served.client.post(path, files={"mask": ("m.png", PNG)}), 422)
    assert "multipart" in sentence(served.client.post(path, json={}), 415)
    sentence(served.client.get(path), 405)
    sentence(served.client.get("/objects?limit=0"), 422)


def test_names_never_leave_the_folder(served, tmp_path):
    (served.runs / "link").symlink_to(served.runs / "cup")
    (served.runs / ".hidden").mkdir()
    (served.runs / "unfinished").mkdir()
    for name in [
        "link",
        ".hidden",
        "unfinished",
        "nix",
        "..",
        ".",
        "%2e%2e",
        "..%2fruns%2fcup",
        "cup%00",
        "cup%2f",
    ]:
        assert served.predict(object=name).status_code in (404, 405), name
    listed = served.client.get("/objects").json()
    assert [one["name"] for one in listed["objects"]] == ["cup"]
    assert served.client.get("/objects/cup").json()["trained"] is False


def test_a_worker_killed_in_the_middle_loses_nothing(served):
    answers, thread = served.later("waits.png")
    served.until((served.runs / "cup" / "pid").exists)
    time.sleep(0.1)
    first = int((served.runs / "cup" / "pid").read_text())
    os.kill(first, signal.SIGKILL)
    (served.runs / "cup" / "go").touch()
    thread.join(20)
    assert answers[0].json()["seconds"]["pid"] != first
    assert served.metric('lightprobe_worker_ends_total{reason="died"}') == 1


def test_a_full_queue_is_told_and_what_waits_is_answered(tmp_path, monkeypatch):
    with serving(tmp_path, monkeypatch, queue=2) as served:
        begun = [served.later("waits.png")]
        served.until(lambda: "busy" in served.client.get("/ready").json()["workers"])
        begun += [served.later("waits.png") for _ in range(2)]
        served.until(lambda: served.metric("lightprobe_queue_length") == 2)
        refused = served.predict()
        assert "2 requests wait already" in sentence(refused, 429)
        assert int(refused.headers["retry-after"]) >= 1
        assert served.client.get("/ready").status_code == 503
        (served.runs / "cup" / "go").touch()
        for answers, thread in begun:
            thread.join(20)
            assert answers[0].status_code == 200


def test_a_deadline_frees_the_worker(tmp_path, monkeypatch):
    with serving(tmp_path, monkeypatch, deadline=1.0) as served:
        running = served.later("slow.png")
        served.until((served.runs / "cup" / "pid").exists)
        assert "was still waiting" in sentence(served.predict(deadline="0.2"), 504)
        running[1].join(20)
        assert "was not finished after 1 s" in sentence(running[0][0], 504)
        served.until(lambda: served.client.get("/ready").json()["workers"] == ["idle"])
        assert served.predict().status_code == 200
        assert served.metric('lightprobe_worker_ends_total{reason="deadline"}') == 1


def test_a_large_upload_is_refused_while_it_is_sent(served):
    sent = 0

    def pieces():
        nonlocal sent
        yield b'--x\r\ncontent-disposition: form-data; name="photo"; filename="a.png"\r\n\r\n'
        for _ in range(4000):
            sent += 2**18
            yield b"x" * 2**18

    headers = {"content-type": "multipart/form-data; boundary=x", "connection": "close"}
    try:
        answer = served.client.post("/objects/cup/predict", content=pieces(), headers=headers)
        assert "at most 98 MB" in sentence(answer, 413)
    except httpx2.TransportError:  # the client has not looked at the answer before the connection ended
        labels = '{route="/objects/{name}/predict",status="413"}'
        served.until(lambda: served.metric(f"lightprobe_requests_total{labels}") == 1)
    assert sent < 200 * 2**20
    announced = {**headers, "content-length": str(10**12)}
    with socket.create_connection(tuple(httpx2.URL(served.url).netloc.decode().split(":"))) as line:
        words = "".join(f"{key}: {value}\r\n" for key, value in announced.items())
        line.sendall(f"POST /objects/cup/predict HTTP/1.1\r\nhost: localhost\r\n{words}\r\n".encode())
        assert b" 413 " in line.recv(1000)


def test_a_slow_upload_is_given_up(tmp_path, monkeypatch):
    with serving(tmp_path, monkeypatch, upload_seconds=1.0, uploads=1) as served:
        host, port = httpx2.URL(served.url).netloc.decode().split(":")
        with socket.create_connection((host, port)) as line:
            line.sendall(
                b"POST /objects/cup/predict HTTP/1.1\r\nhost: localhost\r\ncontent-length: 1000\r\n"
                b"content-type: multipart/form-data; boundary=x\r\n\r\n--x\r\n"
            )
            served.until(lambda: served.metric("lightprobe_uploads") == 1)
            assert "are being sent already" in sentence(served.predict(), 429)
            answer = b""  # head and body may come apart
            while b"did not arrive within 1 s" not in answer:
                piece = line.recv(1000)
                assert piece, answer
                answer += piece
        assert served.predict().status_code == 200


def test_who_has_gone_is_not_worked_for(tmp_path, monkeypatch):
    with serving(tmp_path, monkeypatch) as served:
        running = served.later("waits.png")
        served.until((served.runs / "cup" / "pid").exists)
        with pytest.raises(httpx2.ReadTimeout):
            served.client.post("/objects/cup/predict", files={"photo": ("gone.png", PNG)}, timeout=0.3)
        served.until(lambda: served.metric("lightprobe_queue_length") == 0)
        (served.runs / "cup" / "go").touch()
        running[1].join(20)
        assert running[0][0].status_code == 200


def test_a_token_is_asked_for_and_never_logged(tmp_path, monkeypatch, capsys):
    with serving(tmp_path, monkeypatch, token=TOKEN) as served:
        for given in ("", "Bearer", "Bearer wrong-token-wrong-token", f"Basic {TOKEN}", f"Bearer {TOKEN}x"):
            headers = {"authorization": given} if given else {}
            assert "needs its token" in sentence(served.predict(headers=headers), 401)
            assert served.client.get("/objects", headers=headers).status_code == 401
        answer = served.predict(headers={"authorization": f"bearer {TOKEN}"})
        assert answer.status_code == 200
        assert served.client.get("/health").status_code == 200
    text = capsys.readouterr().err
    assert TOKEN not in text
    lines = [line for line in log_lines(text) if line["event"] == "request" and line["method"] == "POST"]
    assert [line["status"] for line in lines] == [401] * 5 + [200]
    assert (lines[-1]["object"], lines[-1]["verdict"], lines[-1]["tries"]) == ("cup", "good", 1)
    assert lines[-1]["request"] == answer.headers["x-request-id"]


def test_without_a_token_other_sites_are_refused(served):
    for headers in (
        {"host": "evil.example"},
        {"origin": "http://evil.example"},
        {"sec-fetch-site": "cross-site"},
        {"host": "[::1"},
    ):
        sentence(served.client.get("/objects", headers=headers), 403)
    assert served.client.get("/objects", headers={"host": "localhost:9"}).status_code == 200


def test_a_stop_finishes_what_was_accepted(tmp_path, monkeypatch):
    with serving(tmp_path, monkeypatch) as served:
        begun = [served.later("waits.png") for _ in range(3)]
        served.until(lambda: served.metric("lightprobe_queue_length") == 2)
        served.server.should_exit = True
        time.sleep(0.5)
        with pytest.raises(httpx2.TransportError):
            httpx2.get(f"{served.url}health", timeout=2)
        (served.runs / "cup" / "go").touch()
        for answers, thread in begun:
            thread.join(20)
            assert answers[0].status_code == 200


def test_the_interface_is_described(served):
    schema = served.client.get("/openapi.json").json()
    post = schema["paths"]["/objects/{name}/predict"]["post"]
    fields = post["requestBody"]["content"]["multipart/form-data"]["schema"]["properties"]
    assert set(fields) == set(FIELDS)
    assert set(post["responses"]["200"]["content"]) == {
        "application/json",
        "application/zip",
        "image/x-exr",
        "image/vnd.radiance",
    }
    assert {"404", "413", "429", "504"} <= set(post["responses"])
    assert post["responses"]["429"]["content"]["application/json"]["schema"]["$ref"].endswith("Refusal")
