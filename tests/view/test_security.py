"""Requests of strangers are refused before anything is done for them."""

import asyncio
import json

import pytest

from lightprobe.view.security import Guard, content_policy

HOSTS = frozenset({"127.0.0.1:8421", "localhost:8421"})
OWN = {"host": "127.0.0.1:8421", "x-lightprobe": "1"}


async def _answers(scope, receive, send):
    await send({"type": "http.response.start", "status": 200, "headers": []})
    await send({"type": "http.response.body", "body": b"{}"})


def ask(headers, *, method="GET", path="/api/session", query="", token=None):
    """Return status, headers and body of a request to a guarded application."""
    guard, sent = Guard(_answers, HOSTS, token, content_policy([])), []

    async def send(message):
        sent.append(message)

    scope = {
        "type": "http",
        "method": method,
        "path": path,
        "query_string": query.encode(),
        "headers": [(name.encode(), value.encode()) for name, value in headers.items()],
    }
    asyncio.run(guard(scope, None, send))
    return sent[0]["status"], {k.decode(): v.decode() for k, v in sent[0]["headers"]}, sent[1]["body"]


def test_the_page_itself_is_answered():
    status, headers, _ = ask(OWN)
    assert status == 200
    assert "default-src 'none'" in headers["content-security-policy"]
    assert headers["x-content-type-options"] == "nosniff"


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


def test_the_page_can_post():
    assert (
        ask({**OWN, "origin": "http://127.0.0.1:8421", "sec-fetch-site": "same-origin"}, method="POST")[0]
        == 200
    )


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
    assert ask({**OWN, "cookie": "\x01=;;=" + "a" * 99}, token="secret")[0] == 401
