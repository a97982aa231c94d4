"""A socket that a server listens on, the server on it, and how signals end what it does."""

import contextlib
import ipaddress
import signal
import socket
import threading
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

from lightprobe.core.errors import ConfigError, ResourceError

if TYPE_CHECKING:  # needs an extra
    import uvicorn

    from lightprobe.web.asgi import App

_BACKLOG = 128  # connections that may wait to be taken
_CONNECTIONS = 1000  # that are served at once


def is_loopback(host: str) -> bool:
    """Return whether an address can be reached from this machine alone."""
    try:
        return host.lower() == "localhost" or ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False


def listening_socket(host: str, port: int) -> socket.socket:
    """Return a socket that listens on an address of this machine; port 0 takes a free one, host "" means all.

    Raises `ConfigError` for a port that is none, `ResourceError` for an address that cannot be used.
    """
    if not 0 <= port <= 65535:
        raise ConfigError(f"--port {port} is no port; give a number from 1024 to 65535, or 0 for a free one.")
    listening = socket.socket(socket.AF_INET6 if ":" in host else socket.AF_INET, socket.SOCK_STREAM)
    listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        listening.bind((host, port))
        listening.listen(_BACKLOG)
    except (OSError, UnicodeError) as error:
        listening.close()
        where = f"Port {port}" if host in ("", "127.0.0.1") else f"Port {port} of {host}"
        raise ResourceError(
            f"{where} cannot be used ({getattr(error, 'strerror', None) or error}); choose another with --port."
        ) from error
    return listening


@contextlib.contextmanager
def until_interrupted() -> Iterator[None]:
    """Let Ctrl-C and SIGTERM end what is inside as every end does: what is open there is closed and removed."""
    main = threading.current_thread() is threading.main_thread()  # only there signals can be handled
    before = signal.signal(signal.SIGTERM, signal.default_int_handler) if main else None
    try:
        with contextlib.suppress(KeyboardInterrupt):
            yield
    finally:
        if main:
            signal.signal(signal.SIGTERM, before)


def run_app(app: "App", listening: socket.socket, *, grace: int, log_config: dict[str, Any] | None) -> None:
    """Answer requests on a socket until a signal comes; those that are at work then get `grace` seconds.

    log_config: of uvicorn's own messages (`logging.config`), None where logging is set up already.
    """
    import uvicorn

    uvicorn.Server(server_settings(app, grace=grace, log_config=log_config)).run(sockets=[listening])


def server_settings(
    app: "App", *, grace: int = 1, log_config: dict[str, Any] | None = None
) -> "uvicorn.Config":
    """Return how uvicorn treats connections and requests; see `run_app`."""
    import uvicorn

    return uvicorn.Config(
        app,
        http="h11",
        ws="none",
        lifespan="off",
        log_level="warning",
        log_config=log_config,
        access_log=False,
        server_header=False,
        timeout_graceful_shutdown=grace,
        limit_concurrency=_CONNECTIONS,
    )
