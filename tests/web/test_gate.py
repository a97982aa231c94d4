"""Requests of strangers, and bodies that are too large, are refused before anything is done for them."""

import asyncio
import json

import pytest

from lightprobe.web.gate import Gate, names_loopback

HOSTS = ("127.0.0.1:8421", "localhost:8421")
OWN = {"host": "127.0.0.1:8421", "x-lightprobe": "1"}
POLICY = (b"content-security-policy", b"default-src 'none'")


async def _answers(scope, receive, send):
    while (await receive()).get("more_body", False):
        pass
    await send({"type": "http.response.start", "status": 200, "headers": []})
    await send({"type": "http.response.body", "body": b"{}"})


def ask(headers, *, method="GET", path="/api/session", query="", token=None, body=b"", **rules):
    """Return status, headers and body of a request to an application behind the gate of a page."""
    rules = {"largest": 100, "hosts": HOSTS.__contains__, "cookie": "lightprobe-8421", **rules}
    gate, sent = Gate(_answers, token=token, headers=[POLICY], **rules), []

    async def send(message):
        sent.append(message)

    async def receive():
        return {"type": "http.request", "body": body, "more_body": False}

    scope = {
        "type": "http",
        "method": method,
        "path": path,
        "query_string": query.encode(),
        "headers": [(name.encode(), value.encode()) for name, value in headers.items()],
    }
    asyncio.run(gate(scope, receive, send))
    return sent[0]["status"], {k.decode(): v.decode() for k, v in sent[0]["headers"]}, sent[1]["body"]


def test_the_page_itself_is_answered_and_can_post():
    status, headers, _ = ask(OWN)
    assert status == 200
    assert "default-src 'none'" in headers["content-security-policy"]
    assert (headers["x-content-type-options"], headers["cache-control"]) == ("nosniff", "no-store")
    own = {**OWN, "origin": "http://127.0.0.1:8421", "sec-fetch-site": "same-origin"}
    assert ask(own, method="POST")[0] == 200


@pytest.mark.parametrize("host", ["evil.example:8421", "127.0.0.1:9999", "127.0.0.1", ""])
def test_another_name_for_this_machine_is_refused(host):
    """A site that resolves to 127.0.0.1 must not be answered: DNS rebinding."""
    status, _, body = ask({**OWN, "host": host})
    assert status == 403
    assert "own address" in json.loads(body)["sentence"]


@pytest.mark.parametrize(
    "headers",
    [
        {"host": "127.0.0.1:8421"},  # a form of another site sends no header of ours
        {**OWN, "origin": "http://evil.example"},
        {**OWN, "origin": "null"},
        {**OWN, "origin": "https://127.0.0.1:8421"},
        {**OWN, "sec-fetch-site": "cross-site"},
        {**OWN, "sec-fetch-site": "same-site"},
    ],
)
def test_another_site_cannot_post(headers):
    assert ask(headers, method="POST")[0] == 403


def test_another_site_cannot_embed_but_may_link():
    foreign = {**OWN, "sec-fetch-site": "cross-site"}
    assert ask(foreign)[0] == 403
    assert ask(foreign, path="/")[0] == 200


def test_a_token_is_asked_for_and_kept_in_a_cookie():
    assert ask(OWN, token="secret")[0] == 401
    assert ask(OWN, path="/", query="token=wrong", token="secret")[0] == 401
    assert ask(OWN, path="/api/session", query="token=secret", token="secret")[0] == 401
    status, headers, _ = ask(OWN, path="/", query="token=secret", token="secret")
    assert (status, headers["location"]) == (303, "/")
    assert "HttpOnly" in headers["set-cookie"]
    assert "SameSite=Strict" in headers["set-cookie"]
    cookie = headers["set-cookie"].partition(";")[0]
    assert ask({**OWN, "cookie": cookie}, token="secret")[0] == 200
    assert ask({**OWN, "cookie": cookie + "x"}, token="secret")[0] == 401
    for nonsense in ("\x01=;;=" + "a" * 99, 'a[]="b', "a\tb=c"):
        assert ask({**OWN, "cookie": nonsense}, token="secret")[0] == 401


def test_a_body_is_refused_by_its_length_or_by_what_has_come():
    assert ask({**OWN, "content-length": "100"}, method="POST", body=bytes(100))[0] == 200
    for length in ("101", "9" * 30):
        status, _, body = ask({**OWN, "content-length": length}, method="POST")
        assert (status, json.loads(body)["sentence"][:25]) == (413, "The request is too large:")
    with pytest.raises(Exception, match="at most 100 bytes are taken"):
        ask(OWN, method="POST", body=bytes(101))


@pytest.mark.parametrize(
    ("host", "own"),
    [("127.0.0.1:8422", True), ("localhost", True), ("[::1]:9", True), ("127.9.9.9", True)]
    + [(host, False) for host in ("", "evil.example", "0.0.0.0", "[::1", "127.0.0.1.evil.example")],
)
def test_names_that_lead_to_this_machine_from_this_machine_alone(host, own):
    assert names_loopback(host) is own
