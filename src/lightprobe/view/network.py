"""The page's address: a socket on this machine alone or on the network at home, a token, a QR code for the
phone.
"""

import secrets
import socket
from dataclasses import dataclass

from lightprobe.core.errors import ResourceError
from lightprobe.core.extras import extra_library
from lightprobe.web.listening import listening_socket

_LOCAL = "127.0.0.1"
_HTTP = 80  # port of an address without one
_TOKEN_BYTES = 16  # random ones in a token
# An address set aside for documentation (RFC 5737): asking which way it lies sends nothing.
_SOMEWHERE = ("192.0.2.1", 9)


@dataclass(frozen=True)
class Address:
    """Where the page can be opened."""

    listening: socket.socket
    port: int
    token: str | None  # asked for where others can reach the page
    network: str | None  # this machine's address in its network

    @property
    def hosts(self) -> frozenset[str]:
        """The names under which the page may be asked for, each with its port, which browsers leave out if it
        is 80.
        """
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
    rows = [
        [bool(cell) for cell in row] for row in segno.make(text, micro=False, error="l").matrix_iter(border=2)
    ]
    if len(rows) % 2:
        rows.append([False] * len(rows[0]))
    # Light modules are drawn, so that the code reads on a dark terminal; most readers take it inverted, too.
    blocks = {(False, False): "█", (False, True): "▀", (True, False): "▄", (True, True): " "}
    pairs = zip(rows[::2], rows[1::2], strict=True)
    return "\n".join(
        "".join(blocks[pair] for pair in zip(upper, lower, strict=True)) for upper, lower in pairs
    )
