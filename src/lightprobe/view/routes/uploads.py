"""Files that come in: photos to predict from, lights and things of the person's own."""

from typing import Any

from fastapi import APIRouter
from starlette.requests import Request
from starlette.responses import Response

from lightprobe.view.jobs import JobState, TaskName
from lightprobe.view.light_files import light_texels
from lightprobe.view.routes.shared import SessionArg, light_response
from lightprobe.view.uploads import UploadKind

router = APIRouter()


@router.post("/runs/{index}/predictions")
async def predict_photo(index: int, request: Request, session: SessionArg) -> dict[str, Any]:
    """Take a photo as the body and have its light predicted; the answer is a job."""
    source = session.run(index)
    upload = await session.uploads.receive(UploadKind.PHOTO, request)
    asked = {"run": str(source.run.path), "run_index": index, "upload": str(upload.path), "name": upload.name}
    return session.jobs.submit(TaskName.PREDICT, upload.name, {**asked, "photo": upload.id}).to_json()


@router.post("/runs/{index}/load")
def load_run(index: int, session: SessionArg) -> dict[str, bool]:
    """Have a run loaded before its first photo comes, unless that was done or something else is at work."""
    source = session.run(index)
    busy = any(job.state in (JobState.WAITING, JobState.RUNNING) for job in session.jobs.all())
    if not busy and source.mesh_file.is_file():
        session.jobs.submit(TaskName.LOAD, "", {"run": str(source.run.path), "run_index": index})
    return {"begun": not busy}


@router.post("/lights")
async def take_light(request: Request, session: SessionArg) -> dict[str, Any]:
    """Take an environment map as the body."""
    upload = await session.uploads.receive(UploadKind.LIGHT, request)
    return {"id": upload.id, "name": upload.name}


@router.get("/lights/{id}")
def given_light(id: str, session: SessionArg) -> Response:
    """Return an environment map that was given."""
    return light_response(light_texels(session.uploads.get(UploadKind.LIGHT, id).path))


@router.post("/things")
async def take_thing(request: Request, session: SessionArg) -> dict[str, Any]:
    """Take a GLB as the body."""
    upload = await session.uploads.receive(UploadKind.THING, request)
    return {"id": upload.id, "name": upload.name}
