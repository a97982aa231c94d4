"""Whatever bytes come as a form or a file, there is a form, a file or a sentence."""

import contextlib

import pytest
from fastapi import FastAPI
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from starlette.requests import Request
from starlette.testclient import TestClient

from lightprobe.web.asgi import answer_failures
from lightprobe.web.uploads import receive_form, shown_name

LIMITS = {"photo": 1000, "size": 20}
TYPE = "multipart/form-data; boundary=b"


def part(name, data, filename=None, extra=b""):
    file = b"" if filename is None else f'; filename="{filename}"'.encode()
    head = b'--b\r\ncontent-disposition: form-data; name="' + name.encode() + b'"' + file + b"\r\n"
    return head + extra + b"\r\n" + data + b"\r\n"


GOOD = part("photo", b"0123\r\n--4", "a.jpg") + part("size", b"128") + part("size", b"256") + b"--b--\r\n"


@pytest.fixture
def send(tmp_path):
    """Send a body to an application that takes a form and tells what was in it."""
    app = FastAPI()
    answer_failures(app)

    @app.post("/")
    async def take(request: Request):
        form = await receive_form(request, tmp_path, LIMITS)
        parts = {
            key: [one.name, one.path.name, one.path.read_bytes().decode()] for key, one in form.parts.items()
        }
        return {"parts": parts, "texts": form.texts}

    client = TestClient(app, raise_server_exceptions=False)
    return lambda body, kind=TYPE: client.post("/", content=body, headers={"content-type": kind})


@pytest.mark.parametrize("piece", [1, 3, 1000])
def test_files_and_texts_are_told_apart(send, piece):
    told = send(GOOD[i : i + piece] for i in range(0, len(GOOD), piece)).json()
    name, kept, text = told["parts"]["photo"]
    assert (name, kept.endswith(".jpg"), text) == ("a.jpg", True, "0123\r\n--4")
    assert told["texts"] == {"size": "128,256"}


@pytest.mark.parametrize(
    "name", ["../../etc/passwd", "..\\\\x", "/etc/passwd.png", "a%2Fb", "\x00", "a" * 3000, "é.png"]
)
def test_names_of_files_are_never_used(send, tmp_path, name):
    shown, kept, _ = send(part("photo", b"x", name) + b"--b--\r\n").json()["parts"]["photo"]
    assert [path.name for path in tmp_path.iterdir()] == [kept]
    assert kept.startswith("photo-")
    assert "/" not in shown


@pytest.mark.parametrize(
    ("body", "status", "words"),
    [
        (b"nonsense" * 9, 422, "no form that can be read"),
        (part("nix", b"") + b"--b--\r\n", 422, "no field 'nix'"),
        (part("photo", b"x", "a") * 2 + b"--b--\r\n", 422, "two files"),
        (part("photo", b"", "a") + b"--b--\r\n", 422, "empty"),
        (part("size", b"") * 70 + b"--b--\r\n", 422, "Too many fields"),
        (part("photo", b"x", "a", b"x: " + b"y" * 9000 + b"\r\n"), 422, "no form that can be read"),
        (b"--b\r\n\r\nx\r\n--b--\r\n", 422, "no form that can be read"),
        (part("size", bytes(2**21)) + b"--b--\r\n", 422, "Part exceeded"),
        (part("size", b"1" * 21) + b"--b--\r\n", 413, "'size' is too large: at most 20 bytes"),
        (part("photo", bytes(1001), "a.jpg") + b"--b--\r\n", 413, "'photo' is too large"),
    ],
)
def test_a_form_that_cannot_be_used_is_a_sentence(send, tmp_path, body, status, words):
    answer = send(body)
    assert answer.status_code == status
    assert words in answer.json()["sentence"]
    assert answer.json()["sentence"].endswith(".")
    assert all(path.stat().st_size <= 1000 for path in tmp_path.iterdir())


@pytest.mark.parametrize("body", [GOOD[:-20], b"", GOOD[:60]])
def test_what_ends_in_the_middle_of_a_field_is_without_the_field(send, body):
    answer = send(body)
    assert answer.status_code == 422 or answer.json()["texts"] in ({}, {"size": "128"})


@pytest.mark.parametrize("kind", ["", "application/json", "multipart/form-data", "text/multipart/form-data"])
def test_another_kind_of_body_is_refused(send, kind):
    assert send(GOOD, kind).status_code in (415, 422)


@settings(max_examples=60, suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None)
@given(st.lists(st.tuples(st.integers(0, len(GOOD)), st.integers(0, 4), st.binary(max_size=4)), max_size=5))
def test_whatever_bytes_come_there_is_a_form_or_a_sentence(send, edits):
    body = GOOD
    for place, removed, new in edits:
        body = body[:place] + new + body[place + removed :]
    with contextlib.suppress(KeyError):
        assert send(body).json()["sentence"].endswith(".")


@given(st.text())
def test_a_name_is_shown_short_printable_and_without_folders(name):
    shown = shown_name(name)
    assert 0 < len(shown) <= 80
    assert shown.isprintable()
    assert "/" not in shown
