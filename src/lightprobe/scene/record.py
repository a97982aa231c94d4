"""What a run remembers of its scene: where it lay, every camera, and a checksum of every file."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from lightprobe.core.errors import InputError
from lightprobe.core.files import checksum, is_file_name
from lightprobe.core.run import REMAKE, RunFolder
from lightprobe.core.stored import checked_object, damaged, remedied
from lightprobe.scene.camera import Camera, Similarity
from lightprobe.scene.frame import Split
from lightprobe.scene.photo import Photo, Scene

SPLITS = tuple(split.value for split in Split)


def scene_record(scene: Scene) -> dict[str, Any]:
    """Return the JSON value of scene.json: root, format, similarity, photos' cameras and checksums."""
    root = scene.root.resolve()
    photos = {split: {p.name: _photo_record(p, root) for p in getattr(scene, split)} for split in SPLITS}
    head = {"root": str(root), "format": scene.format, "similarity": scene.similarity.to_json()}
    return {**head, "photos": photos}


@dataclass(frozen=True)
class StoredScene:
    """What scene.json says of a run's scene, checked."""

    root: Path
    similarity: Similarity
    cameras: dict[str, dict[str, Camera]]  # split -> photo name -> input-frame camera


def read_record(run: RunFolder) -> StoredScene:
    """Return the checked content of scene.json; raise `InputError` naming the file if it cannot be used."""
    path, record = run.scene_file, run.scene()
    with remedied(REMAKE):
        similarity = Similarity.from_json(record.get("similarity"), source=str(path))
        photos = checked_object(record.get("photos"), path, REMAKE, "photos")
        cameras = {
            split: _cameras(path, checked_object(photos.get(split), path, REMAKE, split)) for split in SPLITS
        }
    return StoredScene(Path(record["root"]), similarity, cameras)


def recorded_mask(run: RunFolder, entry: dict[str, Any]) -> Path | None:
    """Return the mask of a photo by its `entry` in scene.json; None if there is none, or another now."""
    name, digest = entry.get("mask"), entry.get("mask_checksum")
    if not isinstance(name, str) or "\0" in name:
        return None
    mask = Path(run.scene()["root"], name)
    return mask if mask.is_file() and checksum(mask) == digest else None


def _cameras(path: Path, photos: dict[str, Any]) -> dict[str, Camera]:
    found = {}
    for name, photo in photos.items():
        if not is_file_name(name):
            raise damaged(path, f"a photo is called {name[:200]!a}, which no file can be", REMAKE)
        entry = checked_object(photo, path, REMAKE, name)
        if not isinstance(entry.get("image"), str) or "\0" in entry["image"]:
            raise damaged(path, f"photo '{name}' names no image", REMAKE)
        found[name] = Camera.from_json(entry.get("camera"), source=f"{path}, photo {name}")
    return found


def _photo_record(photo: Photo, root: Path) -> dict[str, Any]:
    mask = {} if photo.mask_path is None else _file_record("mask", photo.mask_path, root)
    return {"camera": photo.camera.to_json(), **_file_record("image", photo.image_path, root), **mask}


def _file_record(key: str, path: Path, root: Path) -> dict[str, str]:
    resolved = path.resolve()
    name = resolved.relative_to(root) if resolved.is_relative_to(root) else resolved
    try:
        return {key: name.as_posix(), f"{key}_checksum": checksum(path)}
    except OSError as error:
        raise InputError(f"{path} cannot be read: {error.strerror or error}.") from error
