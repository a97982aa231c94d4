"""Answers of every application here: short ones before the application, and every failure as one sentence."""

import json
from collections.abc import Awaitable, Callable, Iterable, Mapping, MutableMapping
from typing import Any

from fastapi import FastAPI
from fastapi.exceptions import RequestValidationError
from starlette.exceptions import HTTPException
from starlette.requests import ClientDisconnect, Request
from starlette.responses import JSONResponse, Response

from lightprobe.core.errors import LightprobeError
from lightprobe.core.failures import UnexpectedError
from lightprobe.web.errors import GONE, RETRY_SECONDS, reported, status_of

Message = MutableMapping[str, Any]
Scope = MutableMapping[str, Any]
Receive = Callable[[], Awaitable[Message]]
Send = Callable[[Message], Awaitable[None]]
App = Callable[[Scope, Receive, Send], Awaitable[None]]
Headers = Iterable[tuple[bytes, bytes]]


def headers_of(scope: Scope) -> dict[str, str]:
    """Return the headers of a request by their names in lower case; of a repeated header the last."""
    return {name.decode("latin-1").lower(): value.decode("latin-1") for name, value in scope["headers"]}


def announced_length(headers: Mapping[str, str]) -> int:
    """Return how many bytes a request says that its body has, 0 where it says nothing that can be."""
    length = headers.get("content-length", "")
    return int(length[:20]) if length.isdecimal() else 0


async def reply(send: Send, status: int, sentence: str, headers: Headers = ()) -> None:
    """Answer with a status and one sentence as JSON."""
    body = json.dumps({"sentence": sentence}).encode()
    length = (b"content-length", str(len(body)).encode())
    start = [(b"content-type", b"application/json"), length, *headers]
    await send({"type": "http.response.start", "status": status, "headers": start})
    await send({"type": "http.response.body", "body": body})


def adding_headers(send: Send, headers: Headers) -> Send:
    """Return a `send` that adds headers to the answer, but for those that the answer has itself."""

    async def send_with(message: Message) -> None:
        if message["type"] == "http.response.start":
            own = list(message.get("headers", []))
            names = {name.lower() for name, _ in own}
            message = {**message, "headers": own + [pair for pair in headers if pair[0] not in names]}
        await send(message)

    return send_with


def answer_failures(app: FastAPI) -> None:
    """Let every failure inside `app` be answered with a status and one sentence."""
    for kind in (LightprobeError, HTTPException, RequestValidationError, ClientDisconnect, Exception):
        app.add_exception_handler(kind, _failed)


async def _failed(request: Request, error: Exception) -> Response:
    """Return the answer to a request that failed.

    Where requests have an id in their state, the answer has it too, and the server's log the traceback of what
    is unexpected; the sentence is then kept for the log line as "sentence" of the state's "noted".
    """
    state = request.scope.get("state", {})
    id = state.get("request_id")
    headers: dict[str, str] = {}
    if isinstance(error, ClientDisconnect):
        return Response(status_code=GONE)
    if isinstance(error, HTTPException):
        status, headers = error.status_code, dict(error.headers or {})
        sentence = "There is nothing at this address." if status == 404 else f"{error.detail}."
    elif isinstance(error, RequestValidationError):
        status, sentence = (
            422,
            "The request says something that cannot be; see /openapi.json, or load the page again.",
        )
    else:
        keep = (
            None if id is None else lambda traceback: None
        )  # the server logs it, to which the error goes on
        known = error if isinstance(error, LightprobeError) else reported(error, keep)
        status, sentence = status_of(known), str(known)
        if status in RETRY_SECONDS:
            headers = {"retry-after": str(RETRY_SECONDS[status])}
        state.get("noted", {})["sentence"] = sentence
        if id and isinstance(known, UnexpectedError):
            sentence = f"Something unexpected went wrong; the log of the service has it as request {id}."
    return JSONResponse({"sentence": sentence, **({"request": id} if id else {})}, status, headers)
