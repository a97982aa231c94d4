"""Small scenes of the bundled demo's photos, before a plain backdrop, in which one thing can be made wrong."""

import json
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from importlib import resources
from pathlib import Path

import numpy as np
from PIL import Image

SIDE = 80  # pixels of a photo
BACKDROP = (120, 130, 110)
_ORIENTATION = 0x112


@dataclass(frozen=True)
class Shot:
    """One photo of the demo with its mask and camera."""

    name: str
    pose: np.ndarray  # (4, 4) camera-to-world, OpenGL axes
    photo: Image.Image  # RGB
    mask: Image.Image  # L
    orientation: int = 1  # EXIF
    extra: dict = field(default_factory=dict)  # of the frame


Change = Callable[[Shot], Shot]


def demo_shots(
    count: int = 20, *, size: tuple[int, int] = (SIDE, SIDE)
) -> tuple[list[Shot], dict[str, float]]:
    """Return `count` photos all around the demo's object, and their common intrinsics in pixels of `size`."""
    folder = resources.files("lightprobe") / "assets" / "demo"
    data = json.loads((folder / "transforms_train.json").read_text())
    frames = [data["frames"][i] for i in np.linspace(0, len(data["frames"]) - 1, count).astype(int)]
    width, height = size
    shots = []
    for index, frame in enumerate(frames):
        with (folder / (frame["file_path"].removeprefix("./") + ".png")).open("rb") as file:
            small = Image.open(file).convert("RGBA").resize((SIDE, SIDE), Image.Resampling.BOX)
        whole = Image.new("RGBA", size)
        whole.paste(small, ((width - SIDE) // 2, (height - SIDE) // 2))
        photo = Image.new("RGB", size, BACKDROP)
        photo.paste(whole.convert("RGB"), mask=whole.getchannel("A"))
        pose = np.array(frame["transform_matrix"])
        shots.append(Shot(f"p{index:02d}", pose, photo, whole.getchannel("A")))
    focal = SIDE / 2 / np.tan(data["camera_angle_x"] / 2)
    return shots, {"fl_x": focal, "fl_y": focal, "cx": width / 2, "cy": height / 2, "w": width, "h": height}


def write_shots(root: Path, shots: list[Shot], intrinsics: dict[str, float]) -> Path:
    """Write the scene as nerfstudio has it, photos as JPEG and masks as PNG without EXIF; return its folder."""
    for folder in ("images", "masks"):
        (root / folder).mkdir(parents=True)
    frames = []
    for shot in shots:
        exif = Image.Exif()
        exif[_ORIENTATION] = shot.orientation
        shot.photo.save(root / "images" / f"{shot.name}.jpg", quality=95, exif=exif)
        shot.mask.save(root / "masks" / f"{shot.name}.png")
        pose = {"file_path": f"images/{shot.name}.jpg", "transform_matrix": shot.pose.tolist()}
        frames.append({**pose, **shot.extra})
    (root / "transforms.json").write_text(json.dumps({**intrinsics, "frames": frames}))
    return root


def posed(change: Callable[[np.ndarray], np.ndarray]) -> Change:
    """Return the change of a shot's pose (4, 4) alone."""
    return lambda shot: replace(shot, pose=change(shot.pose.copy()))


def turned_mask(turn: Image.Transpose) -> Change:
    """Return the change that turns a shot's mask, not its photo."""
    return lambda shot: replace(shot, mask=shot.mask.transpose(turn))


def turned(turn: Image.Transpose) -> Change:
    """Return the change that turns a shot's photo and mask, not its camera."""
    return lambda shot: replace(shot, mask=shot.mask.transpose(turn), photo=shot.photo.transpose(turn))


def inverted(shot: Shot) -> Shot:
    """Return the shot with a mask that is black where the object is."""
    return replace(shot, mask=shot.mask.point(lambda value: 255 - value))


def some(change: Change, chosen: Callable[[int], bool]) -> Callable[[list[Shot]], list[Shot]]:
    """Return the change of the shots whose index is `chosen`."""
    return lambda shots: [change(shot) if chosen(i) else shot for i, shot in enumerate(shots)]


def every(change: Change) -> Callable[[list[Shot]], list[Shot]]:
    """Return the change of all shots."""
    return some(change, lambda index: True)
