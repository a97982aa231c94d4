"""The scene that comes out: photos without lens distortion, masks, cameras, a contact sheet."""

import shutil
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from lightprobe import imaging
from lightprobe.core.files import atomic_folder, atomic_path, named_file, write_json
from lightprobe.imaging.exif import upright_exposure
from lightprobe.imaging.resize import STRIP
from lightprobe.preparation.features import opencv_library
from lightprobe.preparation.mapping import bent
from lightprobe.preparation.photos import SourcePhoto
from lightprobe.preparation.support_plane import SupportPlane
from lightprobe.scene.camera import Camera
from lightprobe.scene.overlay import Cell, contact_sheet, outline

_LINE = (255, 60, 0)  # sRGB of the outline
GOOD, DOUBTFUL, LOST = (220, 220, 220), (255, 200, 0), (255, 90, 90)  # sRGB of captions
LOW_AGREEMENT = 0.85  # of a photo with all, below which its mask is doubtful: a third of these is wrong
_SMALL_BEND = 0.5  # pixels up to which a photo is taken as it is
_REACH = 2  # rows beside a place that interpolation looks at
_CELL = 200  # pixels of a contact sheet's pictures


def outlined(color: np.ndarray, mask: np.ndarray) -> np.ndarray:
    """Return a photo (h, w, 3) uint8, dimmed outside its mask (h, w) bool, with the outline drawn."""
    picture = np.where(mask[..., None], color, color // 3).astype(np.uint8)
    width = max(1, round(max(mask.shape) / 200))
    picture[outline(mask, width)] = _LINE
    return picture


def photo_cell(name: str, color: np.ndarray, mask: np.ndarray, agreement: float) -> Cell:
    """Return the cell of a photo (h, w, 3) uint8 with a camera, its mask (h, w) and its agreement with all."""
    kind = DOUBTFUL if agreement < LOW_AGREEMENT else GOOD
    return Cell(f"{name} {agreement:.2f}", outlined(color, mask), kind)


def lost_cell(name: str, color: np.ndarray, reason: str) -> Cell:
    """Return the cell of a photo (h, w, 3) uint8 without a camera."""
    grey = np.repeat((color.mean(axis=2, keepdims=True) * 0.6).astype(np.uint8), 3, axis=2)
    return Cell(f"{name}: {reason.split(';')[0]}", grey, LOST)


def bend_map(camera: Camera, k: float, first: int, last: int) -> tuple[np.ndarray, np.ndarray]:
    """Return where pixels of a pinhole's picture lie in the lens' one: x and y, (h, W) float32, of centres.

    Of the rows first..last - 1.
    """
    rows, columns = np.mgrid[first:last, : camera.width]
    points = np.stack([columns.ravel() + 0.5, rows.ravel() + 0.5], 1)
    x, y = bent(points, camera, k).T
    return (x - 0.5).reshape(rows.shape).astype(np.float32), (y - 0.5).reshape(rows.shape).astype(np.float32)


def straight(picture: np.ndarray, camera: Camera, k: float) -> np.ndarray:
    """Return a picture (H, W) or (H, W, 3) as a pinhole shows it; what the lens did not see is 0."""
    if largest_bend(camera, k) <= _SMALL_BEND:
        return picture
    result = np.empty_like(picture)
    strips = straight_strips(lambda *rows: picture[slice(*rows)], camera, k, cubic=picture.ndim == 3)
    for top, rows in strips:
        result[top : top + len(rows)] = rows
    return result


def straight_strips(
    read: Callable[[int, int], np.ndarray], camera: Camera, k: float, *, cubic: bool
) -> Iterator[tuple[int, np.ndarray]]:
    """Yield the first row and the rows (h, W) or (h, W, 3) of strips of a picture as a pinhole shows it.

    `read(first, last)` returns rows first..last - 1 of the lens' picture, which is never held whole. cubic:
    whether the interpolation is cubic, else linear.
    """
    cv2 = opencv_library()
    step = max(1, STRIP // camera.width)
    for top in range(0, camera.height, step):
        x, y = bend_map(camera, k, top, min(top + step, camera.height))
        first = int(np.clip(np.floor(y.min()) - _REACH, 0, camera.height - 1))
        last = int(np.clip(np.ceil(y.max()) + _REACH + 1, first + 1, camera.height))
        yield top, cv2.remap(read(first, last), x, y - first, cv2.INTER_CUBIC if cubic else cv2.INTER_LINEAR)


def largest_bend(camera: Camera, k: float) -> float:
    """Return by how many pixels the lens bends the corner farthest from the principal point."""
    corners = np.array([(x, y) for x in (0.0, camera.width) for y in (0.0, camera.height)])
    return float(np.linalg.norm(bent(corners, camera, k) - corners, axis=1).max())


def write_images(photos: Mapping[str, tuple[SourcePhoto, Camera, float]], folder: Path) -> dict[str, str]:
    """Write photos, each with its full-size camera and lens' k, into a new folder; return file names."""
    files = {}
    with atomic_folder(folder) as temporary:
        for name, (photo, camera, k) in photos.items():
            if largest_bend(camera, k) <= _SMALL_BEND:
                file = named_file(temporary, name, photo.path.suffix.lower())
                shutil.copyfile(photo.path, file)
            else:
                file = _write_straight(photo, camera, k, temporary, name)
            files[name] = file.name
    return files


def _write_straight(photo: SourcePhoto, camera: Camera, k: float, folder: Path, name: str) -> Path:
    """Write one photo through a pinhole, no coarser than it is, and return the file.

    As EXR where it shows more than white; else PNG of 8 or 16 bits, with what EXIF says of the exposure.
    """
    bent_photo, shape = imaging.PhotoFile(photo.path), (camera.height, camera.width, 3)
    strips = straight_strips(lambda *strip: bent_photo.rows(*strip)[0], camera, k, cubic=True)
    if bent_photo.shows_more_than_white:
        light = np.empty(shape, np.float32)
        for top, rows in strips:
            light[top : top + len(rows)] = np.maximum(rows, 0)  # cubic interpolation overshoots
        file = named_file(folder, name, ".exr")
        imaging.write_exr(file, light)
        return file
    encoded = np.empty(shape, np.uint16 if bent_photo.is_deep else np.uint8)
    white = np.iinfo(encoded.dtype).max
    for top, rows in strips:
        encoded[top : top + len(rows)] = np.clip(
            imaging.srgb_encode(np.clip(rows, 0, 1)) * white + 0.5, 0, white
        )
    file = named_file(folder, name, ".png")
    imaging.write_encoded(file, encoded, upright_exposure(photo.path))
    return file


def write_masks(
    masks: Iterable[tuple[str, np.ndarray]],
    ready: Mapping[str, Path],
    folder: Path,
    written: Callable[[Path], None] = lambda new: None,
) -> None:
    """Write masks (H, W) float32 by name as grey PNG, one by one as they come, and `ready` files.

    A file that does not say how it is stored is upright, and says so here: otherwise a scene's reader would
    turn it along with its photo. written: called with the new folder before it takes the place of `folder`.
    """
    with atomic_folder(folder) as temporary:
        for name, mask in masks:
            imaging.write_mask(named_file(temporary, name, ".png"), mask)
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
    """Write the cameras of full-size photos, OpenGL axes, z up.

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
            "transform_matrix": camera.camera_to_world.tolist(),
            **({"light_group": groups[name]} if name in groups else {}),
        }
        for name, camera in cameras.items()
    ]
    told = {
        f"{place}": {"normal": plane.normal.tolist(), "offset": float(plane.offset)}
        for place, plane in supports.items()
    }
    write_json(path, {"camera_model": "PINHOLE", **({"supports": told} if told else {}), "frames": frames})


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
