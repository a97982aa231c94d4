"""The scene folder: which cameras and lights there are, and the files of every photo."""

import json
from dataclasses import asdict, dataclass, field
from pathlib import Path

import mitsuba as mi
import numpy as np

from .files import round_half, srgb_encode, write_exr, write_obj, write_png
from .geometry import visible_faces, weld
from .lights import (
    HEIGHT,
    LARGEST,
    PHOTOGRAPHED,
    Kind,
    Light,
    luminance,
    make_light,
    photographed_light,
    reduce_area,
)
from .render import Studio, View
from .textures import Model

# field of view: the unit sphere fits into the picture from a distance of 3
ANGLE = 2 * float(np.arctan(0.36))
_KEY = 0.22  # mean luminance a photo is exposed for
_MIX = {"outdoors": 0.375, "room": 0.3, "studio": 0.2, "evening": 0.125}
_RELIGHT_VIEWS = 4
_RELIGHT_KINDS = (Kind.OUTDOORS, Kind.ROOM)
_LOWEST = -0.5  # sine of the elevation of the lowest camera


@dataclass(frozen=True)
class Settings:
    """What a scene is made of; equal settings make equal scenes."""

    seed: int = 7
    side: int = 160
    samples: int = 512  # per pixel of a photo
    train: int = 56
    test: int = 8
    mix: dict[str, float] = field(default_factory=lambda: dict(_MIX))  # share of each kind of light


def camera_views(count: int, rng: np.random.Generator, lowest: float = _LOWEST) -> list[View]:
    """Return cameras 3 to 3.5 away in random order, stratified over the sphere from the height `lowest` up."""
    views = []
    for slot in rng.permutation(count):
        z = lowest + (1 - lowest) * (slot + rng.uniform(0.05, 0.95)) / count
        azimuth = (slot + rng.uniform(-0.3, 0.3)) * np.pi * (3 - np.sqrt(5)) + 0.7
        ring = np.sqrt(1 - z * z)
        position = rng.uniform(3.0, 3.5) * np.array([ring * np.cos(azimuth), ring * np.sin(azimuth), z])
        back = position - rng.uniform(-0.02, 0.02, 3)
        back /= np.linalg.norm(back)
        right = np.cross([0.0, 0.0, 1.0], back)
        right /= np.linalg.norm(right)
        pose = np.eye(4)
        pose[:3] = np.stack([right, np.cross(back, right), back, position], axis=1)
        views.append(View(np.round(pose, 9), ANGLE))
    return views


def draw_kinds(count: int, shares: dict[str, float], rng: np.random.Generator) -> list[Kind]:
    """Return `count` kinds of light in random order, as close to the shares as whole numbers allow."""
    edges = np.cumsum([0.0, *shares.values()]) / sum(shares.values())
    slots = np.searchsorted(edges, (np.arange(count) + 0.5) / count, side="right") - 1
    return [Kind(list(shares)[slot]) for slot in rng.permutation(slots)]


def visible_mesh(studio: Studio, model: Model, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Return the welded mesh (vertices, faces) of the triangles from which some ray reaches the outside."""
    seen = visible_faces(model.vertices, model.faces, studio.sees_sky, rng)
    return weld(model.vertices, model.faces[seen])


class Writer:
    """Renders photos into a scene folder and collects the frames of its JSON files."""

    def __init__(self, root: Path, settings: Settings, model: Model):
        self.root, self.settings, self.model = root, settings, model
        self.studio = Studio(model, HEIGHT)

    def expose(self, light: Light, view: View) -> float:
        """Return the factor that makes this view of this light a well exposed photo."""
        self.studio.set_environment(light.radiance)
        small = self.studio.photograph(view, 64, 64, seed=self.settings.seed)
        covered = small[..., 3] > 0.5
        bright = luminance(small[..., :3][covered])
        return float(_KEY / np.minimum(bright, 4 * np.median(bright)).mean())

    def photograph(
        self, name: str, light: Light, view: View, exposure: float, seed: int
    ) -> tuple[dict, np.ndarray, np.ndarray]:
        """Render and write a photo; return its frame, its premultiplied linear RGBA and its environment."""
        environment = round_half(light.radiance * exposure, LARGEST, bits=light.bits)
        self.studio.set_environment(environment.astype(np.float32))
        image = self.studio.photograph(view, self.settings.side, self.settings.samples, seed)
        alpha = np.clip(image[..., 3:], 0.0, 1.0)
        straight = np.where(alpha > 0, image[..., :3] / np.maximum(alpha, 1e-9), 0.0)
        shown = np.concatenate([srgb_encode(straight) * (alpha > 0), alpha], axis=-1)
        write_png(self.root / f"{name}.png", shown)
        frame = {
            "file_path": f"./{name}",
            "transform_matrix": view.pose.tolist(),
            "hdri": light.name,
            "hdri_shift_deg": light.shift_degrees,
            "exposure": round(exposure, 6),
        }
        return frame, image, environment

    def write_linear(self, name: str, image: np.ndarray) -> dict:
        """Write the unclipped render of a photo; return its key."""
        write_exr(self.root / f"{name}_hdr.exr", round_half(image, LARGEST, bits=7), "RGBA")
        return {"hdr_path": f"./{name}_hdr.exr"}

    def write_maps(self, name: str, view: View) -> dict:
        """Write the true material and normals of a photo; return their keys."""
        maps = self.studio.maps(view, self.settings.side)
        write_png(self.root / f"{name}_basecolor.png", srgb_encode(maps.base))
        write_png(
            self.root / f"{name}_orm.png",
            np.stack([0 * maps.roughness, maps.roughness, maps.metallic], axis=-1),
        )
        write_exr(self.root / f"{name}_normal.exr", round_half(maps.normal, 1.0), "XYZ")
        return {
            f"{key}_path": f"./{name}_{key}.{suffix}"
            for key, suffix in (("basecolor", "png"), ("orm", "png"), ("normal", "exr"))
        }

    def write_environment(self, name: str, environment: np.ndarray) -> dict:
        """Write an environment; return its key."""
        write_exr(self.root / f"{name}.exr", environment, "RGB")
        return {"env_path": f"./{name}.exr"}

    def write_frames(self, split: str, frames: list[dict]) -> None:
        """Write `transforms_<split>.json`."""
        value = {"camera_angle_x": ANGLE, "w": self.settings.side, "h": self.settings.side, "frames": frames}
        (self.root / f"transforms_{split}.json").write_text(json.dumps(value, separators=(",", ":")) + "\n")


def split_lights(settings: Settings, split: str, first_light: int, rng: np.random.Generator) -> list[Light]:
    """Return a light for every photo: computed ones for training, turns of the photographed ones for testing."""
    if split == "test":
        slots = rng.permutation(settings.test) % len(PHOTOGRAPHED)
        return [
            photographed_light(PHOTOGRAPHED[slot], settings.seed, first_light + k)
            for k, slot in enumerate(slots)
        ]
    kinds = draw_kinds(settings.train, settings.mix, rng)
    return [make_light(kind, settings.seed, first_light + k) for k, kind in enumerate(kinds)]


def write_split(writer: Writer, split: str, count: int, first_light: int, lowest: float = _LOWEST) -> None:
    """Photograph the training or test split, every photo under a light of its own, from the height `lowest` up."""
    settings = writer.settings
    rng = np.random.default_rng([settings.seed, first_light])
    lights = split_lights(settings, split, first_light, rng)
    frames: list[dict] = []
    for index, (view, light) in enumerate(zip(camera_views(count, rng, lowest), lights, strict=True)):
        name = f"{split}/r_{index:03d}"
        jitter = float(np.exp2(rng.uniform(-0.5, 0.5)))
        exposure = writer.expose(light, view) * jitter
        frame, image, environment = writer.photograph(name, light, view, exposure, first_light + index)
        if split == "test":
            frame |= writer.write_environment(f"env_test/r_{index:03d}", environment)
            frame |= writer.write_linear(name, image) | writer.write_maps(name, view)
        else:
            small = round_half(reduce_area(environment.astype(np.float64), 2), LARGEST)
            frame |= writer.write_environment(f"env_train/r_{index:03d}", small)
        frames.append(frame | {"exposure_jitter": round(jitter, 6)})
    writer.write_frames(split, frames)


def write_relight(writer: Writer, first_light: int, lowest: float = _LOWEST) -> None:
    """Photograph the object from the same new views under two more lights, one exposure for each light."""
    settings = writer.settings
    views = camera_views(_RELIGHT_VIEWS, np.random.default_rng([settings.seed, first_light]), lowest)
    frames: list[dict] = []
    for index, kind in enumerate(_RELIGHT_KINDS):
        light = make_light(kind, settings.seed, first_light + index)
        exposure = writer.expose(light, views[index])
        for number, view in enumerate(views):
            name = f"relight/r_{len(frames):03d}"
            frame, image, environment = writer.photograph(
                name, light, view, exposure, first_light + len(frames)
            )
            frame |= writer.write_environment(f"env_relight/e_{index}", environment)
            frames.append(
                frame | writer.write_linear(name, image) | {"env_index": index, "view_index": number}
            )
    writer.write_frames("relight", frames)


def write_scene(root: Path, settings: Settings, name: str, model: Model) -> None:
    """Make the whole scene of a model in the folder `root`, which exists."""
    writer = Writer(root, settings, model)
    write_split(writer, "train", settings.train, first_light=0)
    write_split(writer, "test", settings.test, first_light=1000)
    write_relight(writer, first_light=2000)
    vertices, faces = visible_mesh(writer.studio, writer.model, np.random.default_rng(settings.seed))
    write_obj(root / "mesh.obj", vertices, faces)
    record = (
        {"object": name}
        | asdict(settings)
        | {"mitsuba": mi.__version__, "variant": mi.variant(), "key": _KEY}
    )
    (root / "generation.json").write_text(json.dumps(record, indent=1) + "\n")
