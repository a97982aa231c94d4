"""What the user may tell the preparation of plain photos: options, and the object in one photo."""

import re
import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path, PurePath

import numpy as np

from lightprobe.core.errors import ConfigError, InputError, LightprobeWarning, shown
from lightprobe.core.files import read_json, write_json
from lightprobe.imaging import read_mask, resize_area
from lightprobe.preparation.photos import SourcePhoto
from lightprobe.scene.masks import mask_turn, same_shape

_NUMBER = r"\s*(-?(?:\d+\.?\d*|\.\d+))\s*"
_BOX = re.compile(",".join([_NUMBER] * 4))
STORED = "hint.json"  # in a scene folder: a box that was drawn there


@dataclass(frozen=True)
class PrepareOptions:
    """Options of `lightprobe prepare`."""

    hint: str | None = None
    """The object in one photo: PHOTO=MASK.png, or PHOTO=x0,y0,x1,y1 with a box in its pixels."""
    up: str | None = None
    """The direction up, x,y,z in the axes of the photo --up-photo (x right, y up, z to the viewer)."""
    up_photo: str | None = None
    """A photo that was taken level: its vertical axis is up, or --up is given in its axes."""
    height: float | None = None
    """The object's height, in the unit that the scene is to have."""
    seed: int = 0
    """Equal seeds give equal scenes."""


def store_hint(scene: Path, photo: str, box: Sequence[float]) -> None:
    """Keep a box around the object in one photo in a scene folder, for the scene's next preparation.

    box: left, top, right, bottom in pixels of the photo turned upright.
    """
    x0, y0, x1, y1 = (round(number) for number in box)
    write_json(scene / STORED, {"photo": photo, "box": [x0, y0, x1, y1]})


def stored_hint(scene: Path) -> str | None:
    """Return the hint that is kept in a scene folder as PHOTO=BOX, None where there is none.

    Raises `InputError` for a file that holds something else.
    """
    path = scene / STORED
    if not path.is_file():
        return None
    value = read_json(path)
    box = value.get("box") if isinstance(value, dict) else None
    numbers = [number for number in box if type(number) is int] if isinstance(box, list) else []
    if len(numbers) != 4 or not isinstance(value.get("photo"), str):
        raise InputError(
            f"{path} holds no photo and box of four whole numbers; remove it, or draw the box again."
        )
    return f"{value['photo']}={','.join(map(str, numbers))}"


def find_photo(photos: Sequence[SourcePhoto], name: str, option: str) -> int:
    """Return the index of the photo of a file name, with or without suffix and folders.

    Raises `ConfigError` for none, or for several of that name in different folders.
    """
    parts = PurePath(name).parts

    def is_named(photo: SourcePhoto) -> bool:
        ends = [path.parts[-len(parts) :] for path in (photo.path, photo.path.with_suffix(""))]
        return name == photo.name or bool(parts and parts in ends)

    found = [index for index, photo in enumerate(photos) if is_named(photo)]
    if len(found) == 1:
        return found[0]
    if found:
        paths = [PurePath(*photos[index].path.parts[-len(parts) - 1 :]).as_posix() for index in found]
        listed = ", ".join(paths[:4])
        raise ConfigError(
            f"{option}: there are {len(found)} photos '{shown(name)}'; say which one: {listed}."
        )
    example = photos[0].path.name
    raise ConfigError(
        f"{option}: there is no photo '{shown(name)}'; give the name of a file, such as {example}."
    )


def read_hint(text: str, photos: Sequence[SourcePhoto], source: str = "--hint") -> tuple[int, np.ndarray]:
    """Return the photo's index and the mask (H, W) float32, full size, that PHOTO=MASK or PHOTO=BOX means.

    A box is x0,y0,x1,y1 in pixels of the photo turned upright. source: where it was told. Raises
    `ConfigError` for text of another form or a box outside of the photo, `InputError` for a mask that cannot
    be read or shows nothing.
    """
    name, equals, value = text.partition("=")
    if not equals:
        raise ConfigError(f"{source} {shown(text)} says nothing; write PHOTO=MASK.png or PHOTO=x0,y0,x1,y1.")
    index = find_photo(photos, name, source)
    photo = photos[index]
    box = _BOX.fullmatch(value)
    if box:
        return index, _box_mask([float(number) for number in box.groups()], photo, source)
    turn = mask_turn(Path(value), photo.path, (photo.width, photo.height))
    mask = read_mask(Path(value), turn=turn)
    if not same_shape((mask.shape[1], mask.shape[0]), (photo.width, photo.height)):
        raise InputError(
            f"{value} is {mask.shape[1]} x {mask.shape[0]}, but {photo.path.name} is {photo.width} x {photo.height}; "
            "a mask has the shape of its photo."
        )
    if not 0 < (mask >= 0.5).mean() < 1:
        raise InputError(
            f"{value} shows {'nothing' if mask.max() < 0.5 else 'no background'}; paint the object white."
        )
    return index, resize_area(mask, photo.height, photo.width)


def all_hints(hint: str | None, scene: Path, photos: Sequence[SourcePhoto]) -> dict[int, np.ndarray]:
    """Return `read_hint`'s masks (H, W) float32, by photo, of a `hint` and of the box drawn in a scene.

    Of two in one photo the drawn one holds: it corrects what the first led to. A drawn one that cannot be
    used beside a `hint` is left out with a warning. Raises as `read_hint` and `stored_hint`.
    """
    found = {} if hint is None else dict([read_hint(hint, photos)])
    try:
        drawn = stored_hint(scene)
        if drawn is not None:
            found |= dict([read_hint(drawn, photos, str(scene / STORED))])
    except (ConfigError, InputError) as error:
        if hint is None:
            raise
        warnings.warn(
            f"The box that was drawn in the scene is not used. {error}", LightprobeWarning, stacklevel=3
        )
    return found


def _box_mask(box: list[float], photo: SourcePhoto, source: str) -> np.ndarray:
    """Return a box as mask (H, W) float32."""
    x0, y0, x1, y1 = (round(number) for number in box)
    if not (0 <= x0 < x1 <= photo.width and 0 <= y0 < y1 <= photo.height):
        raise ConfigError(
            f"{source}: the box {x0},{y0},{x1},{y1} does not lie in {photo.path.name}, which is {photo.width} x "
            f"{photo.height}; give left,top,right,bottom in its pixels."
        )
    mask = np.zeros((photo.height, photo.width), np.float32)
    mask[y0:y1, x0:x1] = 1
    return mask
