"""What the routes have in common."""

from typing import Annotated

from fastapi import Depends
from starlette.requests import Request
from starlette.responses import Response

from lightprobe.view.app import Session
from lightprobe.view.light_files import LightTexels


def _session(request: Request) -> Session:
    session: Session = request.app.state.session
    return session


SessionArg = Annotated[Session, Depends(_session)]


def light_response(light: LightTexels) -> Response:
    """Return a map's texels; its height and scale stand in the headers."""
    headers = {"x-height": str(light.height), "x-scale": repr(light.scale)}
    return Response(light.data, media_type="application/octet-stream", headers=headers)


def picture_response(data: bytes) -> Response:
    """Return a PNG or JPEG, which the browser may keep for a while."""
    kind = "image/png" if data.startswith(b"\x89PNG") else "image/jpeg"
    return Response(data, media_type=kind, headers={"cache-control": "private, max-age=60"})
