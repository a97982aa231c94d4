"""The camera a command is given: lightprobe's own JSON, a frame of a transforms file, or a run's scene.json."""

from pathlib import Path
from typing import Any

from lightprobe.core.errors import InputError
from lightprobe.core.files import read_json
from lightprobe.scene.camera import Camera
from lightprobe.scene.record import SPLITS
from lightprobe.scene.transforms import frame_camera


def read_camera(path: Path, image: Path | None = None, size: tuple[int, int] | None = None) -> Camera:
    """Return the camera in `path`; raise `InputError` naming the file when there is none or several.

    Of a file with several cameras (`frames` or `photos`), the one that belongs to `image` is taken. `size` (width,
    height) stands in where the file gives none.
    """
    value = read_json(path)
    if isinstance(value, dict) and isinstance(value.get("photos"), dict):
        photos = [photo for split in SPLITS for photo in value["photos"].get(split, {}).values()]
        return Camera.from_json(_pick(photos, "image", image, path)["camera"], source=str(path))
    if isinstance(value, dict) and isinstance(value.get("frames"), list):
        frames = [frame for frame in value["frames"] if isinstance(frame, dict) and "file_path" in frame]
        common = {key: setting for key, setting in value.items() if key != "frames"}
        settings = {**common, **_pick(frames, "file_path", image, path)}
        return frame_camera(settings, str(path), *(size or _written_size(settings, path)))
    return Camera.from_json(value, source=str(path))


def _pick(entries: list[dict[str, Any]], key: str, image: Path | None, source: Path) -> dict[str, Any]:
    """Return the only entry, or the one whose file is `image`; folders decide between equal file names."""
    if len(entries) == 1:
        return entries[0]
    if image is not None:
        same = [entry for entry in entries if Path(entry[key]).name in (image.name, image.stem)]
        if len(same) > 1:
            folder = image.resolve().parent.as_posix()
            same = [entry for entry in same if folder.endswith(Path(entry[key]).parent.as_posix().lstrip("./"))]
        if len(same) == 1:
            return same[0]
    wanted = f"not exactly one for {image}" if image else "this command takes only one"
    raise InputError(f"{source} holds {len(entries)} cameras, {wanted}; give a file with the one camera.")


def _written_size(settings: dict[str, Any], path: Path) -> tuple[int, int]:
    try:
        return int(settings["w"]), int(settings["h"])
    except (KeyError, TypeError, ValueError) as error:
        raise InputError(f"{path} gives no image size; add the keys w and h.") from error
