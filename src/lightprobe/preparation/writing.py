"""The scene that comes out: the photos as they are, masks, cameras, a contact sheet."""

import shutil
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from lightprobe import imaging
from lightprobe.core.errors import InputError
from lightprobe.core.files import atomic_folder, atomic_path, checksum, named_file, write_json
from lightprobe.core.threads import in_threads
from lightprobe.preparation.photos import SourcePhoto
from lightprobe.scene.camera import Camera
from lightprobe.scene.overlay import Cell, contact_sheet, outline
from lightprobe.scene.support import SupportPlane

_LINE = (255, 60, 0)  # sRGB of the outline
GOOD, DOUBTFUL, LOST = (220, 220, 220), (255, 200, 0), (255, 90, 90)  # sRGB of captions
_CELL = 200  # pixels of a contact sheet's pictures


def outlined(color: np.ndarray, mask: np.ndarray) -> np.ndarray:
    """Return a photo (h, w, 3) uint8, dimmed outside its mask (h, w) bool, with the outline drawn."""
    picture = np.where(mask[..., None], color, color // 3).astype(np.uint8)
    width = max(1, round(max(mask.shape) / 200))
    picture[outline(mask, width)] = _LINE
    return picture


def photo_cell(name: str, color: np.ndarray, mask: np.ndarray, stability: float, doubtful: bool) -> Cell:
    """Return the cell of a photo (h, w, 3) uint8 with a camera, and its mask (h, w)."""
    return Cell(f"{name} {stability:.2f}", outlined(color, mask), DOUBTFUL if doubtful else GOOD)


def lost_cell(name: str, color: np.ndarray, reason: str) -> Cell:
    """Return the cell of a photo (h, w, 3) uint8 without a camera."""
    grey = np.repeat((color.mean(axis=2, keepdims=True) * 0.6).astype(np.uint8), 3, axis=2)
    return Cell(f"{name}: {reason.split(';')[0]}", grey, LOST)


def copy_photos(
    photos: Mapping[str, SourcePhoto], folder: Path, copied: Callable[[], None] = lambda: None
) -> dict[str, str]:
    """Copy photos byte for byte into a new folder; return the files' names by those of the photos.

    Copies, not links: who edits a photo in place later would change the scene with it. copied: called after each.
    Raises `InputError` for a photo that is no longer the one that was looked at.
    """
    files = {}
    with atomic_folder(folder) as temporary:
        for name, photo in photos.items():
            file = named_file(temporary, name, photo.path.suffix.lower())
            shutil.copyfile(photo.path, file)
            if checksum(file) != photo.checksum:
                raise InputError(
                    f"{photo.path} was changed while the scene was prepared; give the same command again."
                )
            files[name] = file.name
            copied()
    return files


def write_masks(
    names: Iterable[str],
    full: Callable[[str], np.ndarray],
    ready: Mapping[str, Path],
    folder: Path,
    written: Callable[[Path], None] = lambda new: None,
    done: Callable[[], None] = lambda: None,
) -> None:
    """Write masks by name as grey PNG: those of `names`, which `full` makes, (H, W) float32, and `ready` files.

    A file that does not say how it is stored is upright, and says so here: otherwise a scene's reader would
    turn it along with its photo. written: called with the new folder before it takes the place of `folder`. done:
    called after each mask of `names`.
    """
    with atomic_folder(folder) as temporary:

        def write(
            name: str,
        ) -> None:  # one at a time in each thread: all at full size would take too much memory
            imaging.write_mask(named_file(temporary, name, ".png"), full(name))

        in_threads(write, names, done)
        for name, file in ready.items():
            target = named_file(temporary, name, ".png")
            if imaging.read_orientation(file) is None:
                imaging.write_mask(target, imaging.read_mask(file))
            else:
                shutil.copyfile(file, target)
        written(temporary)


def write_transforms(
    path: Path,
    cameras: Mapping[str, Camera],
    files: Mapping[str, str],
    groups: Mapping[str, int],
    supports: Mapping[int, SupportPlane],
) -> None:
    """Write the cameras of full-size photos as their lenses took them, OpenGL axes, z up.

    groups: the place, with one light, where each photo was taken, as far as known. supports: by place, the plane
    that the object stands on: a point x lies on it where normal . x is the offset.
    """
    frames: list[dict[str, Any]] = [
        {
            "file_path": f"images/{files[name]}",
            "mask_path": f"masks/{name}.png",
            "fl_x": camera.fx,
            "fl_y": camera.fy,
            "cx": camera.cx,
            "cy": camera.cy,
            "w": camera.width,
            "h": camera.height,
            "k1": 0.0 if camera.lens is None else camera.lens.radial[0],
            "transform_matrix": camera.camera_to_world.tolist(),
            **({"light_group": groups[name]} if name in groups else {}),
        }
        for name, camera in cameras.items()
    ]
    told = {f"{place}": plane.to_json() for place, plane in supports.items()}
    write_json(path, {"camera_model": "OPENCV", **({"supports": told} if told else {}), "frames": frames})


def full_size(camera: Camera, photo: SourcePhoto) -> Camera:
    """Return a working picture's camera for the photo itself, whose sides may have been rounded apart."""
    return replace(camera.resized(photo.width, photo.height), fy=camera.fx * photo.width / camera.width)


def write_cells(path: Path, cells: Sequence[Cell]) -> None:
    """Write a sheet of pictures as PNG, each at most 200 pixels long."""
    small = [replace(cell, picture=_small(cell.picture)) for cell in cells]
    with atomic_path(path) as temporary:
        contact_sheet(small, side=_CELL, letters=32, font=12).save(temporary, format="PNG")


def _small(picture: np.ndarray) -> np.ndarray:
    """Return a picture (h, w, 3) uint8 at the size of the sheet's cells."""
    image = Image.fromarray(picture)
    image.thumbnail((_CELL, _CELL))
    return np.asarray(image)
