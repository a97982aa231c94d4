"""Work and what came of it: predictions, insertions, objects as they form."""

from typing import Annotated, Any

from fastapi import APIRouter
from pydantic import BaseModel, Field
from starlette.responses import FileResponse, Response

from lightprobe.core.errors import InputError
from lightprobe.view.jobs import JobState, TaskName
from lightprobe.view.light_files import light_texels
from lightprobe.view.routes.shared import SessionArg, light_response
from lightprobe.view.uploads import UploadKind

router = APIRouter(prefix="/jobs")

_SHOWN = (TaskName.PREDICT, TaskName.INSERT)
_Share = Annotated[float, Field(ge=0, le=1)]


class Placement(BaseModel):
    """Where a thing is to stand."""

    thing: str
    at: tuple[_Share, _Share] | None = None
    """Its foot, in shares of the photo's width and height; None: beside the object."""
    scale: Annotated[float, Field(gt=0, le=100)] | None = None
    """Its height in heights of the object; None: as its file says."""
    turn: Annotated[float, Field(ge=-360, le=360)] = 0.0
    """About the vertical, degrees."""


@router.get("")
def all_jobs(session: SessionArg) -> list[dict[str, Any]]:
    """Return the predictions and insertions that are kept, the newest first."""
    return [job.to_json() for job in reversed(session.jobs.all()) if job.task in _SHOWN]


@router.get("/{id}")
def one_job(id: str, session: SessionArg) -> dict[str, Any]:
    """Return a job."""
    return session.jobs.get(id).to_json()


@router.post("/{id}/stop")
def stop_job(id: str, session: SessionArg) -> dict[str, Any]:
    """Stop a job."""
    session.jobs.cancel(id)
    return session.jobs.get(id).to_json()


@router.get("/{id}/files/{name}")
def job_file(id: str, name: str, session: SessionArg, save: bool = False) -> Response:
    """Return a file of a job, to be saved under its name if asked for."""
    path = session.jobs.get(id).file(name)
    return FileResponse(
        path, filename=name if save else None, headers={"cache-control": "private, max-age=3600"}
    )


@router.get("/{id}/light")
def job_light(id: str, session: SessionArg) -> Response:
    """Return the light that a job predicted."""
    return light_response(light_texels(session.jobs.get(id).file("light.exr")))


@router.post("/{id}/insertions")
def insert_thing(id: str, placement: Placement, session: SessionArg) -> dict[str, Any]:
    """Have a thing put into the photo of a prediction; the answer is a job."""
    photo = session.jobs.get(id)
    if photo.task is not TaskName.PREDICT or photo.state is not JobState.DONE:
        raise InputError("The light of this photo is not predicted yet; wait for it.")
    thing = session.uploads.get(UploadKind.THING, placement.thing)
    session.uploads.get(UploadKind.PHOTO, photo.request["photo"])  # still here
    request = {
        "run": photo.request["run"],
        "run_index": photo.request["run_index"],
        "photo_job": photo.id,
        "photo": photo.request["upload"],
        "prediction": str(photo.folder),
        "upload": str(thing.path),
        "name": thing.name,
        "at": placement.at,
        "scale": placement.scale,
        "turn": placement.turn,
    }
    return session.jobs.submit(TaskName.INSERT, thing.name, request).to_json()
