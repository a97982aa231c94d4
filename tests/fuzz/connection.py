"""A connection to an application in this process: the HTTP server's own reading of bytes, without a network."""

import asyncio
from dataclasses import dataclass, field
from typing import Any

import h11
import uvicorn
from uvicorn.server import ServerState

from lightprobe.web.asgi import App, Message, Receive, Scope, Send

_PIECE = 1000  # bytes that arrive together


@dataclass
class Answer:
    """What an application answered to one request, None as status where nothing was."""

    method: str
    path: str
    status: int | None = None
    headers: dict[str, str] = field(default_factory=dict)
    body: bytearray = field(default_factory=bytearray)
    ended: bool = False
    gone: bool = False  # whether it knows that its client has gone
    error: BaseException | None = None  # that left the application


class Watched:
    """An application whose answers are kept, and of which is known whether it waits for more of a request."""

    def __init__(self, app: App):
        """Watch `app`."""
        self._app, self.answers, self.receiving, self.changed = app, [], 0, asyncio.Event()

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer one request."""
        answer = Answer(scope["method"], scope["path"])
        self.answers.append(answer)

        async def noted_receive() -> Message:
            self.receiving += 1
            self.changed.set()
            try:
                message = await receive()
                answer.gone = answer.gone or message["type"] == "http.disconnect"
                return message
            finally:
                self.receiving -= 1

        async def noted_send(message: Message) -> None:
            if message["type"] == "http.response.start":
                answer.status = message["status"]
                answer.headers = {k.decode("latin-1"): v.decode("latin-1") for k, v in message["headers"]}
            else:
                answer.body += message.get("body", b"")
                answer.ended = not message.get("more_body", False)
            await send(message)

        try:
            await self._app(scope, noted_receive, noted_send)
        except BaseException as error:
            answer.error = error
            raise
        finally:
            self.changed.set()


class _Transport(asyncio.Transport):
    """Keeps what is written."""

    def __init__(self, changed: asyncio.Event):
        super().__init__({"peername": ("127.0.0.1", 50000), "sockname": ("127.0.0.1", 80)})
        self.written, self.closed, self._changed = bytearray(), False, changed

    def write(self, data: Any) -> None:
        self.written += data
        self._changed.set()

    def close(self) -> None:
        self.closed = True
        self._changed.set()

    def is_closing(self) -> bool:
        return self.closed

    def pause_reading(self) -> None:
        """Everything is read already."""

    resume_reading = pause_reading


async def exchange(settings: uvicorn.Config, data: bytes) -> tuple[list[Answer], bytes]:
    """Send `data` over a new connection and close it once nothing more can come of it.

    settings: of a server whose application is a `Watched`. Returns the answers, and all bytes that came back.
    """
    if not settings.loaded:
        settings.load()
    watched: Any = settings.app
    watched.answers, watched.changed, state = [], asyncio.Event(), ServerState()
    transport = _Transport(watched.changed)
    protocol: Any = settings.http_protocol_class(config=settings, server_state=state, app_state={})  # type: ignore[operator]
    protocol.connection_made(transport)
    for start in range(0, len(data), _PIECE):
        if transport.closed:
            break
        protocol.data_received(data[start : start + _PIECE])
        await asyncio.sleep(0)

    def over() -> bool:
        """Return whether the connection is closed, or waits for bytes that do not come."""
        if transport.closed or protocol.cycle is None or protocol.cycle.response_complete:
            return True
        return watched.receiving > 0 and protocol.conn.their_state is h11.SEND_BODY

    while not over():
        watched.changed.clear()
        await watched.changed.wait()
    protocol.connection_lost(None)
    while state.tasks:
        await asyncio.wait(state.tasks)
    return watched.answers, bytes(transport.written)
