"""A thing of the person's own put into a photo whose light is predicted, for the page: the picture and its
layers.
"""

from collections.abc import Callable
from pathlib import Path
from typing import Any

from lightprobe.core.files import read_json
from lightprobe.imaging import read_ldr, read_mask
from lightprobe.insertion import PhotoView, Wish, insert, load_thing
from lightprobe.insertion.layers import LayerFiles
from lightprobe.jobs import Sessions
from lightprobe.jobs.insertion import doubt_about_up
from lightprobe.light.environment import Environment
from lightprobe.scene.background import is_opaque
from lightprobe.scene.camera import Camera
from lightprobe.view.predicting import MAP

PICTURE = "inserted.png"
_TITLES = {
    PICTURE: "the photo with it",
    "inserted.beauty.exr": "the thing alone, linear",
    "inserted.shadow.exr": "what it takes from the light, linear",
    "inserted.mask.exr": "its mask",
}


def insert_thing(models: Sessions, request: dict[str, Any], tell: Callable[[str], None]) -> dict[str, Any]:
    """Put the GLB `upload` of a request into the file `photo`, whose light the folder `prediction` holds.

    Returns what the page is told. Raises `InputError` for a GLB that cannot be used, `ConfigError` for a
    place that cannot be.
    """
    folder, prediction, image = (Path(request[key]) for key in ("folder", "prediction", "photo"))
    tell("loading the object")
    session = models.get(request["run"])
    decomposition = session.predictor.decomposition
    thing, light = load_thing(Path(request["upload"])), Environment.load(prediction / MAP, models.device)
    camera = Camera.from_json(read_json(prediction / "camera.json"), source="this photo's camera")
    photo = PhotoView(read_ldr(image)[0], read_mask(prediction / "mask.png"), camera, is_opaque(image))
    at = request["at"]
    place = None if at is None else (at[0] * camera.width, at[1] * camera.height)
    tell("putting it into the photo")
    made = insert(decomposition, light, photo, thing, Wish(place, request["scale"], request["turn"]))
    made.write(LayerFiles.of(folder / PICTURE))
    return {
        "files": [{"name": name, "title": title} for name, title in _TITLES.items()],
        "picture": PICTURE,
        "at": [made.at[0] / camera.width, made.at[1] / camera.height],
        "scale": made.scale,
        "sentences": [*doubt_about_up(session.run), *made.warnings],
    }
