"""Who may talk to the page: requests for its own address, from its own pages, with the token where it has
one.

A site that the browser shows beside ours could post to us, or come to our address under a name of its own
(DNS rebinding). So the Host must be one of ours; what changes anything must come from our own origin and
carry a header that other sites cannot send without asking first; and what other sites embed is refused.
"""

import base64
import hashlib
from collections.abc import Iterable
from http.cookies import SimpleCookie
from urllib.parse import parse_qs

from lightprobe.service.asgi import App, Message, Receive, Scope, Send, headers_of, reply, same_secret

OWN_HEADER = "x-lightprobe"
_SAFE = ("GET", "HEAD")


def content_policy(inline_scripts: Iterable[str]) -> str:
    """Return the Content-Security-Policy of the page: its own files only, and these inline scripts by their
    hashes.
    """
    hashes = [base64.b64encode(hashlib.sha256(text.encode()).digest()).decode() for text in inline_scripts]
    scripts = " ".join(["'self'", *(f"'sha256-{value}'" for value in hashes)])
    return (
        f"default-src 'none'; script-src {scripts}; style-src 'self'; img-src 'self' blob: data:; "
        "connect-src 'self' blob:; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
    )


class Guard:
    """The application behind the checks above, and with the headers that keep a page to itself."""

    def __init__(self, app: App, hosts: frozenset[str], token: str | None, policy: str):
        """Let through what asks for one of `hosts` (name:port), with `token` in its cookie unless that is
        None.
        """
        self._app, self._hosts, self._token = app, hosts, token
        port = next(iter(sorted(hosts)), "").rpartition(":")[2]
        self._cookie = f"lightprobe-{port}"  # cookies are shared by the ports of a machine
        self._headers = [
            (b"content-security-policy", policy.encode()),
            (b"x-content-type-options", b"nosniff"),
            (b"referrer-policy", b"no-referrer"),
            (b"cross-origin-resource-policy", b"same-origin"),
            (b"cross-origin-opener-policy", b"same-origin"),
        ]

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer one request."""
        if scope["type"] == "lifespan":
            await self._app(scope, receive, send)
        elif scope["type"] == "http":
            # Files are sent whole, as any server may (RFC 9110, section 14.2): the page never asks for a part
            # of one.
            scope = {**scope, "headers": [pair for pair in scope["headers"] if pair[0].lower() != b"range"]}
            await self._answer(scope, receive, self._with_headers(scope, send))

    async def _answer(self, scope: Scope, receive: Receive, send: Send) -> None:
        headers = headers_of(scope)
        sentence = self._refusal(scope, headers)
        if sentence is not None:
            await reply(send, 403, sentence)
        elif self._token is None or self._has_token(headers.get("cookie", "")):
            await self._app(scope, receive, send)
        elif scope["path"] == "/" and self._is_token(_query_token(scope)):
            await reply(
                send,
                303,
                "Come in.",
                [
                    (b"location", b"/"),
                    (
                        b"set-cookie",
                        f"{self._cookie}={self._token}; Path=/; HttpOnly; SameSite=Strict".encode(),
                    ),
                ],
            )
        else:
            await reply(
                send, 401, "This page needs the address with its token; scan the QR code in the terminal."
            )

    def _refusal(self, scope: Scope, headers: dict[str, str]) -> str | None:
        """Return why a request is refused, whatever its token, or None."""
        if headers.get("host", "").lower() not in self._hosts:
            return "This server answers under its own address only; open the one that the terminal shows."
        site = headers.get("sec-fetch-site", "same-origin")
        changes = scope["method"] not in _SAFE
        if site not in ("same-origin", "none") and (changes or scope["path"] != "/"):
            return "Another site asked for this; open the page itself."
        if changes:
            origin = headers.get("origin")
            own = origin is None or origin.lower().removeprefix("http://") in self._hosts
            if not own or OWN_HEADER not in headers:
                return "Only the page itself may change anything; open it and try again."
        return None

    def _has_token(self, cookies: str) -> bool:
        found = SimpleCookie()
        try:
            found.load(cookies)
        except Exception:  # whatever a stranger's header holds, it is no token
            return False
        return self._cookie in found and self._is_token(found[self._cookie].value)

    def _is_token(self, given: str) -> bool:
        return self._token is not None and same_secret(given, self._token)

    def _with_headers(self, scope: Scope, send: Send) -> Send:
        cached = b"no-store" if scope["path"].startswith("/api/") else b"no-cache"

        async def send_with(message: Message) -> None:
            if message["type"] == "http.response.start":
                given = list(message.get("headers", []))
                own = (
                    []
                    if any(name.lower() == b"cache-control" for name, _ in given)
                    else [(b"cache-control", cached)]
                )
                message = {**message, "headers": given + self._headers + own}
            await send(message)

        return send_with


def _query_token(scope: Scope) -> str:
    return parse_qs(scope.get("query_string", b"").decode("latin-1")).get("token", [""])[0]
