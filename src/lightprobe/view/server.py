"""The page from start to end: what is shown, where it listens, and what is removed afterwards."""

import io
import secrets
import socket
import tempfile
import webbrowser
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from lightprobe.core.errors import ResourceError
from lightprobe.core.extras import extra_library
from lightprobe.core.partial import partial_folder
from lightprobe.view.sources import Sources
from lightprobe.web.listening import listening_socket, run_app, until_interrupted
from lightprobe.web.worker import WorkerProcess, worker_command

PORT = 8421
"""Where the page is unless another port is asked for."""

_LOCAL = "127.0.0.1"
_HTTP = 80  # port of an address without one
_TOKEN_BYTES = 16  # random ones in a token
# An address set aside for documentation (RFC 5737): asking which way it lies sends nothing.
_SOMEWHERE = ("192.0.2.1", 9)


def serve(
    folders: Sequence[Path],
    *,
    port: int = PORT,
    lan: bool = False,
    browser: bool = True,
    device: str = "auto",
    tell: Callable[[str], None] = print,
) -> None:
    """Serve the page of runs, and of scenes to correct, until it is interrupted.

    folders: runs, scenes that `lightprobe prepare` made, or folders of photos. lan: let devices in the same
    network open it, too, by an address with a token, which `tell` is given with a QR code. browser: open it
    here. Everything that is uploaded or computed lies in a temporary folder, which goes with the server.
    Raises `InputError` for a folder that is none of these, `ConfigError` for a port that is none or without
    the extra `view`, `ResourceError` for a port in use.
    """
    for library in ("fastapi", "uvicorn", *(["segno"] if lan else [])):
        extra_library(library, "The page of a run", "view")
    from uvicorn.config import LOGGING_CONFIG

    from lightprobe.view.app import create_app
    from lightprobe.view.routes import Session

    sources, command = Sources.of(folders), worker_command("lightprobe.view.worker", device)
    address = open_address(port, lan=lan)
    with until_interrupted(), address.listening, partial_folder(Path(tempfile.gettempdir())) as folder:
        tell(f"Page: {address.local_url}   (end with Ctrl-C)")
        if address.network_url is not None:
            tell(f"For the phone, in the same network: {address.network_url}")
            tell(qr_code(address.network_url))
        if browser:
            webbrowser.open(address.local_url)
        session = Session.within(folder, sources, lambda number: WorkerProcess(command))
        try:
            app = create_app(session, address.hosts, address.token)
            run_app(app, address.listening, grace=2, log_config=LOGGING_CONFIG)
        finally:
            session.tasks.pool.close()


@dataclass(frozen=True)
class Address:
    """Where the page can be opened."""

    listening: socket.socket
    port: int
    token: str | None  # asked for where others can reach the page
    network: str | None  # this machine's address in its network

    @property
    def hosts(self) -> frozenset[str]:
        """The names under which the page may be asked for, with the port, which browsers leave out if it is 80."""
        names = [_LOCAL, "localhost", *([] if self.network is None else [self.network])]
        return frozenset([f"{name}:{self.port}" for name in names] + (names if self.port == _HTTP else []))

    @property
    def local_url(self) -> str:
        """The address for this machine's browser."""
        return self._url(_LOCAL)

    @property
    def network_url(self) -> str | None:
        """The address for a phone in the same network."""
        return None if self.network is None else self._url(self.network)

    def _url(self, host: str) -> str:
        query = "" if self.token is None else f"?token={self.token}"
        return f"http://{host}:{self.port}/{query}"


def open_address(port: int, *, lan: bool) -> Address:
    """Return a listening socket with its names; port 0 takes a free one.

    Raises `ConfigError` for a port that is none, `ResourceError` for one in use or when there is no network.
    """
    network = _own_address() if lan else None
    listening = listening_socket("" if lan else _LOCAL, port)
    token = secrets.token_urlsafe(_TOKEN_BYTES) if lan else None
    return Address(listening, listening.getsockname()[1], token, network)


def _own_address() -> str:
    """Return this machine's address in its network; raise `ResourceError` without one."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.connect(_SOMEWHERE)
            return str(probe.getsockname()[0])
        except OSError as error:
            raise ResourceError(
                "--lan needs a network, and this machine is in none; leave the option out."
            ) from error


def qr_code(text: str) -> str:
    """Return a QR code for a terminal, two rows of modules to a line; raise `ConfigError` without segno."""
    segno = extra_library("segno", "A QR code", "view")
    out = io.StringIO()
    segno.make(text, micro=False, error="l").terminal(out, border=2, compact=True)
    return out.getvalue().rstrip("\n")
