"""Files that a person gives to the page: kept up to a limit, told by their content; the last few of each kind."""

import secrets
import threading
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path

from starlette.concurrency import run_in_threadpool
from starlette.requests import Request

from lightprobe.core.errors import InputError
from lightprobe.imaging import image_size, is_video
from lightprobe.insertion import load_virtual_object
from lightprobe.light.environment import read_map
from lightprobe.web.errors import MIB
from lightprobe.web.uploads import photo_suffix, quoted_name, receive_file, renaming

_EXR = (20000630).to_bytes(4, "little")  # OpenEXR's magic number
_KEPT = 24  # files of one kind; the oldest go first


class UploadKind(StrEnum):
    """What a file is taken as."""

    PHOTO = "photo"
    LIGHT = "light"
    OBJECT = "object"
    """A GLB that is to stand beside the known object."""


LIMITS = {UploadKind.PHOTO: 64 * MIB, UploadKind.LIGHT: 256 * MIB, UploadKind.OBJECT: 200 * MIB}
"""The most bytes of a file of each kind."""


@dataclass(frozen=True)
class Upload:
    """A file that was given to the page."""

    id: str
    path: Path
    name: str  # as the person knows it, for messages only


class Uploads:
    """The files given so far, the last few of each kind."""

    def __init__(self, folder: Path):
        """Keep files in `folder`."""
        self._folder, self._lock = folder, threading.Lock()
        self._files: dict[UploadKind, dict[str, Upload]] = {kind: {} for kind in UploadKind}

    def get(self, kind: UploadKind, id: str) -> Upload:
        """Return a file; raise `InputError` when there is none of this name any more."""
        found = self._files[kind].get(id)
        if found is None:
            raise InputError("This file is no longer kept here; choose it again.")
        return found

    async def receive(self, kind: UploadKind, request: Request) -> Upload:
        """Keep the body of a request as a file, after a look at its content.

        Raises `RefusedError` (413) as soon as it is too large, `InputError` when it is not what it should be.
        """
        name, id = quoted_name(request), secrets.token_urlsafe(9)
        path = self._folder / f"{kind.value}-{id}"
        try:
            await receive_file(request, path, LIMITS[kind], name)
            upload = Upload(id, await run_in_threadpool(_checked, kind, path, name), name)
        finally:
            path.unlink(missing_ok=True)  # by now it has another name, or is of no use
        with self._lock:
            files = self._files[kind]
            files[id] = upload
            old = [files.pop(one) for one in list(files)[:-_KEPT]]
        for one in old:
            one.path.unlink(missing_ok=True)
        return upload


def _checked(kind: UploadKind, path: Path, name: str) -> Path:
    """Return where a file is kept after a check of its kind; errors name it as the person does."""
    kept = path.rename(path.with_suffix(_suffix(kind, path, name)))
    try:
        with renaming({kept: name}):
            if kind is UploadKind.LIGHT:
                read_map(kept)
            elif kind is UploadKind.OBJECT:
                load_virtual_object(kept)
            elif is_video(kept):
                raise InputError(f"{name} is a video; choose a photo.")
            else:
                image_size(kept)
    except BaseException:
        kept.unlink(missing_ok=True)
        raise
    return kept


def _suffix(kind: UploadKind, path: Path, name: str) -> str:
    """Return the suffix that a file is kept with, of a map by its content; raise `InputError` for another file."""
    if kind is not UploadKind.LIGHT:
        return photo_suffix(name) if kind is UploadKind.PHOTO else ".glb"
    with open(path, "rb") as file:
        start = file.read(4)
    if start == _EXR:
        return ".exr"
    if start.startswith(b"#?"):
        return ".hdr"
    raise InputError(
        f"{name} is no OpenEXR and no Radiance HDR file; choose an .exr or .hdr environment map."
    )
