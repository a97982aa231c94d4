"""A scene small enough to train on inside a test: a two-coloured ball, each photo under another lamp."""

import json
from pathlib import Path

import numpy as np

from lightprobe.imaging import write_png
from lightprobe.scene.camera import Camera
from tests.shapes import camera_at

SIZE = 40
_PHASES = ("decompose", "distill")


def ball_photo(camera: Camera, lamp: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return linear colour (H, W, 3) and coverage (H, W) of the unit ball under sky light and a distant lamp."""
    fine = camera.resized(4 * camera.width, 4 * camera.height)
    y, x = np.mgrid[: fine.height, : fine.width] + 0.5
    local = np.stack([(x - fine.cx) / fine.fx, -(y - fine.cy) / fine.fy, -np.ones_like(x)], -1)
    ray = local @ camera.camera_to_world[:3, :3].T
    ray /= np.linalg.norm(ray, axis=-1, keepdims=True)
    along = ray @ camera.position
    under_root = along**2 - camera.position @ camera.position + 1
    hit = under_root > 0
    normal = camera.position + (-along - np.sqrt(np.maximum(under_root, 0)))[..., None] * ray
    base = np.where((normal[..., :1] * normal[..., 1:2] > 0), [0.7, 0.25, 0.15], [0.15, 0.3, 0.6])
    light = 0.35 + 0.2 * normal[..., 2:] + 0.8 * np.maximum(normal @ lamp, 0)[..., None]
    cover = hit.reshape(camera.height, 4, camera.width, 4).mean((1, 3))
    total = (base * light * hit[..., None]).reshape(camera.height, 4, camera.width, 4, 3).mean((1, 3))
    return total / np.maximum(cover, 1e-6)[..., None], cover


def write_toy_scene(folder: Path, *, train: int = 18, test: int = 2) -> Path:
    """Write the scene in Blender's layout with alpha channels and return its folder."""
    rng = np.random.default_rng(7)
    for split, count in (("train", train), ("test", test)):
        frames = []
        for i in range(count):
            direction = np.array([np.cos(2.4 * i), np.sin(2.4 * i), 1.2 * (i + 0.5) / count - 0.4])
            camera = camera_at(3.2 * direction / np.linalg.norm(direction), size=SIZE, focal=1.25 * SIZE)
            lamp = rng.normal(size=3)
            color, cover = ball_photo(camera, lamp / np.linalg.norm(lamp))
            write_png(folder / split / f"{split}_{i:02d}.png", color, cover)
            frames.append(
                {"file_path": f"{split}/{split}_{i:02d}", "transform_matrix": camera.camera_to_world.tolist()}
            )
        settings = {"fl_x": camera.fx, "fl_y": camera.fy, "w": SIZE, "h": SIZE}
        (folder / f"transforms_{split}.json").write_text(json.dumps({**settings, "frames": frames}))
    return folder


TINY = [
    "--device",
    "cpu",
    "--decompose.pass1-iterations",
    "12",
    "--decompose.pass2-iterations",
    "8",
    "--decompose.pass3-iterations",
    "10",
    "--decompose.pass1-side",
    "32",
    "--decompose.pass2-side",
    "32",
    "--decompose.pass3-texture-size",
    "96",
    "--decompose.lattice-cells",
    "12",
    "--decompose.hull-voxels",
    "24",
    "--decompose.hash-levels",
    "4",
    "--decompose.hash-finest",
    "32",
    "--decompose.light-resolution",
    "8",
    "--decompose.teacher-resolution",
    "8",
    "--decompose.texture-size",
    "64",
    "--decompose.light-solve-pixels",
    "256",
    "--decompose.checkpoint-every",
    "5",
    "--decompose.trial-steps",
    "3",
]


def changed(words: list[str], **values: object) -> list[str]:
    """Return the words of a command with other values for some options, by their names without the phase."""
    new = {
        f"--{phase}.{name.replace('_', '-')}": value for name, value in values.items() for phase in _PHASES
    }
    return [str(new.get(before, word)) for before, word in zip(["", *words], words, strict=False)]


# where nothing depends on how bright the object came out: tried brightnesses take a third of the time
TINY_WITHOUT_TRIALS = changed(TINY, trial_steps=0)
TINY_DISTILL = [
    "--distill.steps",
    "12",
    "--distill.samples",
    "64",
    "--distill.light-resolution",
    "8",
    "--distill.width",
    "16",
    "--distill.checkpoint-every",
    "5",
    "--distill.sphere-steps",
    "6",
    "--distill.sphere-width",
    "4",
    "--distill.synthetic-lessons",
    "8",
    "--distill.simulated-photos",
    "2",
]
