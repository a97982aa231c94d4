"""Scenes: photos, masks to correct, and the box that tells the preparation where the object is."""

import secrets
from typing import Annotated, Any

from fastapi import APIRouter
from pydantic import BaseModel, Field
from starlette.concurrency import run_in_threadpool
from starlette.requests import Request
from starlette.responses import Response

from lightprobe.core.errors import LightprobeError
from lightprobe.core.files import shell_word
from lightprobe.service.incoming import renamed, stream_to
from lightprobe.view.pictures import scene_photo
from lightprobe.view.routes.shared import SessionArg, picture_response
from lightprobe.view.scenes import ScenePhotos, mask_picture, save_box, save_mask

router = APIRouter(prefix="/scenes/{index}")

_LARGEST_MASK = 32 * 2**20  # bytes

_Share = Annotated[float, Field(ge=0, le=1)]


class Box(BaseModel):
    """A box around the object, in shares of the photo's width and height."""

    photo: int
    box: tuple[_Share, _Share, _Share, _Share]


@router.get("")
def about_scene(index: int, session: SessionArg) -> dict[str, Any]:
    """Return the photos of a scene and what its preparation says of them."""
    return ScenePhotos.of(session.scene(index)).to_json()


@router.get("/photos/{number}/picture")
def photo_picture(index: int, number: int, session: SessionArg) -> Response:
    """Return a photo."""
    return picture_response(scene_photo(ScenePhotos.of(session.scene(index)).image(number)))


@router.get("/photos/{number}/mask")
def photo_mask(index: int, number: int, session: SessionArg) -> Response:
    """Return a photo's mask."""
    data = mask_picture(ScenePhotos.of(session.scene(index)), number)
    return Response(data, media_type="image/png")


@router.put("/photos/{number}/mask")
async def correct_mask(index: int, number: int, request: Request, session: SessionArg) -> dict[str, Any]:
    """Take a painted mask as the body, a PNG, and write it into the scene."""
    photos = ScenePhotos.of(session.scene(index))
    painted = session.folder / f"mask-{secrets.token_hex(8)}.png"
    try:
        await stream_to(request, painted, _LARGEST_MASK, "The mask")
        written = await run_in_threadpool(save_mask, photos, number, painted)
    except LightprobeError as error:
        raise type(error)(renamed(str(error), {painted: "The mask"})) from error
    finally:
        painted.unlink(missing_ok=True)
    return {
        "file": str(written),
        "command": f"lightprobe prepare PHOTOS -o {shell_word(photos.source.folder)}",
    }


@router.put("/box")
def draw_box(index: int, drawn: Box, session: SessionArg) -> dict[str, Any]:
    """Keep a box around the object."""
    return {"command": save_box(ScenePhotos.of(session.scene(index)), drawn.photo, drawn.box)}
