"""The page's server as an application: its routes, and every failure as a status with one sentence."""

from dataclasses import dataclass, field
from importlib.metadata import version
from pathlib import Path

from fastapi import FastAPI
from fastapi.exceptions import RequestValidationError
from starlette.exceptions import HTTPException
from starlette.requests import ClientDisconnect, Request
from starlette.responses import FileResponse, JSONResponse, Response
from starlette.staticfiles import StaticFiles

from lightprobe.core.errors import InputError, LightprobeError
from lightprobe.service.asgi import App
from lightprobe.service.errors import GONE, reported, status_of
from lightprobe.view.jobs import Jobs
from lightprobe.view.security import Guard, content_policy
from lightprobe.view.sources import RunSource, SceneSource, Sources
from lightprobe.view.uploads import LIMITS, Uploads
from lightprobe.view.watching import TrainingWatch

STATIC = Path(__file__).parent / "static"


@dataclass(frozen=True)
class Session:
    """What the routes share: sources, files that came in, work, and what was seen of trainings."""

    sources: Sources
    uploads: Uploads
    jobs: Jobs
    folder: Path  # temporary, for pictures that are kept
    watches: dict[int, TrainingWatch] = field(default_factory=dict)

    def run(self, index: int) -> RunSource:
        """Return a run by its place; raise `InputError` when there is none."""
        if not 0 <= index < len(self.sources.runs):
            raise InputError("There is no such run; load the page again.")
        return self.sources.runs[index]

    def scene(self, index: int) -> SceneSource:
        """Return a scene by its place; raise `InputError` when there is none."""
        if not 0 <= index < len(self.sources.scenes):
            raise InputError("There is no such scene; load the page again.")
        return self.sources.scenes[index]

    def watch(self, index: int) -> TrainingWatch:
        """Return what watches a run's training."""
        return self.watches.setdefault(index, TrainingWatch(self.run(index).run))


def create_app(session: Session, hosts: frozenset[str], token: str | None) -> App:
    """Return the application of a session, behind its guard: asked for under `hosts`, with `token` unless
    None.
    """
    from lightprobe.view.routes import jobs, runs, scenes, uploads

    app = FastAPI(title="lightprobe", docs_url=None, redoc_url=None, openapi_url=None)
    app.state.session = session
    for router in (runs.router, uploads.router, jobs.router, scenes.router):
        app.include_router(router, prefix="/api")
    app.add_api_route("/api/session", lambda: _about(session), methods=["GET"])
    app.add_api_route("/", lambda: FileResponse(STATIC / "index.html"), methods=["GET"], response_model=None)
    app.mount("/static", StaticFiles(directory=STATIC))
    for kind in (LightprobeError, HTTPException, RequestValidationError, ClientDisconnect, Exception):
        app.add_exception_handler(kind, _failed)
    page = (STATIC / "index.html").read_text(encoding="utf-8")
    return Guard(app, hosts, token, content_policy([inline_script(page)]))


def inline_script(page: str) -> str:
    """Return the text of the page's import map, which cannot stand in a file of its own."""
    return page.partition('<script type="importmap">')[2].partition("</script>")[0]


def _about(session: Session) -> dict[str, object]:
    """Return what the page must know first."""
    return {
        "version": version("lightprobe"),
        "runs": [
            {"index": i, "name": one.run.path.resolve().name} for i, one in enumerate(session.sources.runs)
        ],
        "scenes": [
            {"index": i, "name": one.folder.resolve().name} for i, one in enumerate(session.sources.scenes)
        ],
        "limits": {kind.value: limit for kind, limit in LIMITS.items()},
    }


async def _failed(request: Request, error: Exception) -> Response:
    """Return the answer to a request that failed: a status and one sentence."""
    if isinstance(error, HTTPException):
        sentence = "There is nothing at this address." if error.status_code == 404 else f"{error.detail}."
        return JSONResponse({"sentence": sentence}, error.status_code)
    if isinstance(error, RequestValidationError):
        return JSONResponse({"sentence": "The page asked for something that cannot be; load it again."}, 422)
    if isinstance(error, ClientDisconnect):
        return Response(status_code=GONE)
    known = error if isinstance(error, LightprobeError) else reported(error)
    return JSONResponse({"sentence": str(known)}, status_of(known))
