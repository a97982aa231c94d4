"""The shoot's folder, written photo by photo: photos, masks, the light of every place, cameras and the true mesh.

    train/NAME.jpg test/NAME.jpg masks/NAME.png    photos, and which of their pixels show the object
    transforms_{train,test}.json                   true cameras in the object's frame, which photos share a place and
                                                   the plane of its table: lightprobe's scene format
    light/PLACE.exr                                the light at the object's centre, the object not there
    env_test/NAME.exr                              the same in the exposure and colours of a test photo
    mesh.obj                                       the true surface, as far as it is seen from outside
    shoot.json                                     settings, places with the plane of their table, photos done so far

A pixel of radiance L is L * gain, channel by channel, before the telephone's tone curve. Strangers, who come and go,
are in no light/PLACE.exr.
"""

import json
from collections.abc import Callable
from dataclasses import asdict, dataclass
from datetime import datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from demo_scene.files import read_exr, write_exr, write_obj
from demo_scene.geometry import visible_faces, weld
from demo_scene.lights import LARGEST, solid_angles
from demo_scene.render import textured_mesh
from lightprobe.core.errors import ConfigError
from lightprobe.core.files import atomic_path, read_json, write_bytes, write_json
from lightprobe.render.path_tracer import tamed

from .cameras import hand_held
from .models import corners, textured
from .objects import OBJECTS, make_object
from .places import Kind, Place, make_place, strangers
from .telephone import Telephone, white_balance
from .tracing import Tracer, ball_lamp, panorama, quad_lamp, sky_lamp

_GROUPS = 4  # of passes, whose median tells a pixel's brightness from one lucky ray's
_LIGHT_ROWS = 128
_FIRST = 1001  # number of the first photo
_APART = 64  # more than there are objects
_MORNING = datetime(2024, 5, 4, 9, 0)


@dataclass(frozen=True)
class Settings:
    """What a shoot is made of; equal settings make equal shoots."""

    object: str
    kinds: tuple[str, ...]  # of the places, in turns
    strangers: bool = False
    seed: int = 0
    places: int = 6  # with `photos` each, for training
    photos: int = 11
    test_places: int = 4
    test_photos: int = 3
    width: int = 960
    samples: int = 64  # of a photo's pixel
    atlas: int = 2048  # texels along the edge of the object's and the table's textures


@dataclass(frozen=True)
class Photo:
    """One photo to be taken."""

    name: str
    split: str
    place: int
    taken: datetime


def plan(settings: Settings) -> list[Photo]:
    """Return all photos: those of a place a minute apart, those of the next an hour later; test places come last."""
    photos: list[Photo] = []
    for place in range(settings.places + settings.test_places):
        split, count = (
            ("train", settings.photos) if place < settings.places else ("test", settings.test_photos)
        )
        for k in range(count):
            taken = _MORNING + timedelta(hours=place, seconds=60 * k)
            photos.append(Photo(f"IMG_{_FIRST + len(photos)}", split, place, taken))
    return photos


class Shoot:
    """The object, its places one at a time, and the folder they are photographed into."""

    def __init__(self, root: Path, settings: Settings, say: Callable[[str], None] = print):
        self.root, self.settings, self.say = root, settings, say
        self.record = self._opened()
        kind = list(OBJECTS).index(settings.object)
        self.seed = settings.seed * _APART + kind  # objects share no places
        rng = np.random.default_rng([self.seed, 3])
        height = round(settings.width * 0.75)
        lens = int(rng.integers(24, 29)), round(rng.uniform(-0.06, 0.03), 4), rng.uniform(0.1, 0.35)
        self.telephone = Telephone(settings.width, height, *lens, grain=rng.uniform(0.008, 0.02))
        self.parts = make_object(settings.object, settings.seed)
        self.points = corners(self.parts)
        self.model = textured(self.parts, settings.atlas)
        self.shape = textured_mesh(self.model)[0]

    def _opened(self) -> dict[str, Any]:
        """Return the record of photos done; raise `ConfigError` where the folder is not of these settings."""
        settings, file = json.loads(json.dumps(asdict(self.settings))), self.root / "shoot.json"
        if not file.exists():
            if self.root.exists() and any(self.root.iterdir()):
                raise ConfigError(f"{self.root} holds files that are no shoot; name a new folder.")
            self.root.mkdir(parents=True, exist_ok=True)
            return {"settings": settings, "places": {}, "frames": []}
        record: Any = read_json(file)
        if not isinstance(record, dict) or record.get("settings") != settings:
            raise ConfigError(
                f"{self.root} was begun with other settings; give the same ones or name a new folder."
            )
        return record

    def write(self) -> None:
        """Take every photo that is not there yet."""
        self._note()
        for folder in ("train", "test", "masks", "light", "env_test"):
            (self.root / folder).mkdir(exist_ok=True)
        photos, done = plan(self.settings), {frame["name"] for frame in self.record["frames"]}
        for number in dict.fromkeys(photo.place for photo in photos):
            waiting = [photo for photo in photos if photo.place == number and photo.name not in done]
            if waiting:
                here = [photo for photo in photos if photo.place == number]
                self._visit(number, here, waiting, len(photos))
        self._write_transforms()
        if not (self.root / "mesh.obj").exists():
            self._write_mesh()

    def _visit(self, number: int, photos: list[Photo], waiting: list[Photo], total: int) -> None:
        """Build a place, note its light, and take those of its photos that are waiting."""
        settings, low = self.settings, float(self.points[:, 2].min())
        kind = Kind(settings.kinds[number % len(settings.kinds)])
        footprint = float(np.linalg.norm(self.points[self.points[:, 2] < low + 0.15][:, :2], axis=1).max())
        place = make_place(kind, number, low, footprint, self.seed)
        things = self._things(place)
        if place.name not in self.record["places"]:
            rng = np.random.default_rng([self.seed, 7, number])
            light = panorama(Tracer(things), _LIGHT_ROWS, settings.samples, rng)
            with atomic_path(self.root / "light" / f"{place.name}.exr") as file:
                write_exr(file, np.minimum(light, LARGEST).astype(np.float32), "RGB")
            mean = (light * solid_angles(_LIGHT_ROWS)[..., None]).sum(axis=(0, 1)) / (4 * np.pi)
            self.record["places"][place.name] = {
                "support": {"normal": [0, 0, 1], "height": low},
                "mean_light": mean.tolist(),
            }
        rng = np.random.default_rng([self.seed, 4, number])
        balance = white_balance(np.array(self.record["places"][place.name]["mean_light"]), rng)
        poses = hand_held(self.points, self.telephone.focal, self.telephone.height, len(photos), rng)
        things["object"] = self.shape
        tracer = Tracer(things)
        for photo, pose in zip(photos, poses, strict=True):
            if photo not in waiting:
                continue
            if settings.strangers:
                crowd = strangers(place, np.random.default_rng([self.seed, 5, int(photo.name[4:])]))
                tracer = Tracer(
                    things | {"strangers": textured_mesh(textured(crowd, settings.atlas // 2))[0]}
                )
            self._take(photo, place, pose, tracer, balance)
            self.say(f"{len(self.record['frames'])} of {total} photos: {photo.name} in {place.name}")

    def _things(self, place: Place) -> dict[str, Any]:
        """Return all but the object as the path tracer knows it."""
        things: dict[str, Any] = {
            "support": textured_mesh(textured(place.support, self.settings.atlas))[0],
            "surroundings": textured_mesh(textured(place.surroundings, self.settings.atlas))[0],
        }
        for k, lamp in enumerate(place.lamps):
            center, ball = lamp.pose[:3, 3], lamp.radius > 0
            shining = (
                ball_lamp(center, lamp.radius, lamp.radiance) if ball else quad_lamp(lamp.pose, lamp.radiance)
            )
            things[f"lamp_{k}"] = shining
        return things if place.sky is None else things | {"sky": sky_lamp(place.sky)}

    def _take(
        self, photo: Photo, place: Place, pose: np.ndarray, tracer: Tracer, balance: np.ndarray
    ) -> None:
        """Take a photo and note it; what is noted is complete on the disk."""
        telephone, number = self.telephone, int(photo.name[4:])
        rng = np.random.default_rng([self.seed, 6, number])
        shape = telephone.height, telephone.width
        passes = max(1, self.settings.samples // _GROUPS)
        groups, cover = np.zeros((_GROUPS, *shape, 3)), np.zeros(shape)
        for k in range(_GROUPS * passes):
            towards = telephone.rays(pose, rng.random((shape[0] * shape[1], 2)))
            groups[k % _GROUPS] += tracer.radiance(pose[:3, 3], towards, rng).reshape(*shape, 3) / passes
            cover += tracer.shows_object(pose[:3, 3], towards).reshape(shape) / (_GROUPS * passes)
        picture = tamed(groups)
        exposure = telephone.exposure(picture * balance, rng)
        shown = telephone.develop(picture * balance * exposure, exposure, rng)
        jpeg = telephone.jpeg(shown, exposure, photo.taken)
        write_bytes(self.root / photo.split / f"{photo.name}.jpg", jpeg)
        with atomic_path(self.root / "masks" / f"{photo.name}.png") as file:
            Image.fromarray(cover > 0.5).save(file, "PNG")
        if photo.split == "test":
            self._write_environment(photo.name, place.name, balance * exposure)
        gain = {"gain": (balance * exposure).tolist(), "exposure": exposure}
        frame = {"name": photo.name, "split": photo.split, "place": place.name}
        self.record["frames"].append(frame | {"transform_matrix": pose.tolist()} | gain)
        self._note()

    def _write_environment(self, photo: str, place: str, gain: np.ndarray) -> None:
        light = read_exr(self.root / "light" / f"{place}.exr", "RGB") * gain
        with atomic_path(self.root / "env_test" / f"{photo}.exr") as file:
            write_exr(file, np.minimum(light, LARGEST).astype(np.float32), "RGB")

    def _note(self) -> None:
        write_json(self.root / "shoot.json", self._lens() | self.record)

    def _lens(self) -> dict[str, Any]:
        telephone = self.telephone
        w, h = telephone.width, telephone.height
        return {
            "fl_x": telephone.focal,
            "fl_y": telephone.focal,
            "cx": w / 2,
            "cy": h / 2,
            "w": w,
            "h": h,
            "k1": telephone.k1,
        }

    def _write_transforms(self) -> None:
        for split in ("train", "test"):
            frames = [
                {
                    "file_path": f"{split}/{frame['name']}.jpg",
                    "mask_path": f"masks/{frame['name']}.png",
                    "transform_matrix": frame["transform_matrix"],
                    "light_group": frame["place"],
                }
                | ({"env_path": f"env_test/{frame['name']}.exr"} if split == "test" else {})
                for frame in self.record["frames"]
                if frame["split"] == split
            ]
            lens = self._lens() | {"camera_model": "OPENCV", "k2": 0, "p1": 0, "p2": 0}
            names = {frame["light_group"] for frame in frames}
            supports = {
                name: {"normal": place["support"]["normal"], "offset": place["support"]["height"]}
                for name, place in self.record["places"].items()
                if name in names
            }
            value = lens | {"supports": supports, "frames": frames}
            write_json(self.root / f"transforms_{split}.json", value)

    def _write_mesh(self) -> None:
        """Write the faces that some ray leaves to the outside, the table away."""
        model, tracer = self.model, Tracer({"object": self.shape})
        seen = visible_faces(model.vertices, model.faces, tracer.sees_sky, np.random.default_rng(self.seed))
        with atomic_path(self.root / "mesh.obj") as file:
            write_obj(file, *weld(model.vertices, model.faces[seen]))
