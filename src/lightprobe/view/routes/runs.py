"""Runs: the object, its photos with their cameras and lights, and how far the training is."""

from typing import Any

from fastapi import APIRouter
from starlette.responses import FileResponse, Response

from lightprobe.core.errors import InputError
from lightprobe.core.files import inside, named_file, write_bytes
from lightprobe.scene.record import read_record
from lightprobe.view.app import Session
from lightprobe.view.jobs import TaskName
from lightprobe.view.light_files import light_texels
from lightprobe.view.pictures import run_photo
from lightprobe.view.routes.shared import SessionArg, light_response, picture_response
from lightprobe.view.sources import RunPhoto, RunSource

router = APIRouter(prefix="/runs/{index}")


@router.get("")
def about_run(index: int, session: SessionArg) -> dict[str, Any]:
    """Return a run's photos with cameras and which of them have a light, and where its object is."""
    source = session.run(index)
    photos = source.photos()
    lights = [source.run.environment_file(photo.name).is_file() for photo in photos]
    listed = [
        {"name": photo.name, "split": photo.split, "camera": photo.camera.to_json(), "light": light}
        for photo, light in zip(photos, lights, strict=True)
    ]
    similarity = read_record(source.run).similarity.to_json() if photos else None
    return {
        "name": source.run.path.resolve().name,
        "photos": listed,
        "similarity": similarity,
        "object": source.mesh_file.is_file(),
    }


@router.get("/object.glb")
def run_object(index: int, session: SessionArg) -> Response:
    """Return the object as GLB."""
    source = session.run(index)
    path = inside(source.run.path, "mesh/object.glb", source=source.run.path)
    if not path.is_file():
        raise InputError("This run has no object yet; its training shows it as it forms.")
    return FileResponse(path, media_type="model/gltf-binary")


@router.get("/photos/{number}/picture")
def photo_picture(index: int, number: int, session: SessionArg) -> Response:
    """Return a photo, decoded once and kept."""
    source = session.run(index)
    photo = _photo(source, number)
    kept = session.folder / f"run-{index}-{source.begun}-{number}"
    if not kept.is_file():
        write_bytes(kept, run_photo(source, photo))
    return picture_response(kept.read_bytes())


@router.get("/photos/{number}/light")
def photo_light(index: int, number: int, session: SessionArg) -> Response:
    """Return the light of a training photo."""
    source = session.run(index)
    name = named_file(source.run.environment_folder, _photo(source, number).name, ".exr").name
    path = inside(source.run.path, f"env/{name}", source=source.run.scene_file)
    if not path.is_file():
        raise InputError(
            "This photo has no light of its own; drop it on the page 'Photo' to have it predicted."
        )
    return light_response(light_texels(path))


@router.get("/training")
def training_state(index: int, session: SessionArg, after: int = 0) -> dict[str, Any]:
    """Return how far the training is, with the records from byte `after` on."""
    return {**session.watch(index).state(after), "begun": session.run(index).begun}


@router.post("/forming")
def form_object(index: int, session: SessionArg) -> dict[str, Any]:
    """Have the object of the newest checkpoint read; the answer is a job, one that is there already if it can
    be.
    """
    source = session.run(index)
    asked = {"run_index": index, "begun": source.begun, "step": source.run.checkpoints.newest_step()}
    known = _forming_job(session, asked)
    if known is None:
        request = {"run": str(source.run.path), **asked}
        known = session.jobs.submit(TaskName.FORMING, "the object as it forms", request)
    return known.to_json()


def _forming_job(session: Session, asked: dict[str, Any]) -> Any:
    """Return the job of a run's checkpoint, `asked` in its request, that has not failed, None without one."""
    return next(
        (
            job
            for job in reversed(session.jobs.all())
            if job.task is TaskName.FORMING and job.state != "failed" and asked.items() <= job.request.items()
        ),
        None,
    )


def _photo(source: RunSource, number: int) -> RunPhoto:
    photos = source.photos()
    if not 0 <= number < len(photos):
        raise InputError("This run has no such photo any more; load the page again.")
    return photos[number]
