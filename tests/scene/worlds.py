"""A small world with a marked object, and writers for every layout, each from its format's own documentation.

Cameras are kept as OpenCV states them (x right, y down, z forward; world-to-camera R, t), so that nothing
here shares code or axes with the program. The object is three balls of different colours and sizes, off the
origin.
"""

import json
import re
import struct
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from lightprobe.core.errors import InputError
from lightprobe.scene import load_scene
from lightprobe.scene.camera import Camera
from lightprobe.scene.inspect import inspect

COUNT = 4  # photos of scenes that are damaged
# centre, radius, 8-bit colour
BALLS = (
    ((3.0, 1.0, 2.0), 0.5, (255, 0, 0)),
    ((3.8, 1.0, 2.0), 0.3, (0, 255, 0)),
    ((3.0, 1.2, 2.7), 0.25, (0, 0, 255)),
)
MIDDLE = np.array([3.3, 1.0, 2.225])  # of the object's bounding box


@dataclass(frozen=True)
class View:
    """One OpenCV camera with its image size."""

    rotation: np.ndarray  # world to camera
    translation: np.ndarray
    focal: tuple[float, float]
    center: tuple[float, float]
    width: int
    height: int

    @property
    def position(self) -> np.ndarray:
        return -self.rotation.T @ self.translation

    @property
    def opengl(self) -> np.ndarray:
        """Camera-to-world with columns right, up, backwards, position."""
        right, down, forward = self.rotation
        pose = np.eye(4)
        pose[:3] = np.stack([right, -down, -forward, self.position], axis=1)
        return pose

    def project(self, point) -> tuple[float, float]:
        x, y, z = self.rotation @ np.asarray(point) + self.translation
        return self.focal[0] * x / z + self.center[0], self.focal[1] * y / z + self.center[1]


def views(
    count: int = 18, *, varied: bool = False, zoom: float = 1.0, size: tuple[int, int] = (72, 60)
) -> list[View]:
    """Cameras all around the object; `varied` gives each its own size, focal lengths and principal point."""
    rng = np.random.default_rng(11)
    found = []
    for i in range(count):
        z = 0.85 - 1.5 * (i + 0.5) / count
        across = np.sqrt(1 - z * z)
        outward = np.array([across * np.cos(2.4 * i), across * np.sin(2.4 * i), z])
        position = MIDDLE + (3.5 + 0.5 * np.sin(i)) * outward
        forward = MIDDLE + rng.uniform(-0.05, 0.05, 3) - position
        forward /= np.linalg.norm(forward)
        right = np.cross(forward, [0.0, 0.0, 1.0])
        right /= np.linalg.norm(right)
        rotation = np.stack([right, np.cross(forward, right), forward])
        width, height = ((72, 60), (60, 72), (64, 64))[i % 3] if varied else size
        focal = zoom * 1.4 * min(width, height)
        offset = (1.5 * np.sin(i), 2.0 * np.cos(i)) if varied else (0.0, 0.0)
        center = (width / 2 + offset[0], height / 2 + offset[1])
        focals = (focal, focal * 1.02) if varied else (focal, focal)
        found.append(View(rotation, -rotation @ position, focals, center, width, height))
    return found


def picture(view: View, straighten=lambda points: points) -> tuple[np.ndarray, np.ndarray]:
    """Cast rays at the balls: flat 8-bit colour (H, W, 3) on grey, and an 8-bit mask (H, W).

    `straighten` takes points (..., 2) of the image plane to where a pinhole would see them.
    """
    v, u = np.mgrid[: view.height, : view.width] + 0.5
    plane = straighten(
        np.stack([(u - view.center[0]) / view.focal[0], (v - view.center[1]) / view.focal[1]], -1)
    )
    local = np.concatenate([np.nan_to_num(plane, nan=1e3), np.ones_like(plane[..., :1])], -1)
    rays = local @ view.rotation
    nearest = np.full(u.shape, np.inf)
    color = np.full((*u.shape, 3), 128, np.uint8)
    for center, radius, paint in BALLS:
        offset = np.array(center) - view.position
        a, b, c = (rays**2).sum(-1), rays @ offset, offset @ offset - radius**2
        root = b * b - a * c
        depth = np.where(root > 0, (b - np.sqrt(np.maximum(root, 0))) / a, np.inf)
        hit = depth < nearest
        color[hit], nearest[hit] = paint, depth[hit]
    return color, np.where(np.isfinite(nearest), 255, 0).astype(np.uint8)


def names(count: int) -> list[str]:
    return [f"view_{i:02d}" for i in range(count)]


def write_photos(
    root: Path, shots: list[View], *, suffix: str = ".png", masks: str | None = "{stem}.png"
) -> list[str]:
    """Write `images/` and, unless `masks` is None (alpha channel instead), `masks/`; return the file names."""
    (root / "images").mkdir(parents=True)
    if masks:
        (root / "masks").mkdir()
    files = []
    for name, view in zip(names(len(shots)), shots, strict=True):
        color, mask = picture(view)
        files.append(name + suffix)
        image = Image.fromarray(color if masks else np.dstack([color, mask]))
        image.save(
            root / "images" / files[-1], **({"quality": 95, "subsampling": 0} if suffix == ".jpg" else {})
        )
        if masks:
            Image.fromarray(mask).save(root / "masks" / masks.format(stem=name, name=files[-1]))
    return files


def write_nerd(root: Path, shots: list[View], **photos) -> Path:
    """LLFF: rows of 3x5 [down, right, backwards, position, (height, width, focal)] and two depths."""
    write_photos(root, shots, **photos)
    rows = []
    for view in shots:
        right, down, forward = view.rotation
        size = (view.height, view.width, view.focal[0])
        rows.append(np.append(np.stack([down, right, -forward, view.position, size], axis=1), [1.0, 9.0]))
    np.save(root / "poses_bounds.npy", np.stack(rows))
    return root


def write_blender(root: Path, shots: list[View]) -> Path:
    """Blender: camera_angle_x, paths without extension, RGBA; the first 15 views train, the rest test."""
    for split, part in (("train", shots[:15]), ("test", shots[15:])):
        frames = []
        for i, view in enumerate(part):
            (root / split).mkdir(parents=True, exist_ok=True)
            Image.fromarray(np.dstack(picture(view))).save(root / split / f"r_{i}.png")
            frames.append({"file_path": f"./{split}/r_{i}", "transform_matrix": view.opengl.tolist()})
        angle = 2 * np.arctan(0.5 * part[0].width / part[0].focal[0])
        (root / f"transforms_{split}.json").write_text(
            json.dumps({"camera_angle_x": angle, "frames": frames})
        )
    return root


def write_nerfstudio(root: Path, shots: list[View]) -> Path:
    """nerfstudio: intrinsics per frame, mask_path, JPEG."""
    files = write_photos(root, shots, suffix=".jpg")
    frames = [
        {
            "file_path": f"images/{file}",
            "mask_path": f"masks/{Path(file).stem}.png",
            "transform_matrix": view.opengl.tolist(),
            **dict(zip(("fl_x", "fl_y"), view.focal, strict=True)),
            **dict(zip(("cx", "cy"), view.center, strict=True)),
            **{"w": view.width, "h": view.height},
        }
        for file, view in zip(files, shots, strict=True)
    ]
    (root / "transforms.json").write_text(
        json.dumps({"camera_model": "OPENCV", "k1": 0.0, "k2": 0, "p1": 0.0, "p2": 0.0, "frames": frames})
    )
    return root


def quaternion(rotation: np.ndarray) -> list[float]:
    """Return (w, x, y, z): the eigenvector of Bar-Itzhack's matrix, which has no special cases."""
    r = rotation
    k = np.array(
        [
            [r[0, 0] - r[1, 1] - r[2, 2], 0, 0, 0],
            [r[0, 1] + r[1, 0], r[1, 1] - r[0, 0] - r[2, 2], 0, 0],
            [r[0, 2] + r[2, 0], r[1, 2] + r[2, 1], r[2, 2] - r[0, 0] - r[1, 1], 0],
            [r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1], r[0, 0] + r[1, 1] + r[2, 2]],
        ]
    )
    x, y, z, w = np.linalg.eigh(k / 3)[1][:, -1]
    return [float(value) for value in (w, x, y, z)]


def write_colmap(root: Path, shots: list[View], *, binary: bool, folder: str = "sparse/0", **photos) -> Path:
    """COLMAP: one PINHOLE camera per photo, masks named `photo.jpg.png`."""
    files = write_photos(root, shots, **{"suffix": ".jpg", "masks": "{name}.png", **photos})
    model = root / folder
    model.mkdir(parents=True, exist_ok=True)
    write_colmap_model(model, files, shots, binary=binary)
    return root


def write_colmap_model(
    model: Path,
    files: list[str],
    shots: list[View],
    *,
    binary: bool,
    lens: str = "PINHOLE",
    extra: tuple = (),
) -> None:
    models = ["SIMPLE_PINHOLE", "PINHOLE", "SIMPLE_RADIAL", "RADIAL", "OPENCV", "OPENCV_FISHEYE"]
    models += ["FULL_OPENCV", "FOV", "SIMPLE_RADIAL_FISHEYE", "RADIAL_FISHEYE", "THIN_PRISM_FISHEYE"]
    models += ["RAD_TAN_THIN_PRISM_FISHEYE"]
    models += ["SIMPLE_DIVISION", "DIVISION", "SIMPLE_FISHEYE", "FISHEYE"]
    number = models.index(lens)
    one_focal = lens.startswith(("SIMPLE", "RADIAL"))
    parameters = [[*(view.focal[:1] if one_focal else view.focal), *view.center, *extra] for view in shots]
    if binary:
        cameras, images = struct.pack("<Q", len(shots)), struct.pack("<Q", len(shots))
        for i, (view, file) in enumerate(zip(shots, files, strict=True)):
            cameras += struct.pack("<iiQQ", i + 7, number, view.width, view.height)
            cameras += struct.pack(f"<{len(parameters[i])}d", *parameters[i])
            images += struct.pack("<I7dI", i + 1, *quaternion(view.rotation), *view.translation, i + 7)
            images += file.encode() + b"\0" + struct.pack("<Q", 2) + struct.pack("<ddq", 1.5, 2.5, -1) * 2
        (model / "cameras.bin").write_bytes(cameras)
        (model / "images.bin").write_bytes(images)
        return
    cameras, images = ["# Camera list"], ["# Image list with two lines of data per image:"]
    for i, (view, file) in enumerate(zip(shots, files, strict=True)):
        cameras.append(
            f"{i + 7} {lens} {view.width} {view.height} " + " ".join(map(repr, map(float, parameters[i])))
        )
        pose = " ".join(repr(float(value)) for value in (*quaternion(view.rotation), *view.translation))
        images += [f"{i + 1} {pose} {i + 7} {file}", "" if i % 2 else "1.5 2.5 -1 3.0 4.0 12"]
    (model / "cameras.txt").write_text("\n".join(cameras) + "\n")
    (model / "images.txt").write_text("\n".join(images) + "\n")


LAYOUTS = {
    "nerd": lambda root: (write_nerd(root, views()), views()),
    "blender": lambda root: (write_blender(root, views()), views()),
    "nerfstudio": lambda root: (write_nerfstudio(root, views(varied=True)), views(varied=True)),
    "colmap-text": lambda root: (write_colmap(root, views(varied=True), binary=False), views(varied=True)),
    "colmap-binary": lambda root: (
        write_colmap(root, views(varied=True), binary=True, folder="sparse"),
        views(varied=True),
    ),
}


def expected_camera(view: View) -> Camera:
    """The camera the program must hold for a view."""
    return Camera(view.opengl, *view.focal, *view.center, view.width, view.height)


def refused(root, pattern, *others):
    """Assert that loading fails with one sentence matching `pattern`, and that an inspection reports it too.

    Of the problems that the inspection reports, one must hold each of the words `others`.
    """
    with pytest.raises(InputError, match=pattern) as caught:
        load_scene(root)
    message = str(caught.value)
    assert "\n" not in message
    assert message.endswith(".")
    problems = inspect(root).problems
    assert any(re.search(pattern, problem) for problem in problems)
    assert [sum(words in problem for problem in problems) for words in others] == [1] * len(others)


def edit_json(path, change):
    data = json.loads(path.read_text())
    change(data)
    path.write_text(json.dumps(data))
