"""The page's server as an application: its routes and files behind the gate."""

import base64
import hashlib
from pathlib import Path

from fastapi import FastAPI
from starlette.responses import FileResponse
from starlette.staticfiles import StaticFiles

from lightprobe.view.routes import Session, router
from lightprobe.view.uploads import LIMITS
from lightprobe.web.asgi import answer_failures
from lightprobe.web.gate import Gate

STATIC = Path(__file__).parent / "static"


def create_app(session: Session, hosts: frozenset[str], token: str | None) -> Gate:
    """Return the application of a session, asked for under one of `hosts` (name:port), with `token` unless None."""
    app = FastAPI(title="lightprobe", docs_url=None, redoc_url=None, openapi_url=None)
    app.state.session = session
    app.include_router(router, prefix="/api")
    app.add_api_route("/", lambda: FileResponse(STATIC / "index.html"), methods=["GET"], response_model=None)
    app.mount("/static", StaticFiles(directory=STATIC))
    answer_failures(app)
    port = min(hosts).rpartition(":")[2]
    headers = (
        (
            b"content-security-policy",
            _content_policy((STATIC / "index.html").read_text(encoding="utf-8")).encode(),
        ),
        (b"referrer-policy", b"no-referrer"),
        (b"cross-origin-resource-policy", b"same-origin"),
        (b"cross-origin-opener-policy", b"same-origin"),
        (b"cache-control", b"no-cache"),
    )
    cookie = f"lightprobe-{port}"  # cookies are shared by the ports of a machine
    return Gate(app, max(LIMITS.values()), hosts.__contains__, token, cookie, headers=headers)


def inline_script(page: str) -> str:
    """Return the text of the page's import map, which cannot stand in a file of its own."""
    return page.partition('<script type="importmap">')[2].partition("</script>")[0]


def _content_policy(page: str) -> str:
    """Return the Content-Security-Policy of the page: its own files, and its import map by the hash of its text."""
    hashed = base64.b64encode(hashlib.sha256(inline_script(page).encode()).digest()).decode()
    return (
        f"default-src 'none'; script-src 'self' 'sha256-{hashed}'; style-src 'self'; img-src 'self' blob: data:; "
        "connect-src 'self' blob:; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
    )
