"""Forms are taken apart as they arrive; whatever bytes come, the answer is a form or a sentence."""

import asyncio
import contextlib
import random

import pytest
from starlette.requests import Request

from lightprobe.core.errors import InputError, LightprobeError
from lightprobe.service.errors import MediaTypeError, TooLargeError
from lightprobe.service.multipart import receive_form

LIMITS = {"photo": 1000, "size": 20}
TYPE = "multipart/form-data; boundary=b"


def part(name, data, filename=None, extra=b""):
    file = b"" if filename is None else f'; filename="{filename}"'.encode()
    head = b'--b\r\ncontent-disposition: form-data; name="' + name.encode() + b'"' + file + b"\r\n"
    return head + extra + b"\r\n" + data + b"\r\n"


GOOD = part("photo", b"0123\r\n--4", "a.jpg") + part("size", b"128") + part("size", b"256") + b"--b--\r\n"


def receive(body, folder, kind=TYPE, piece=7, headers=()):
    """Return the form of a body that arrives in small pieces."""
    pieces = [body[i : i + piece] for i in range(0, len(body), piece)]
    waiting = [{"type": "http.request", "body": one, "more_body": True} for one in pieces]
    waiting.append({"type": "http.request", "body": b"", "more_body": False})

    async def next_message():
        return waiting.pop(0)

    given = [(b"content-type", kind.encode()), *headers]
    request = Request({"type": "http", "method": "POST", "headers": given}, next_message)
    return asyncio.run(receive_form(request, folder, LIMITS)), len(waiting)


@pytest.mark.parametrize("piece", [1, 3, 1000])
def test_files_and_texts_are_told_apart(tmp_path, piece):
    form, _ = receive(GOOD, tmp_path, piece=piece)
    photo = form.parts["photo"]
    assert (photo.name, photo.path.suffix, photo.path.read_bytes()) == ("a.jpg", ".jpg", b"0123\r\n--4")
    assert form.texts == {"size": "128,256"}


@pytest.mark.parametrize(
    "name", ["../../etc/passwd", "..\\\\x", "/etc/passwd.png", "a%2Fb", "\x00", "a" * 3000, "é.png"]
)
def test_names_of_files_are_never_used(tmp_path, name):
    form, _ = receive(part("photo", b"x", name) + b"--b--\r\n", tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == [form.parts["photo"].path.name]
    assert form.parts["photo"].path.name.startswith("photo-")
    assert "/" not in form.parts["photo"].name


@pytest.mark.parametrize(
    ("body", "words"),
    [
        (GOOD[:-20], "in the middle"),
        (b"", "in the middle"),
        (b"nonsense" * 9, "no multipart"),
        (part("nix", b"") + b"--b--\r\n", "no field 'nix'"),
        (part("photo", b"x", "a") * 2 + b"--b--\r\n", "two files"),
        (part("photo", b"", "a") + b"--b--\r\n", "empty"),
        (part("size", b"") * 70 + b"--b--\r\n", "more than 64 fields"),
        (part("photo", b"x", "a", b"x: " + b"y" * 9000 + b"\r\n"), "headers of more than 8 kB|no multipart"),
        (b"--b\r\n\r\nx\r\n--b--\r\n", "no field ''"),
    ],
)
def test_a_damaged_form_is_a_sentence(tmp_path, body, words):
    with pytest.raises(InputError, match=words):
        receive(body, tmp_path)


def test_a_field_that_is_too_large_ends_the_reading(tmp_path):
    body = part("photo", b"x" * 5000, "a.jpg") + b"--b--\r\n"
    with pytest.raises(TooLargeError, match="'photo' is too large"):
        receive(body, tmp_path)
    assert max(path.stat().st_size for path in tmp_path.iterdir()) <= 1000
    with pytest.raises(TooLargeError, match="'size' is too large"):
        receive(part("size", b"1" * 21), tmp_path)
    for length in (b"9" * 30, b"99999999"):
        with pytest.raises(TooLargeError, match="request"):
            receive(GOOD, tmp_path, headers=[(b"content-length", length)])


@pytest.mark.parametrize(
    "kind", ["", "application/json", "multipart/form-data", "multipart/form-data; boundary=" + "x" * 71]
)
def test_another_kind_of_body_is_refused(tmp_path, kind):
    with pytest.raises(MediaTypeError):
        receive(GOOD, tmp_path, kind)


@pytest.mark.slow
def test_whatever_bytes_come_there_is_a_form_or_a_sentence(tmp_path):
    draw = random.Random(5)
    for _ in range(400):
        body = bytearray(GOOD)
        for _ in range(draw.randrange(1, 6)):
            place = draw.randrange(len(body))
            body[place : place + draw.randrange(4)] = draw.randbytes(draw.randrange(4))
        with contextlib.suppress(LightprobeError):
            receive(bytes(body), tmp_path, piece=draw.choice([1, 5, 400]))
