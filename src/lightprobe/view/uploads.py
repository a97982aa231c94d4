"""Files that a person gives to the page: kept up to a limit, told by their content; the last few of each kind."""

import secrets
import threading
from collections import OrderedDict
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path

from starlette.concurrency import run_in_threadpool
from starlette.requests import Request

from lightprobe.core.errors import InputError, LightprobeError
from lightprobe.imaging import image_size, is_video
from lightprobe.insertion import load_thing
from lightprobe.light.environment import read_map
from lightprobe.web.errors import MIB
from lightprobe.web.uploads import photo_suffix, quoted_name, receive_file, renamed

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
    kind: UploadKind
    path: Path
    name: str  # as the person knows it, for messages only


class Uploads:
    """The files given so far, the last few of each kind."""

    def __init__(self, folder: Path):
        """Keep files in `folder`."""
        self._folder = folder
        self._files: dict[UploadKind, OrderedDict[str, Upload]] = {kind: OrderedDict() for kind in UploadKind}
        self._lock = threading.Lock()

    def get(self, kind: UploadKind, id: str) -> Upload:
        """Return a file; raise `InputError` when there is none of this name any more."""
        with self._lock:
            found = self._files[kind].get(id)
        if found is None:
            raise InputError("This file is no longer kept here; choose it again.")
        return found

    async def receive(self, kind: UploadKind, request: Request) -> Upload:
        """Keep the body of a request as a file, after a look at its beginning.

        Raises `TooLargeError` as soon as it is too large, `InputError` when it is not what it should be.
        """
        name = quoted_name(request)
        id = secrets.token_urlsafe(9)
        path = self._folder / f"{kind.value}-{id}"
        try:
            await receive_file(request, path, LIMITS[kind], name)
            path = await run_in_threadpool(_checked, kind, path, name)
        except BaseException:
            path.unlink(missing_ok=True)
            raise
        return self._keep(Upload(id, kind, path, name))

    def _keep(self, upload: Upload) -> Upload:
        with self._lock:
            files = self._files[upload.kind]
            files[upload.id] = upload
            old = [files.popitem(last=False)[1] for _ in range(len(files) - _KEPT)]
        for one in old:
            one.path.unlink(missing_ok=True)
        return upload


def _checked(kind: UploadKind, path: Path, name: str) -> Path:
    """Return where a file is kept after a check of its kind; raise `InputError` naming it as the person does."""
    try:
        if kind is UploadKind.PHOTO:
            path = path.rename(path.with_suffix(photo_suffix(name)))
            if is_video(path):
                raise InputError(f"{name} is a video; choose a photo.")
            image_size(path)
            return path
        if kind is UploadKind.LIGHT:
            path = path.rename(path.with_suffix(_light_suffix(path, name)))
            read_map(path)
            return path
        path = path.rename(path.with_suffix(".glb"))
        load_thing(path)
        return path
    except LightprobeError as error:
        path.unlink(missing_ok=True)
        raise InputError(renamed(str(error), {path: name})) from error


def _light_suffix(path: Path, name: str) -> str:
    """Return the suffix of a map by what its file holds; raise `InputError` for another file."""
    with open(path, "rb") as file:
        start = file.read(4)
    if start == _EXR:
        return ".exr"
    if start.startswith(b"#?"):
        return ".hdr"
    raise InputError(
        f"{name} is no OpenEXR and no Radiance HDR file; choose an .exr or .hdr environment map."
    )
