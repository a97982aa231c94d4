"""Who may ask the service: whoever has its token, or where it has none, programs on this machine."""

import ipaddress
from collections.abc import Iterable
from urllib.parse import urlsplit

from lightprobe.core.errors import ConfigError
from lightprobe.service.asgi import App, Message, Receive, Scope, Send, headers_of, reply, same_secret

OPEN_PATHS = ("/health", "/ready")
"""Answered without a token: whoever watches the service need not know it."""

SHORTEST_TOKEN = 16
"""Characters that a token needs."""

_LOCAL_NAMES = ("localhost", "127.0.0.1", "::1")


def is_loopback(host: str) -> bool:
    """Return whether an address can be reached from this machine alone."""
    if host.lower() == "localhost":
        return True
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False


def check_access(host: str, token: str | None, *, anyone: bool) -> None:
    """Raise `ConfigError` where a service would be open to others, or a token could be guessed.

    anyone: whether that is wanted.
    """
    if token is not None and (len(token) < SHORTEST_TOKEN or not token.isascii() or not token.isprintable()):
        raise ConfigError(
            f"The token must have at least {SHORTEST_TOKEN} printable characters; make one with: openssl rand -hex 32"
        )
    if token is None and not is_loopback(host) and not anyone:
        raise ConfigError(
            f"--host {host} can be reached by others, and there is no token; give one with --token-file or in "
            "LIGHTPROBE_TOKEN, or say --anyone where something else decides who gets there."
        )


class Gate:
    """The application behind these checks.

    Without a token a site in the browser of this machine could ask it, too, under a name of its own that
    leads here (DNS rebinding) or by a form. So the host must be this machine's then, and what browsers send
    from other sites is refused.
    """

    def __init__(self, app: App, token: str | None, *, local: bool):
        """Let through what has `token` unless that is None; then, with `local`, what asks for this machine."""
        self._app, self._token, self._local = app, token, local

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer one request."""
        if scope["type"] != "http":
            return
        headers = headers_of(scope)
        if self._token is not None:
            if scope["path"] not in OPEN_PATHS and not self._has_token(headers.get("authorization", "")):
                await reply(
                    _with(send, _PRIVATE),
                    401,
                    "This service needs its token: Authorization: Bearer TOKEN.",
                    [(b"www-authenticate", b"Bearer")],
                )
                return
        elif self._local and (sentence := _foreign(headers)) is not None:
            await reply(_with(send, _PRIVATE), 403, sentence)
            return
        await self._app(scope, receive, _with(send, _PRIVATE))

    def _has_token(self, given: str) -> bool:
        kind, _, value = given.partition(" ")
        return (
            self._token is not None and kind.lower() == "bearer" and same_secret(value.strip(), self._token)
        )


_PRIVATE = ((b"x-content-type-options", b"nosniff"), (b"cache-control", b"no-store"))


def _with(send: Send, headers: Iterable[tuple[bytes, bytes]]) -> Send:
    async def send_with(message: Message) -> None:
        if message["type"] == "http.response.start":
            message = {**message, "headers": [*message.get("headers", []), *headers]}
        await send(message)

    return send_with


def _foreign(headers: dict[str, str]) -> str | None:
    """Return why a request that needs no token is refused, or None."""
    try:
        name = urlsplit(f"//{headers.get('host', '')}").hostname
    except ValueError:
        name = None
    if name is None or not (name in _LOCAL_NAMES or is_loopback(name)):
        return "Without a token this service answers to names of this machine only, such as 127.0.0.1."
    if headers.get("sec-fetch-site", "none") not in ("none", "same-origin") or "origin" in headers:
        return "Without a token this service answers no other site's requests."
    return None
