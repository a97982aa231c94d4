"""What the page asks the server for: runs, files that come in, tasks and their results, scenes to correct."""

import secrets
from collections.abc import Callable
from dataclasses import dataclass, field
from importlib.metadata import version
from pathlib import Path
from typing import Annotated, Any

from fastapi import APIRouter, Depends
from pydantic import BaseModel, Field
from starlette.concurrency import run_in_threadpool
from starlette.requests import Request
from starlette.responses import FileResponse, Response

from lightprobe.core.errors import InputError
from lightprobe.core.files import inside, named_file, write_bytes
from lightprobe.imaging import read_ldr
from lightprobe.scene.record import read_record
from lightprobe.view.pictures import jpeg, light_texels, run_photo
from lightprobe.view.scenes import SceneSource, mask_picture, save_box, save_mask, thumbnail
from lightprobe.view.sources import RunPhoto, RunSource, Sources
from lightprobe.view.tasks import TaskKind, Tasks
from lightprobe.view.uploads import LIMITS, UploadKind, Uploads
from lightprobe.view.watching import TrainingWatch
from lightprobe.web.errors import MIB
from lightprobe.web.pool import TaskState
from lightprobe.web.uploads import receive_file, renaming
from lightprobe.web.worker import WorkerProcess

router = APIRouter()

_LARGEST_MASK = 32 * MIB
_Share = Annotated[float, Field(ge=0, le=1)]


@dataclass(frozen=True)
class Session:
    """What the routes share: sources, files that came in, tasks, and what was seen of trainings."""

    sources: Sources
    uploads: Uploads
    tasks: Tasks
    folder: Path  # temporary, for pictures that are kept
    watches: dict[int, TrainingWatch] = field(default_factory=dict)

    @staticmethod
    def within(folder: Path, sources: Sources, new_process: Callable[[int], WorkerProcess]) -> "Session":
        """Return a session that keeps its files in a folder and computes in what `new_process` starts."""
        uploads, tasks, pictures = (folder / part for part in ("uploads", "tasks", "pictures"))
        for part in (uploads, tasks, pictures):
            part.mkdir(parents=True)
        return Session(sources, Uploads(uploads), Tasks(tasks, new_process), pictures)


def _session(request: Request) -> Session:
    session: Session = request.app.state.session
    return session


SessionArg = Annotated[Session, Depends(_session)]


def _run(index: int, session: SessionArg) -> RunSource:
    if not 0 <= index < len(session.sources.runs):
        raise InputError("There is no such run; load the page again.")
    return session.sources.runs[index]


def _scene(index: int, session: SessionArg) -> SceneSource:
    if not 0 <= index < len(session.sources.scenes):
        raise InputError("There is no such scene; load the page again.")
    return session.sources.scenes[index]


RunArg = Annotated[RunSource, Depends(_run)]
SceneArg = Annotated[SceneSource, Depends(_scene)]


@router.get("/session")
def about(session: SessionArg) -> dict[str, Any]:
    """Return what the page must know first."""
    runs = [one.run.path for one in session.sources.runs]
    scenes = [one.folder for one in session.sources.scenes]
    return {
        "version": version("lightprobe"),
        "runs": [{"index": i, "name": path.resolve().name} for i, path in enumerate(runs)],
        "scenes": [{"index": i, "name": path.resolve().name} for i, path in enumerate(scenes)],
        "limits": {kind.value: limit for kind, limit in LIMITS.items()},
    }


# ---- runs: the object, its photos with their cameras and lights, and how far the training is


@router.get("/runs/{index}")
def about_run(source: RunArg) -> dict[str, Any]:
    """Return a run's photos with cameras and which of them have a light, and where its object is."""
    photos = source.photos()
    lights = [source.run.environment_file(photo.name).is_file() for photo in photos]
    listed = [
        {"name": photo.name, "split": photo.split, "camera": photo.camera.to_json(), "light": light}
        for photo, light in zip(photos, lights, strict=True)
    ]
    similarity = read_record(source.run).similarity.to_json() if photos else None
    name = source.run.path.resolve().name
    return {"name": name, "photos": listed, "similarity": similarity, "object": source.mesh_file.is_file()}


@router.get("/runs/{index}/object.glb")
def run_object(source: RunArg) -> Response:
    """Return the object as GLB."""
    path = inside(source.run.path, "mesh/object.glb", source=source.run.path)
    if not path.is_file():
        raise InputError("This run has no object yet; its training shows the newest checkpoint's.")
    return FileResponse(path, media_type="model/gltf-binary")


@router.get("/runs/{index}/photos/{number}/picture")
def run_picture(index: int, number: int, source: RunArg, session: SessionArg) -> Response:
    """Return a photo, decoded once and kept."""
    photo = _photo(source, number)
    kept = session.folder / f"run-{index}-{source.begun}-{number}"
    if not kept.is_file():
        write_bytes(kept, run_photo(source, photo))
    return _picture(kept.read_bytes())


@router.get("/runs/{index}/photos/{number}/light")
def run_light(number: int, source: RunArg) -> Response:
    """Return the light of a training photo."""
    name = named_file(source.run.environment_folder, _photo(source, number).name, ".exr").name
    path = inside(source.run.path, f"env/{name}", source=source.run.scene_file)
    if not path.is_file():
        raise InputError(
            "This photo has no light of its own; drop it on the page 'Photo' to have it predicted."
        )
    return _light(path)


@router.get("/runs/{index}/training")
def training_state(index: int, source: RunArg, session: SessionArg, after: int = 0) -> dict[str, Any]:
    """Return how far the training is, with the records from byte `after` on."""
    watch = session.watches.setdefault(index, TrainingWatch(source.run))
    return {**watch.state(after), "begun": source.begun}


@router.post("/runs/{index}/preview")
def preview_checkpoint(index: int, source: RunArg, session: SessionArg) -> dict[str, Any]:
    """Have the object of the newest checkpoint read; the answer is a task, that of before where it has not failed."""
    asked = {"run_index": index, "begun": source.begun, "step": source.run.checkpoints.newest_step()}
    for task in reversed(session.tasks.all()):
        same = task.kind is TaskKind.PREVIEW and asked.items() <= task.request.items()
        if same and task.state is not TaskState.FAILED:
            return task.to_json()
    request = {"run": str(source.run.path), **asked}
    return session.tasks.submit(TaskKind.PREVIEW, "the checkpoint's object", request).to_json()


@router.post("/runs/{index}/load")
def load_run(index: int, source: RunArg, session: SessionArg) -> dict[str, bool]:
    """Have a run loaded before its first photo comes, unless it has no object or something else is at work."""
    begun = not session.tasks.busy and source.mesh_file.is_file()
    if begun:
        session.tasks.submit(TaskKind.LOAD, "", {"run": str(source.run.path), "run_index": index})
    return {"begun": begun}


# ---- files that come in, as bodies: photos to predict from, lights and virtual objects


@router.post("/runs/{index}/predictions")
async def predict_photo(index: int, request: Request, source: RunArg, session: SessionArg) -> dict[str, Any]:
    """Take a photo and have its light predicted; the answer is a task."""
    upload = await session.uploads.receive(UploadKind.PHOTO, request)
    asked = {"run": str(source.run.path), "run_index": index, "upload": str(upload.path), "name": upload.name}
    return session.tasks.submit(TaskKind.PREDICT, upload.name, {**asked, "photo": upload.id}).to_json()


@router.post("/lights")
async def take_light(request: Request, session: SessionArg) -> dict[str, Any]:
    """Take an environment map."""
    upload = await session.uploads.receive(UploadKind.LIGHT, request)
    return {"id": upload.id, "name": upload.name}


@router.get("/lights/{id}")
def given_light(id: str, session: SessionArg) -> Response:
    """Return an environment map that was given."""
    return _light(session.uploads.get(UploadKind.LIGHT, id).path)


@router.post("/objects")
async def take_object(request: Request, session: SessionArg) -> dict[str, Any]:
    """Take a GLB."""
    upload = await session.uploads.receive(UploadKind.OBJECT, request)
    return {"id": upload.id, "name": upload.name}


# ---- tasks and what came of them


class Placement(BaseModel):
    """Where a virtual object is to stand."""

    object: str
    at: tuple[_Share, _Share] | None = None
    """Its foot, in shares of the photo's width and height; None: beside the known object."""
    scale: Annotated[float, Field(gt=0, le=100)] | None = None
    """Its height in heights of the known object; None: as its file says."""
    turn: Annotated[float, Field(ge=-360, le=360)] = 0.0
    """About the vertical, degrees."""


@router.get("/tasks")
def all_tasks(session: SessionArg) -> list[dict[str, Any]]:
    """Return the predictions and insertions that are kept, the newest first."""
    shown = (TaskKind.PREDICT, TaskKind.INSERT)
    return [task.to_json() for task in reversed(session.tasks.all()) if task.kind in shown]


@router.get("/tasks/{id}")
def one_task(id: str, session: SessionArg) -> dict[str, Any]:
    """Return a task."""
    return session.tasks.get(id).to_json()


@router.post("/tasks/{id}/stop")
def stop_task(id: str, session: SessionArg) -> dict[str, Any]:
    """Stop a task."""
    task = session.tasks.get(id)
    session.tasks.pool.stop(task)
    return task.to_json()


@router.get("/tasks/{id}/files/{name}")
def task_file(id: str, name: str, session: SessionArg, save: bool = False) -> Response:
    """Return a file of a task, to be saved under its name if asked for."""
    path = session.tasks.get(id).file(name)
    headers = {"cache-control": "private, max-age=3600"}
    return FileResponse(path, filename=name if save else None, headers=headers)


@router.get("/tasks/{id}/light")
def task_light(id: str, session: SessionArg) -> Response:
    """Return the light that a task predicted."""
    return _light(session.tasks.get(id).file("light.exr"))


@router.post("/tasks/{id}/insertions")
def insert_object(id: str, placement: Placement, session: SessionArg) -> dict[str, Any]:
    """Have a virtual object put into the photo of a prediction; the answer is a task."""
    photo = session.tasks.get(id)
    if photo.kind is not TaskKind.PREDICT or photo.state is not TaskState.DONE:
        raise InputError("The light of this photo is not predicted yet; wait for it.")
    given = session.uploads.get(UploadKind.OBJECT, placement.object)
    session.uploads.get(UploadKind.PHOTO, photo.request["photo"])  # still here
    request = {
        **{key: photo.request[key] for key in ("run", "run_index")},
        **placement.model_dump(include={"at", "scale", "turn"}),
        "photo_task": photo.id,
        "photo": photo.request["upload"],
        "prediction": str(photo.folder),
        "upload": str(given.path),
        "name": given.name,
    }
    return session.tasks.submit(TaskKind.INSERT, given.name, request).to_json()


# ---- scenes: photos, masks to correct, and the box that tells the preparation where the object is


class Box(BaseModel):
    """A box around the object, in shares of the photo's width and height."""

    photo: int
    box: tuple[_Share, _Share, _Share, _Share]


@router.get("/scenes/{index}")
def about_scene(scene: SceneArg) -> dict[str, Any]:
    """Return the photos of a scene and what its preparation says of them."""
    return scene.to_json()


@router.get("/scenes/{index}/photos/{number}/picture")
def scene_picture(number: int, scene: SceneArg) -> Response:
    """Return a photo."""
    return _picture(jpeg(read_ldr(scene.image(number))[0]))


@router.get("/scenes/{index}/photos/{number}/mask")
def scene_mask(number: int, scene: SceneArg) -> Response:
    """Return a photo's mask."""
    return Response(mask_picture(scene, number), media_type="image/png")


@router.get("/scenes/{index}/photos/{number}/thumbnail")
def scene_thumbnail(number: int, scene: SceneArg) -> Response:
    """Return a photo, small, with the outline of its mask."""
    return _picture(thumbnail(scene, number))


@router.put("/scenes/{index}/photos/{number}/mask")
async def correct_mask(number: int, request: Request, scene: SceneArg, session: SessionArg) -> dict[str, Any]:
    """Take a painted mask as the body, a PNG, write it into the scene and have all masks take it up; the answer is a task."""
    painted = session.folder / f"mask-{secrets.token_hex(8)}.png"
    try:
        with renaming({painted: "The mask"}):
            await receive_file(request, painted, _LARGEST_MASK, "The mask")
            await run_in_threadpool(save_mask, scene, number, painted)
    finally:
        painted.unlink(missing_ok=True)
    return _correction(session, scene, number)


class Click(BaseModel):
    """A place in a photo, in shares of its width and height, and whether the object is there."""

    at: tuple[_Share, _Share]
    object: bool


@router.post("/scenes/{index}/photos/{number}/clicks")
def click_mask(number: int, click: Click, scene: SceneArg, session: SessionArg) -> dict[str, Any]:
    """Have a mask corrected by a click on what is the object or is not, and all others by it; the answer is a task."""
    return _correction(session, scene, number, **click.model_dump())


@router.post("/scenes/{index}/photos/{number}/forget")
def forget_correction(number: int, scene: SceneArg, session: SessionArg) -> dict[str, Any]:
    """Have a photo's corrections taken back, and all masks made without them; the answer is a task."""
    return _correction(session, scene, number, forget=True)


@router.put("/scenes/{index}/box")
def draw_box(drawn: Box, scene: SceneArg) -> dict[str, Any]:
    """Keep a box around the object."""
    return {"command": save_box(scene, drawn.photo, drawn.box)}


def _correction(session: Session, scene: SceneSource, number: int, **asked: Any) -> dict[str, Any]:
    if not scene.prepared:
        raise InputError("This folder has no masks yet; draw a box and prepare it first.")
    photo = scene.mask_file(number).stem
    request = {"scene": str(scene.folder), "photo": photo, "at": None, "forget": False, **asked}
    return session.tasks.submit(TaskKind.CORRECT, photo, request).to_json()


def _photo(source: RunSource, number: int) -> RunPhoto:
    photos = source.photos()
    if not 0 <= number < len(photos):
        raise InputError("This run has no such photo any more; load the page again.")
    return photos[number]


def _light(path: Path) -> Response:
    """Return a map's texels; its height and scale stand in the headers."""
    light = light_texels(path)
    headers = {"x-height": str(light.height), "x-scale": repr(light.scale)}
    return Response(light.data, media_type="application/octet-stream", headers=headers)


def _picture(data: bytes) -> Response:
    """Return a PNG or JPEG, which the browser may keep for a while."""
    kind = "image/png" if data.startswith(b"\x89PNG") else "image/jpeg"
    return Response(data, media_type=kind, headers={"cache-control": "private, max-age=60"})
