"""An application that answers on a socket until a signal ends it."""

import asyncio
import socket
from typing import Any

import uvicorn
from uvicorn.protocols.http.h11_impl import H11Protocol

from lightprobe.service.asgi import App, Lingering

_CONNECTIONS = 1000  # that are served at once
_HEADER_SECONDS = 15.0  # in which a request's head must arrive, on a new connection or one that was kept open


def run_app(app: App, listening: socket.socket, *, grace: int, log_config: dict[str, Any] | None) -> None:
    """Answer requests on a socket until a signal comes; those that are at work then get `grace` seconds.

    log_config: of the library's own messages (`logging.config`), None where logging is set up already.
    """
    uvicorn.Server(server_settings(app, grace=grace, log_config=log_config)).run(sockets=[listening])


def server_settings(app: App, *, grace: int, log_config: dict[str, Any] | None) -> uvicorn.Config:
    """Return how the HTTP server treats connections and requests; see `run_app`."""
    return uvicorn.Config(
        Lingering(app),
        http=_ImpatientProtocol,
        log_level="warning",
        log_config=log_config,
        access_log=False,
        server_header=False,
        timeout_graceful_shutdown=grace,
        lifespan="off",
        limit_concurrency=_CONNECTIONS,
        ws="none",
    )


class _ImpatientProtocol(H11Protocol):
    """A connection that is closed when no whole head of a request comes for a while; uvicorn's own waits for
    ever.

    A body that turns out to be damaged ends its request as if the client had gone: the answer that the
    application would still give cannot be sent any more, and uvicorn would log a traceback for it.
    """

    _patience: asyncio.TimerHandle | None = None

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        super().connection_made(transport)
        self._wait_for_head()

    def on_response_complete(self) -> None:
        super().on_response_complete()
        self._wait_for_head()

    def connection_lost(self, exc: Exception | None) -> None:
        if self._patience is not None:
            self._patience.cancel()
        super().connection_lost(exc)

    def send_400_response(self, msg: str) -> None:
        cycle = self.cycle
        if cycle is None or cycle.response_complete:
            super().send_400_response(msg)
            return
        cycle.disconnected = True
        cycle.message_event.set()
        if cycle.response_started:
            self.transport.close()
        else:
            super().send_400_response(msg)

    def _wait_for_head(self) -> None:
        if self._patience is not None:
            self._patience.cancel()
        self._patience = self.loop.call_later(_HEADER_SECONDS, self._close_without_head)

    def _close_without_head(self) -> None:
        if self.cycle is None or self.cycle.response_complete:
            self.transport.close()
