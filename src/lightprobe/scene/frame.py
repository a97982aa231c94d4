"""What a layout reader hands to the loader: one entry per photo, before its image file has been looked at."""

import enum
import os
import re
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

from lightprobe.core.errors import InputError
from lightprobe.imaging import IMAGE_SUFFIXES
from lightprobe.scene.camera import Camera
from lightprobe.scene.photo import Truth
from lightprobe.scene.support import SupportPlane

_NAME_BYTES = 120  # of a photo's name: with `.confidence.exr` far from the 255, or 143, of file systems


class Split(enum.Enum):
    """What a photo is for."""

    TRAIN = "train"
    TEST = "test"
    RELIGHT = "relight"


@dataclass(frozen=True)
class Frame:
    """One photo as the camera file names it."""

    image: Path
    source: str  # the camera file and entry, for error messages
    camera: Callable[[int, int], Camera]  # (width, height) of the image file -> camera; raises `InputError`
    mask: Path | None = None
    split: Split | None = None  # None: no split given, the loader makes one
    truth: Truth = field(default_factory=Truth)
    light_group: str | None = None  # as `Photo.light_group`
    support: SupportPlane | None = None  # as `Photo.support`


class Problems:
    """Bad input met while a scene is read: raised at once, or collected so that all of it can be shown."""

    def __init__(self, *, collect: bool = False):
        self._collect = collect
        self.messages: list[str] = []

    @contextmanager
    def guard(self) -> Iterator[None]:
        """Run the block for one photo; when collecting, keep an `InputError` and lose only that photo."""
        try:
            yield
        except InputError as error:
            if not self._collect:
                raise
            self.messages.append(str(error))


def list_images(folder: Path) -> list[Path]:
    """Return the image files of `folder` and its subfolders in sorted order, without hidden ones."""
    found = (path for path in folder.rglob("*") if path.suffix.lower() in IMAGE_SUFFIXES and path.is_file())
    hidden = re.compile(r"(^|/)\.")
    return sorted(path for path in found if not hidden.search(path.relative_to(folder).as_posix()))


def unique_names(paths: Sequence[Path], root: Path) -> list[str]:
    """Return one name per path, safe as a file name and unique whatever the case: the stem if that suffices.

    Names have at most 120 bytes; what makes a cut name unique stays.
    """
    stems = [path.stem for path in paths]
    if len({stem.casefold() for stem in stems}) < len(stems):
        stems = [Path(os.path.relpath(path, root)).with_suffix("").as_posix() for path in paths]
    names: list[str] = []
    taken: set[str] = set()
    counts: dict[str, int] = {}  # where to go on counting, so that equal names do not take ever longer
    for stem in stems:
        name = cut_name(re.sub(r"[^\w.\-]", "_", stem).strip("."), _NAME_BYTES) or "photo"
        base = cut_name(name, _NAME_BYTES - len("-1000000"))
        while name.casefold() in taken:
            count = counts.get(base.casefold(), 1) + 1
            name, counts[base.casefold()] = f"{base}-{count}", count
        taken.add(name.casefold())
        names.append(name)
    return names


def cut_name(text: str, size: int) -> str:
    """Return as much of `text` as fits into `size` bytes of UTF-8 without cutting a character."""
    return text.encode()[:size].decode(errors="ignore")
