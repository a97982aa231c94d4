"""A thing of the user's put into a photo of a run's object, and the files it goes to."""

import math
import time
from dataclasses import dataclass
from pathlib import Path

import torch

from lightprobe.core.device import resolve_device
from lightprobe.core.errors import ConfigError, InputError
from lightprobe.core.files import refuse_replacing
from lightprobe.core.run import RunFolder
from lightprobe.imaging import check_memory
from lightprobe.insertion import PhotoView, Wish, insert, load_thing
from lightprobe.insertion.layers import LayerFiles
from lightprobe.imaging import check_room
from lightprobe.insertion import LayerFiles, PhotoView, Placement, insert, load_virtual_object
from lightprobe.light.environment import Environment
from lightprobe.runs.light_files import tell_of_scale, whole_light
from lightprobe.runs.loaded import LoadedRun
from lightprobe.runs.locations import LocatedPhoto, LocationFiles, photo_mask
from lightprobe.runs.new_photos import NewPhoto, NewPhotos, PhotoFiles
from lightprobe.scene.background import is_opaque
from lightprobe.scene.camera import up_of
from lightprobe.scene.record import read_record

_PIXEL_BYTES = 260  # that a picture and its layers take for each of the photo's pixels
_UPRIGHT = 45.0  # degrees between +z and the cameras' mean up; photos from one side and from above have about as many


@dataclass(frozen=True)
class InsertedObject:
    """What `insert_object` has written, and what it chose."""

    picture: Path
    beauty: Path
    shadow: Path
    mask: Path
    at: tuple[float, float]  # pixel of the photo at which the thing's foot stands
    scale: float  # its height relative to the known object's
    seconds: float
    warnings: tuple[str, ...]
    location: LocatedPhoto | None  # the photo's camera and mask, if they were found


def insert_object(
    run: Path | str,
    photo: Path | str,
    thing: Path | str,
    output: Path | str,
    *,
    at: tuple[float, float] | None = None,
    scale: float | None = None,
    turn: float = 0.0,
    env: Path | str | None = None,
    camera: Path | str | None = None,
    mask: Path | str | None = None,
    device: str | torch.device = "auto",
) -> InsertedObject:
    """Write the photo with the GLB file `thing` beside the run's object, lit as the photo is: OUTPUT.png and
    layers.

    at: pixel of the thing's foot; scale: its height relative to the known object's; turn: degrees about the
    vertical; each by default chosen. env: an equirectangular map in the photo's exposure, by default
    predicted from the photo. camera, mask: as for a prediction, by default found. Layers: OUTPUT.beauty.exr,
    .shadow.exr and .mask.exr. Raises `InputError` for a run, photo, thing or map that cannot be used,
    `ConfigError` for a name, place or height that cannot be meant; nothing is written then.
    """
    start, output, image = time.perf_counter(), Path(output), Path(photo)
    _check_name(output)
    given, files = photo_mask(image, None if mask is None else Path(mask)), LayerFiles.of(output)
    refuse_replacing(
        vars(files).values(), [image, given, Path(thing), *(Path(path) for path in (env, camera) if path)]
    )
    wish = Placement(at, scale, turn)
    wish.check()
    found, folder, where = load_virtual_object(Path(thing)), RunFolder.open(Path(run)), resolve_device(device)
    light = None if env is None else whole_light(Path(env), where)
    if camera is None:
        read_record(folder)  # it has the cameras
    location = LocationFiles().within(folder.path / "predictions", image)
    photos = NewPhotos(
        folder, [PhotoFiles(image, given, location)], None if camera is None else Path(camera), True
    )
    loaded = LoadedRun(folder, where)
    loaded.make_ready(photos)
    new = photos.read(0)
    warnings = [*doubt_about_up(folder), *(() if new.location is None else new.location.warnings())]
    if light is None:
        light = _predicted_light(loaded, new, warnings)
    elif env is not None:
        tell_of_scale(Path(env), loaded.predictor.decomposition.calibration)
    inserted = insert(loaded.predictor.decomposition, light, _view(image, photos, new), found, wish)
    inserted.write(files)
    return InsertedObject(
        files.picture,
        files.beauty,
        files.shadow,
        files.mask,
        inserted.at,
        inserted.scale,
        time.perf_counter() - start,
        (*warnings, *inserted.warnings),
        new.location,
    )


def doubt_about_up(run: RunFolder) -> list[str]:
    """Return a sentence where the cameras that a run learnt from say that up is another direction than +z,
    else none.

    A scene of somebody else's may have any axes, and what stands along its z axis lies on its side in the
    photos.
    """
    try:
        cameras = read_record(run).cameras["train"].values()
    except InputError:  # a photo with a camera of its own does not need the record
        return []
    up = up_of(cameras) if cameras else (0.0, 0.0, 1.0)
    angle = math.degrees(math.acos(min(1.0, max(-1.0, float(up[2])))))
    if angle <= _UPRIGHT:
        return []
    return [
        f"By the scene's cameras up is {angle:.0f} degrees from its z axis, along which the thing stands; if it lies "
        "on its side, train on a scene whose z axis points up, as those of `prepare` do."
    ]


def _predicted_light(loaded: LoadedRun, new: NewPhoto, warnings: list[str]) -> Environment:
    """Return the light in a photo, and add what its verdict says to the warnings."""
    predict = loaded.predictor.predict
    found = predict(new.pixels, new.pixel_camera, background=new.background, doubt=new.doubt)
    warnings += found.verdict.sentences
    return found.environment


def _view(image: Path, photos: NewPhotos, new: NewPhoto) -> PhotoView:
    """Return the one photo of `photos` at its own size; raise `InputError` where the limit of memory has no
    room.
    """
    check_memory(image, (new.camera.width, new.camera.height), _PIXEL_BYTES)
    return PhotoView(*photos.whole(0, new), new.camera, opaque=is_opaque(image))


def _check_name(output: Path) -> None:
    """Raise `ConfigError` for a picture that cannot be written under this name."""
    if output.suffix.lower() != ".png":
        raise ConfigError(
            f"Cannot write the picture as '{output.name}': name it .png; its layers are OpenEXR files."
        )
