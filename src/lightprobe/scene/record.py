"""What a run remembers of its scene: where it lay, every camera, and a checksum of every file it came from."""

from pathlib import Path
from typing import Any

from lightprobe.core.errors import InputError
from lightprobe.core.files import checksum
from lightprobe.scene.camera import Camera
from lightprobe.scene.photo import Photo, Scene

SPLITS = ("train", "test", "relight")


def scene_record(scene: Scene) -> dict[str, Any]:
    """Return the JSON value of scene.json: root, format, similarity, and per photo its split, camera and checksums."""
    root = scene.root.resolve()
    photos = {split: {p.name: _photo_record(p, root) for p in getattr(scene, split)} for split in SPLITS}
    return {"root": str(root), "format": scene.format, "similarity": scene.similarity.to_json(), "photos": photos}


def recorded_cameras(record: dict[str, Any], split: str) -> dict[str, Camera]:
    """Return the cameras (input frame) of a split by photo name, from a scene.json value."""
    return {
        name: Camera.from_json(photo["camera"], source=f"scene.json, photo {name}")
        for name, photo in record["photos"][split].items()
    }


def _photo_record(photo: Photo, root: Path) -> dict[str, Any]:
    record: dict[str, Any] = {"camera": photo.camera.to_json(), **_file_record("image", photo.image_path, root)}
    if photo.mask_path is not None:
        record |= _file_record("mask", photo.mask_path, root)
    return record


def _file_record(key: str, path: Path, root: Path) -> dict[str, str]:
    resolved = path.resolve()
    name = resolved.relative_to(root) if resolved.is_relative_to(root) else resolved
    try:
        return {key: name.as_posix(), f"{key}_checksum": checksum(path)}
    except OSError as error:
        raise InputError(f"{path} cannot be read: {error.strerror or error}.") from error
