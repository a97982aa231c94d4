"""What the service answers: predictions, the objects that it knows, its health, its counts."""

import asyncio
import shutil
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, Any

from fastapi import APIRouter, Depends, Query
from starlette.background import BackgroundTask
from starlette.concurrency import run_in_threadpool
from starlette.requests import ClientDisconnect, Request
from starlette.responses import JSONResponse, Response

from lightprobe.core.files import disk_errors
from lightprobe.core.run import RunFolder
from lightprobe.service.answers import RESPONSES, AnswerKind, accepted_kind, answer
from lightprobe.service.fields import BODY, FIELDS, predict_request
from lightprobe.service.objects import ObjectEntry, ObjectList, Objects
from lightprobe.service.telemetry import METRICS_TYPE, Telemetry
from lightprobe.web.errors import RefusedError
from lightprobe.web.pool import Pool, Task
from lightprobe.web.uploads import Form, receive_form, renaming

router = APIRouter()

_LISTED = 1000  # objects of one answer
_LIMITS = {name: limit for name, (limit, *_) in FIELDS.items()}


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


def _service(request: Request) -> Service:
    service: Service = request.app.state.service
    return service


ServiceArg = Annotated[Service, Depends(_service)]


@router.post("/objects/{name}/predict", responses=RESPONSES, openapi_extra=BODY)
async def predict(name: str, request: Request, service: ServiceArg) -> Response:
    """Predict the environment map around an object from one photo of it."""
    kind = accepted_kind(request.headers.get("accept", ""))
    run = await run_in_threadpool(service.objects.find, name)
    service.pool.check_room()  # before the photo is sent
    folder = service.folder / f"request-{request.state.request_id[:8]}-{id(request):x}"
    with disk_errors(folder):
        folder.mkdir()
    done = BackgroundTask(shutil.rmtree, folder, ignore_errors=True)
    try:
        form = await _received(request, service, folder)
        told = await _predicted(request, service, run, form, kind, folder)
        return await run_in_threadpool(answer, kind, told, folder, done)
    except BaseException:
        await run_in_threadpool(done.func, *done.args, **done.kwargs)
        raise


@router.get("/objects")
def objects(
    service: ServiceArg,
    after: Annotated[str, Query(max_length=255)] = "",
    limit: Annotated[int, Query(ge=1, le=_LISTED)] = _LISTED,
) -> ObjectList:
    """List the objects in the order of their names."""
    return service.objects.after(after, limit)


@router.get("/objects/{name}")
def one_object(name: str, service: ServiceArg) -> ObjectEntry:
    """Tell whether there is an object, and what it can do."""
    return ObjectEntry.of(service.objects.find(name))


@router.get("/health")
async def health() -> dict[str, str]:
    """Tell that the server answers."""
    return {"status": "ok"}


@router.get("/ready")
async def ready(service: ServiceArg) -> Response:
    """Tell whether a worker can take photos and there is room in the queue; 503 otherwise."""
    pool = service.pool
    is_ready = pool.ready and pool.waiting < pool.limit
    workers = [slot.state.value for slot in pool.slots]
    state = {"ready": is_ready, "waiting": pool.waiting, "limit": pool.limit, "workers": workers}
    return JSONResponse(state, 200 if is_ready else 503)


@router.get("/metrics")
async def metrics(service: ServiceArg) -> Response:
    """Return the counts in Prometheus' text format."""
    return Response(service.telemetry.metrics(), media_type=METRICS_TYPE)


async def _received(request: Request, service: Service, folder: Path) -> Form:
    """Return the form of a request.

    Raises `RefusedError` where too many are sent at once (429) and where it comes too slowly (408).
    """
    if len(service.receiving) >= service.uploads:
        raise RefusedError(429, f"{service.uploads} photos are being sent already; try again in a second.")
    service.receiving.add(folder)
    try:
        with service.telemetry.uploads.track_inprogress():
            async with asyncio.timeout(service.upload_seconds):
                return await receive_form(request, folder, _LIMITS)
    except TimeoutError as error:
        raise RefusedError(
            408,
            f"The photo did not arrive within {service.upload_seconds:.3g} s; send a smaller one or over a faster line.",
        ) from error
    finally:
        service.receiving.discard(folder)


async def _predicted(
    request: Request, service: Service, run: RunFolder, form: Form, kind: AnswerKind, folder: Path
) -> dict[str, Any]:
    """Return what a worker tells of the photo of a form, and note what the log is to know of it."""
    names = {part.path: part.name for part in form.parts.values()}
    with renaming(names):
        wanted, deadline = await run_in_threadpool(predict_request, form, folder)
    if kind.output is not None:
        wanted = replace(wanted, outputs=(kind.output,))
    work = {**wanted.to_json(), "task": "predict", "run": str(run.path), "folder": f"{folder}/"}
    seconds = min(deadline or service.deadline, service.deadline)
    task = Task(request=work, object=run.path.name, seconds=seconds)
    service.pool.submit(task)
    service.telemetry.received.inc(sum(part.path.stat().st_size for part in form.parts.values()))
    noted = request.state.noted
    try:
        told = await _awaited(request, service, task)
    finally:
        noted.update(object=run.path.name, waited=round(task.waited, 4), tries=task.tries, worker=task.slot)
    waited = task.waited
    service.telemetry.waited.observe(waited)
    service.telemetry.predicted.labels(told["method"]).observe(told["seconds"]["all"])
    noted.update(prediction=told["method"], verdict=told["verdict"]["status"])
    about = {"object": run.path.name, "request": request.state.request_id}
    return {**about, **told, "seconds": {"waiting": waited, **told["seconds"]}}


async def _awaited(request: Request, service: Service, task: Task) -> dict[str, Any]:
    """Return the result of a task; raise `ClientDisconnect` when nobody is there any more to be told.

    A task that has begun by then is waited for, as its worker goes on to write into its folder.
    """
    result = asyncio.wrap_future(task.answer)
    gone = asyncio.ensure_future(_disconnected(request))
    either: set[asyncio.Future[Any]] = {result, gone}
    try:
        await asyncio.wait(either, return_when=asyncio.FIRST_COMPLETED)
        if result.done():
            return result.result()
        if not service.pool.drop(task):
            await asyncio.wait({result})
        raise ClientDisconnect
    finally:
        gone.cancel()


async def _disconnected(request: Request) -> None:
    while (await request.receive())["type"] != "http.disconnect":
        pass
