"""The HTTP server's reading of bytes: what becomes of a request whose body turns out to be damaged."""

import asyncio

import pytest

from lightprobe.service.asgi import reply
from lightprobe.service.running import server_settings
from tests.fuzz.connection import Watched, exchange

HEAD = b"POST / HTTP/1.1\r\nhost: a\r\ntransfer-encoding: chunked\r\n\r\n"


async def whole(scope, receive, send):
    """Answer when the whole body has come, or nobody is there any more."""
    while (await receive()).get("more_body", False):
        pass
    await reply(send, 200, "Well.")


async def early(scope, receive, send):
    """Answer at once, and take the body afterwards."""
    await reply(send, 200, "Well.")


@pytest.mark.parametrize(
    ("app", "body", "starts"),
    [
        (whole, b"3\r\nabc\r\n0\r\n\r\n", b"HTTP/1.1 200"),
        (whole, b"3\r\nabc\r\nx\r\n\r\n", b"HTTP/1.1 400"),
        (early, b"3\r\nabc\r\n0\r\n\r\n", b"HTTP/1.1 200"),
        (early, b"3\r\n" + 2000 * b"x", b"HTTP/1.1"),
    ],
)
def test_a_damaged_body_ends_its_request_without_an_error(app, body, starts, caplog):
    settings = server_settings(app, grace=1, log_config=None)
    watched = Watched(settings.app)
    settings.app = watched
    (answer,), raw = asyncio.run(exchange(settings, watched, HEAD + body))
    assert raw.startswith(starts)
    assert answer.error is None
    assert not [record for record in caplog.records if record.exc_info]
