"""The service as an application: its routes behind the gate, each request with an id, a log line and counts."""

import logging
import re
import secrets
import time
from importlib.metadata import version

from fastapi import Depends, FastAPI
from fastapi.security import HTTPBearer

from lightprobe.core.errors import printable
from lightprobe.service.fields import FIELDS
from lightprobe.service.routes import Service, router
from lightprobe.service.telemetry import Telemetry
from lightprobe.web.asgi import App, Message, Receive, Scope, Send, answer_failures, headers_of
from lightprobe.web.errors import MIB
from lightprobe.web.gate import Gate, names_loopback

_ID = re.compile(r"[A-Za-z0-9._-]{1,64}")
_LONGEST_PATH = 200  # characters of a path in a log line
_OPEN_PATHS = ("/health", "/ready")  # whoever watches the service need not know its token
_LARGEST_BODY = sum(limit for limit, *_ in FIELDS.values()) + MIB  # bytes, the headers of the fields included
_DESCRIPTION = (
    "Environment maps out of photos of known objects. POST a photo to /objects/{name}/predict; the answer is JSON with "
    "the files inside, a ZIP archive, or the map alone, as the Accept header says. Whatever is refused or fails says "
    'why in {"sentence": "..."}.'
)


def create_app(service: Service, token: str | None, *, local: bool) -> App:
    """Return the application: behind `token`, or where that is None and with `local`, for this machine's names."""
    described = [] if token is None else [Depends(HTTPBearer(auto_error=False))]
    app = FastAPI(
        title="lightprobe",
        version=version("lightprobe"),
        description=_DESCRIPTION,
        docs_url=None,
        redoc_url=None,
        dependencies=described,
    )
    app.state.service = service
    app.include_router(router)
    answer_failures(app)
    hosts = names_loopback if local and token is None else None
    return Recorded(Gate(app, _LARGEST_BODY, hosts, token, open_paths=_OPEN_PATHS), service.telemetry)


class Recorded:
    """An application whose requests get an id, a line in the log and a place in the counts."""

    def __init__(self, app: App, telemetry: Telemetry):
        """Record what `app` answers."""
        self._app, self._telemetry = app, telemetry

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer one request."""
        begin, given = time.perf_counter(), headers_of(scope).get("x-request-id", "")
        id = given if _ID.fullmatch(given) else secrets.token_hex(8)
        scope["state"] = {**scope.get("state", {}), "request_id": id, "noted": {}}
        status = 0  # the client has gone before there was an answer

        async def send_with_id(message: Message) -> None:
            nonlocal status
            if message["type"] == "http.response.start":
                status = message["status"]
                headers = [*message.get("headers", []), (b"x-request-id", id.encode())]
                message = {**message, "headers": headers}
            await send(message)

        try:
            await self._app(scope, receive, send_with_id)
        finally:
            self._record(scope, id, status, time.perf_counter() - begin)

    def _record(self, scope: Scope, id: str, status: int, seconds: float) -> None:
        route = getattr(scope.get("route"), "path", "other")
        self._telemetry.requests.labels(route, str(status)).inc()
        self._telemetry.seconds.labels(route).observe(seconds)
        quiet = status == 200 and scope["method"] == "GET"
        self._telemetry.log(
            logging.DEBUG if quiet else logging.INFO,
            "request",
            request=id,
            method=scope["method"],
            path=printable(scope["path"])[:_LONGEST_PATH],
            status=status,
            seconds=round(seconds, 4),
            client=(scope.get("client") or ("",))[0],
            **scope["state"]["noted"],
        )
