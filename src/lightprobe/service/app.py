"""The service as an application: its routes, what they share, and every failure as a status with one
sentence.
"""

import logging
import re
import secrets
import time
from dataclasses import dataclass, field
from importlib.metadata import version
from pathlib import Path
from typing import Any

from fastapi import FastAPI
from fastapi.exceptions import RequestValidationError
from starlette.exceptions import HTTPException
from starlette.requests import Request
from starlette.responses import JSONResponse, Response

from lightprobe.core.errors import LightprobeError, printable
from lightprobe.core.failures import UnexpectedError
from lightprobe.service.asgi import App, Message, Receive, Scope, Send, headers_of
from lightprobe.service.errors import BusyError, reported, status_of
from lightprobe.service.guard import Gate
from lightprobe.service.objects import Objects
from lightprobe.service.pool import Pool
from lightprobe.service.telemetry import Telemetry

_ID = re.compile(r"[A-Za-z0-9._-]{1,64}")
_LONGEST_PATH = 200  # characters of a path in a log line
_DESCRIPTION = (
    "Environment maps out of photos of known objects. POST a photo to /objects/{name}/predict; the answer is JSON with "
    "the files inside, a ZIP archive, or the map alone, as the Accept header says. Whatever is refused or fails says "
    'why in {"sentence": "..."}.'
)


@dataclass(frozen=True)
class Service:
    """What the routes share."""

    objects: Objects
    pool: Pool
    telemetry: Telemetry
    folder: Path  # temporary, for the files of requests
    deadline: float  # seconds that a request may take from its acceptance on
    upload_seconds: float  # that its body may take to arrive
    uploads: int  # bodies that are received at once
    receiving: set[Path] = field(default_factory=set)  # folders of requests whose bodies are being received


def create_app(service: Service, token: str | None, *, local: bool) -> App:
    """Return the application: behind `token` unless that is None, then, with `local`, for this machine's
    names only.
    """
    from lightprobe.service import routes

    app = FastAPI(
        title="lightprobe",
        version=version("lightprobe"),
        description=_DESCRIPTION,
        docs_url=None,
        redoc_url=None,
    )
    app.state.service = service
    app.include_router(routes.router)
    for kind in (LightprobeError, HTTPException, RequestValidationError, Exception):
        app.add_exception_handler(kind, _failed)
    if token is not None:
        _describe_token(app)
    return Recorded(Gate(app, token, local=local), service.telemetry)


class Recorded:
    """An application whose requests get an id, a line in the log and a place in the counts."""

    def __init__(self, app: App, telemetry: Telemetry):
        """Record what `app` answers."""
        self._app, self._telemetry = app, telemetry

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer one request."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        begin, given = time.perf_counter(), headers_of(scope).get("x-request-id", "")
        id = given if _ID.fullmatch(given) else secrets.token_hex(8)
        scope["state"] = {**scope.get("state", {}), "request_id": id, "noted": {}}
        status = 0  # the client has gone before there was an answer

        async def send_with_id(message: Message) -> None:
            nonlocal status
            if message["type"] == "http.response.start":
                status = message["status"]
                message = {
                    **message,
                    "headers": [*message.get("headers", []), (b"x-request-id", id.encode())],
                }
            await send(message)

        try:
            await self._app(scope, receive, send_with_id)
        finally:
            self._record(scope, id, status, time.perf_counter() - begin)

    def _record(self, scope: Scope, id: str, status: int, seconds: float) -> None:
        route = getattr(scope.get("route"), "path", "other")
        noted = scope["state"]["noted"]
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
            **noted,
        )


def request_id(request: Request) -> str:
    """Return the id of a request."""
    return str(request.scope["state"]["request_id"])


def note(request: Request, **values: Any) -> None:
    """Keep values for the log line of a request."""
    request.scope["state"]["noted"].update(values)


async def _failed(request: Request, error: Exception) -> Response:
    """Return the answer to a request that failed: a status and one sentence."""
    id = request_id(request)
    if isinstance(error, HTTPException):
        sentence = "There is nothing at this address." if error.status_code == 404 else f"{error.detail}."
        return _refusal(error.status_code, sentence, id, dict(error.headers or {}))
    if isinstance(error, RequestValidationError):
        return _refusal(422, "The address or its query says something that cannot be; see /openapi.json.", id)
    # The traceback of what is unexpected is logged by the server, to which the error goes on.
    known = error if isinstance(error, LightprobeError) else reported(error, lambda traceback: None)
    note(request, sentence=str(known))
    if isinstance(known, UnexpectedError):
        return _refusal(
            500, f"Something unexpected went wrong; the log of the service has it as request {id}.", id
        )
    headers = {"retry-after": str(known.seconds)} if isinstance(known, BusyError) else {}
    status = status_of(known)
    return _refusal(status, str(known), id, headers or ({"retry-after": "5"} if status == 503 else {}))


def _refusal(status: int, sentence: str, id: str, headers: dict[str, str] | None = None) -> Response:
    return JSONResponse({"sentence": sentence, "request": id}, status, headers)


def _describe_token(app: FastAPI) -> None:
    """Say in the description of the interface that every request needs the token."""
    describe = app.openapi

    def described() -> dict[str, Any]:
        schema = describe()
        schema.setdefault("components", {})["securitySchemes"] = {
            "token": {"type": "http", "scheme": "bearer"}
        }
        schema["security"] = [{"token": []}]
        return schema

    app.openapi = described  # type: ignore[method-assign]
