"""A photo from outside a scene: its camera, out of a file that may hold many, and its pixels.

Cameras come in three kinds of file: one camera in lightprobe's own JSON (docs/conventions.md), the frames of
a transforms file, or the photos of a run's scene.json.
"""

import os
import warnings
from pathlib import Path
from typing import Any

from lightprobe.core.errors import InputError, LightprobeWarning, shown
from lightprobe.core.files import checksum, read_json, resolved
from lightprobe.imaging import foreign_encoding, image_size
from lightprobe.scene.camera import Camera
from lightprobe.scene.file_names import fold, slashed
from lightprobe.scene.findings import encoding_sentences
from lightprobe.scene.photo import Photo, Pixels
from lightprobe.scene.pixels import fit_camera, load_pixels
from lightprobe.scene.record import SPLITS
from lightprobe.scene.transforms import frame_camera, frame_settings

_Entry = dict[str, Any]
_NAMED = 3  # cameras of a file, in a sentence about it


def load_photo(
    image: Path | str, camera: Path | str, mask: Path | str | None = None
) -> tuple[Pixels, Camera]:
    """Return the pixels of a photo and its input-frame camera for `Predictor.predict`; see `new_photo`."""
    return load_pixels(new_photo(Path(image), Path(camera), None if mask is None else Path(mask)))


def new_photo(image: Path, camera: Path, mask: Path | None = None) -> Photo:
    """Return a photo with its camera, its pixels still undecoded.

    `camera`: one of the files above; of several cameras the one that belongs to `image`. `mask`: white object
    on black; without it the photo's alpha counts. Raises `InputError` naming the file that cannot be used.
    """
    if mask is not None and not mask.exists():
        raise InputError(f"{mask} does not exist; name the mask of {image}, or a folder that holds it.")
    fitted = fit_camera(read_camera(camera, image, image_size(image)), image, str(camera))
    photo = Photo(image.stem, fitted, image, mask, encoding=foreign_encoding(image))
    for sentence in encoding_sentences([photo]):
        warnings.warn(sentence, LightprobeWarning, stacklevel=2)
    return photo


def read_camera(path: Path, image: Path | None = None, size: tuple[int, int] | None = None) -> Camera:
    """Return the camera in `path`; raise `InputError` naming the file when there is none or several.

    Of several cameras the one that belongs to `image` is taken: a file, or only a photo's name, which no
    single camera has. `size` (width, height) stands in where the file gives none.
    """
    value = read_json(path)
    if isinstance(value, dict) and isinstance(value.get("photos"), dict):
        return Camera.from_json(_pick(_recorded(value, path), image, path)["camera"], source=str(path))
    if isinstance(value, dict) and isinstance(value.get("frames"), list):
        common = {key: setting for key, setting in value.items() if key != "frames"}
        settings = frame_settings(common, _pick(_framed(value["frames"], path), image, path))
        return frame_camera(settings, str(path), *(size or _written_size(settings, path)))
    found = Camera.from_json(value, source=str(path))
    if image is not None and size is None and not os.path.isfile(image):  # False for an impossible name, too
        raise InputError(
            f"{path} holds one camera, of no named photo; leave out the name '{shown(str(image))}'."
        )
    return found


def _recorded(record: _Entry, path: Path) -> list[tuple[Path, str, _Entry]]:
    """Return (file, name, entry) of the photos of a run's scene.json."""
    root, found = _text(record.get("root", ""), "root", path), []
    for split in SPLITS:
        photos = record["photos"].get(split, {})
        if not isinstance(photos, dict):
            raise InputError(
                f"{path}: the photos of '{split}' are not an object with a camera for each name."
            )
        for name, photo in photos.items():
            if not (isinstance(photo, dict) and isinstance(photo.get("image"), str) and "camera" in photo):
                raise InputError(f"{path}: the photo '{shown(name)}' has no 'image' and 'camera'.")
            found.append((Path(root, photo["image"]), name, photo))
    return found


def _framed(frames: list[Any], path: Path) -> list[tuple[Path, str, _Entry]]:
    """Return (file, name, entry) of the frames of a transforms file that name a photo."""
    entries = [frame for frame in frames if isinstance(frame, dict) and "file_path" in frame]
    files = [Path(slashed(_text(entry["file_path"], "file_path", path))) for entry in entries]
    return [(path.parent / file, file.name, entry) for file, entry in zip(files, entries, strict=True)]


def _text(value: object, key: str, path: Path) -> str:
    if not isinstance(value, str):
        raise InputError(f"{path}: '{key}' must be text, not {shown(value)}.")
    return value


def _pick(entries: list[tuple[Path, str, _Entry]], image: Path | None, source: Path) -> _Entry:
    """Return the entry of `image`'s file, content or name, in this order; or the only one."""
    if not entries:
        raise InputError(f"{source} holds no camera of a photo; give a file with the camera of the photo.")
    if image is None and len(entries) == 1:
        return entries[0][2]
    if image is not None:
        names, whole = (
            {fold(image.name), fold(image.stem)},
            {image.resolve(), image.resolve().with_suffix("")},
        )
        named = [entry for file, name, entry in entries if names & {fold(name), fold(file.name)}]
        for same in (
            [entry for file, _, entry in entries if resolved(file) in whole],
            _of_content([entry for _, _, entry in entries], image) if len(named) != 1 else [],
            named,
        ):
            if len(same) == 1:
                return same[0]
        if len(entries) == 1:
            _, name, found = entries[0]
            if not image.is_file():
                raise InputError(
                    f"{source} holds no camera of '{shown(str(image))}', only that of '{shown(name)}'."
                )
            only = f"{source} holds the camera of '{shown(name)}', which is taken for {image}."
            warnings.warn(only, LightprobeWarning, stacklevel=2)
            return found
    wanted = f"not exactly one for {image}" if image else "and this command takes one"
    listed = [shown(name) for _, name, _ in entries[:_NAMED]]
    some = ", ".join(listed + (["..."] if len(entries) > _NAMED else []))
    raise InputError(
        f"{source} holds {len(entries)} cameras ({some}), {wanted}; give a file with the one camera, or name one of "
        "them where there is an option --frame."
    )


def _of_content(entries: list[_Entry], image: Path) -> list[_Entry]:
    """Return the entries of the photo whose file has the bytes of `image`; none where that is only a name."""
    known = [entry for entry in entries if isinstance(entry.get("image_checksum"), str)]
    if not known or not image.is_file():
        return []
    digest = checksum(image)
    return [entry for entry in known if entry["image_checksum"] == digest][:1]


def _written_size(settings: _Entry, path: Path) -> tuple[int, int]:
    try:
        return int(settings["w"]), int(settings["h"])
    except (KeyError, TypeError, ValueError, OverflowError) as error:
        raise InputError(f"{path} gives no image size; add the keys w and h.") from error
