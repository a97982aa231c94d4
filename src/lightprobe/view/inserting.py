"""A thing of the person's own put into a photo, for the page: the work of `runs.insertion`, its files listed."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

from lightprobe.core.files import read_json

PICTURE = "inserted.png"


def insert(request: dict[str, Any], tell: Callable[[str], None], device: str) -> dict[str, Any]:
    """Put the GLB `upload` of a request into the photo whose light the folder `prediction` holds.

    Returns what the page is told. Raises `InputError` for a GLB that cannot be used or a place that cannot be.
    """
    from lightprobe.runs.insertion import insert_object

    folder, prediction = Path(request["folder"]), Path(request["prediction"])
    camera = read_json(prediction / "camera.json")
    size = camera["width"], camera["height"]
    at = None if request["at"] is None else tuple(share * side for share, side in zip(request["at"], size, strict=True))
    tell("putting it into the photo")
    insert_object(
        Path(request["run"]), Path(request["photo"]), Path(request["upload"]), folder / PICTURE, at=at,
        scale=request["scale"], turn=request["turn"], env=prediction / "light.exr",
        camera=prediction / "camera.json", mask=prediction / "mask.png", device=device,
    )  # fmt: skip
    files = [{"name": path.name, "title": _title(path)} for path in sorted(folder.iterdir()) if path.is_file()]
    return {"files": files, "picture": PICTURE}


def _title(path: Path) -> str:
    return "the photo with it" if path.name == PICTURE else f"layer, {path.suffix[1:].upper()}"
