"""A virtual object put into a photo of a run's object, and the files of the picture and its layers."""

import math
import time
from dataclasses import dataclass
from pathlib import Path

import torch

from lightprobe.core.errors import ConfigError, InputError
from lightprobe.core.files import refuse_replacing
from lightprobe.core.run import RunFolder
from lightprobe.imaging import check_memory
from lightprobe.insertion import LayerFiles, PhotoView, Placement, insert, load_virtual_object
from lightprobe.jobs.files import BY_NAME
from lightprobe.jobs.light_files import tell_of_scale, whole_light
from lightprobe.jobs.photos import LocatedPhoto, known_photo
from lightprobe.jobs.request import PredictRequest
from lightprobe.jobs.session import Session
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
    at: tuple[float, float]  # pixel of the photo at which the virtual object stands
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
    """Write the photo with the GLB file `thing` beside the run's object, lit as the photo is: OUTPUT.png and layers.

    at: pixel at which the virtual object stands; scale: its height relative to the known object's; turn:
    degrees about the vertical; each by default chosen. env: an equirectangular map in the photo's exposure,
    by default predicted from the photo. camera, mask: as for a prediction, by default found. Layers:
    OUTPUT.beauty.exr, .shadow.exr and .mask.exr. Raises `InputError` for a run, photo, virtual object or map
    that cannot be used, `ConfigError` for a name, place or height that cannot be meant; nothing is written
    then.
    """
    start, output, light_map = time.perf_counter(), Path(output), None if env is None else Path(env)
    if output.suffix.lower() != ".png":
        raise ConfigError(
            f"Cannot write the picture as '{output.name}': name it .png; its layers are OpenEXR files."
        )
    request = PredictRequest(
        photo=Path(photo),
        camera=None if camera is None else Path(camera),
        mask=None if mask is None else Path(mask),
        sources=False,
    )
    files = LayerFiles.of(output)
    read = [request.photo, request.mask_file, Path(thing), light_map, request.camera]
    refuse_replacing(vars(files).values(), read)
    placement = Placement(at, scale, turn)
    placement.check()
    found, session = load_virtual_object(Path(thing)), Session(run, device)
    light = None if light_map is None else whole_light(light_map, session.device)
    location = BY_NAME.location_of(session.run.path / "predictions", request.photo)
    new = session.read(request, known_photo(session.run, request), location)
    warnings = [*doubt_about_up(session.run), *(() if new.location is None else new.location.warnings)]
    decomposition = session.predictor.decomposition
    if light is None or light_map is None:
        prediction = session.predict(new, request)
        light, warnings = prediction.environment, [*warnings, *prediction.verdict.sentences]
    else:
        tell_of_scale(light_map, decomposition.calibration)
    check_memory(request.photo, (new.camera.width, new.camera.height), _PIXEL_BYTES)
    view = PhotoView(*new.whole(), new.camera, opaque=is_opaque(request.photo))
    inserted = insert(decomposition, light, view, found, placement)
    inserted.write(files)
    return InsertedObject(
        **vars(files),
        at=inserted.at,
        scale=inserted.scale,
        seconds=time.perf_counter() - start,
        warnings=(*warnings, *inserted.warnings),
        location=new.location,
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
        f"By the scene's cameras up is {angle:.0f} degrees from its z axis, along which the virtual object stands; if it lies "
        "on its side, train on a scene whose z axis points up, as those of `prepare` do."
    ]
