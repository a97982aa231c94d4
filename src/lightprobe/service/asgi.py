"""Small parts of every application here: types, short answers, secrets compared, connections that end
politely.
"""

import asyncio
import hmac
import json
from collections.abc import Awaitable, Callable, Iterable, MutableMapping
from typing import Any

Message = MutableMapping[str, Any]
Scope = MutableMapping[str, Any]
Receive = Callable[[], Awaitable[Message]]
Send = Callable[[Message], Awaitable[None]]
App = Callable[[Scope, Receive, Send], Awaitable[None]]
Headers = Iterable[tuple[bytes, bytes]]

_LINGER_SECONDS = 2.0  # for which the rest of a refused body is taken and thrown away
_LINGER_BYTES = 2**24  # of it


def same_secret(given: str, secret: str) -> bool:
    """Return whether a secret was given, in a time that tells nothing of how much of it was right."""
    return hmac.compare_digest(
        given.encode("utf-8", "surrogatepass"), secret.encode("utf-8", "surrogatepass")
    )


def headers_of(scope: Scope) -> dict[str, str]:
    """Return the headers of a request by their names in lower case; of one that is there twice the last."""
    return {name.decode("latin-1").lower(): value.decode("latin-1") for name, value in scope["headers"]}


async def reply(send: Send, status: int, sentence: str, headers: Headers = ()) -> None:
    """Answer with a status and one sentence as JSON."""
    body = json.dumps({"sentence": sentence}).encode()
    length = (b"content-length", str(len(body)).encode())
    start = [(b"content-type", b"application/json"), length, *headers]
    await send({"type": "http.response.start", "status": status, "headers": start})
    await send({"type": "http.response.body", "body": body})


class Lingering:
    """An application whose early answers are read: the rest of a body that was refused is taken, for a while.

    A server that closes a connection with unread bytes resets it, and the client then reports a broken
    connection instead of the refusal that was sent before (RFC 9112, section 9.6).
    """

    def __init__(self, app: App, seconds: float = _LINGER_SECONDS):
        """Take bodies for at most `seconds` after the answer."""
        self._app, self._seconds = app, seconds

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer one request."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        names = headers_of(scope)
        taken = 0
        complete = "transfer-encoding" not in names and names.get("content-length", "0") == "0"

        async def receive_noting() -> Message:
            nonlocal complete, taken
            message = await receive()
            taken += len(message.get("body", b""))
            complete = complete or message["type"] == "http.disconnect" or not message.get("more_body", False)
            return message

        async def send_lingering(message: Message) -> None:
            last = message["type"] == "http.response.body" and not message.get("more_body", False)
            if not last or complete:
                await send(message)
                return
            await send({**message, "more_body": True})
            until = taken + _LINGER_BYTES
            try:
                async with asyncio.timeout(self._seconds):
                    while not complete and taken < until:
                        await receive_noting()
            except TimeoutError:
                pass
            await send({"type": "http.response.body", "body": b"", "more_body": False})

        await self._app(scope, receive_noting, send_lingering)
