"""Who may ask a server, and how much they may send: one gate for hosts, tokens and sizes.

A site that a browser on this machine shows could post to a server here, or come to its address under a name of
the site's own (DNS rebinding). So a request must be for one of the server's hosts, and what a browser sends for
another site is refused.
"""

import hmac
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from http.cookies import CookieError, SimpleCookie
from urllib.parse import parse_qs, urlsplit

from lightprobe.web.asgi import (
    App,
    Message,
    Receive,
    Scope,
    Send,
    adding_headers,
    announced_length,
    headers_of,
    reply,
)
from lightprobe.web.errors import too_large
from lightprobe.web.listening import is_loopback

PAGE_HEADER = "x-lightprobe"
"""What a page sends with each change: other sites cannot send it without asking first."""

_SAFE = ("GET", "HEAD")
_HEADERS = ((b"x-content-type-options", b"nosniff"), (b"cache-control", b"no-store"))


def names_loopback(host: str) -> bool:
    """Return whether a Host header, whatever its port, names this machine as only this machine can."""
    try:
        return is_loopback(urlsplit(f"//{host}").hostname or "")
    except ValueError:
        return False


@dataclass(frozen=True)
class Gate:
    """An application that answers only what these checks let through."""

    app: App
    largest: int  # bytes that a body may have
    hosts: Callable[[str], bool] | None = None  # which Host headers name this server; None: any
    token: str | None = None  # what a request must bring
    cookie: str | None = None  # of a page: the cookie that keeps the token, which its address brings
    open_paths: Sequence[str] = ()  # answered without the token
    headers: Sequence[tuple[bytes, bytes]] = ()  # of every answer that has no such header itself

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer one request."""
        if scope["type"] != "http":
            return
        # Files are sent whole, as any server may (RFC 9110, section 14.2): nobody here asks for a part of one.
        scope["headers"] = [pair for pair in scope["headers"] if pair[0].lower() != b"range"]
        own = {**dict(_HEADERS), **dict(self.headers)}
        headers, send = headers_of(scope), adding_headers(send, list(own.items()))
        if self.hosts is not None and (sentence := self._foreign(scope, headers)) is not None:
            await reply(send, 403, sentence)
        elif not (self.token is None or scope["path"] in self.open_paths or self._has_token(headers)):
            await self._ask_for_token(scope, send)
        elif announced_length(headers) > self.largest:
            await reply(send, 413, str(too_large("The request", self.largest)))
        else:
            await self.app(scope, self._counting(receive), send)

    def _foreign(self, scope: Scope, headers: dict[str, str]) -> str | None:
        """Return why a request is refused as another site's, or None."""
        host, origin = headers.get("host", "").lower(), headers.get("origin")
        changes = scope["method"] not in _SAFE
        if self.hosts is not None and not self.hosts(host):
            return "This server answers under its own address only; use the one that it shows when it starts."
        other = headers.get("sec-fetch-site", "none") not in ("same-origin", "none")
        if (other and (changes or scope["path"] != "/")) or origin not in (None, f"http://{host}"):
            return "This server answers no other site's requests; open its own address."
        if changes and self.cookie is not None and PAGE_HEADER not in headers:
            return "Only the page itself may change anything; open it and try again."
        return None

    def _has_token(self, headers: dict[str, str]) -> bool:
        kind, _, value = headers.get("authorization", "").partition(" ")
        if kind.lower() == "bearer" and self._is_token(value.strip()):
            return True
        found: SimpleCookie = SimpleCookie()
        try:
            found.load(headers.get("cookie", ""))
        except CookieError:  # whatever a stranger's header holds, it is no token
            return False
        kept = None if self.cookie is None else found.get(self.cookie)
        return kept is not None and self._is_token(kept.value)

    async def _ask_for_token(self, scope: Scope, send: Send) -> None:
        """Refuse a request without the token, or let the address of a page bring it into the cookie."""
        if self.cookie is None:
            sentence = "This service needs its token: Authorization: Bearer TOKEN."
            await reply(send, 401, sentence, [(b"www-authenticate", b"Bearer")])
            return
        query = parse_qs(scope.get("query_string", b"").decode("latin-1"))
        if scope["path"] == "/" and self._is_token(query.get("token", [""])[0]):
            kept = f"{self.cookie}={self.token}; Path=/; HttpOnly; SameSite=Strict"
            await reply(send, 303, "Come in.", [(b"location", b"/"), (b"set-cookie", kept.encode())])
            return
        await reply(
            send, 401, "This page needs the address with its token; scan the QR code in the terminal."
        )

    def _is_token(self, given: str) -> bool:
        """Return whether a secret is the token, in a time that tells nothing of how much of it was right."""
        secrets = (text.encode("utf-8", "surrogatepass") for text in (given, self.token or ""))
        return self.token is not None and hmac.compare_digest(*secrets)

    def _counting(self, receive: Receive) -> Receive:
        """Return a `receive` that raises `RefusedError` (413) once a body is larger than it may be."""
        count = 0

        async def counted() -> Message:
            nonlocal count
            message = await receive()
            count += len(message.get("body", b""))
            if count > self.largest:
                raise too_large("The request", self.largest)
            return message

        return counted
