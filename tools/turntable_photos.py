"""Photos of an object that is turned before a background that stays, which misleads structure from motion.

A lumpy solid, painted with patches, under another light in every photo: soft light from one side, a warm
lamp, some gloss. The background is one textured picture, as bright as each photo's light: from a tripod it is
the same in all photos. Writes OUT/images/*.jpg, the true masks as OUT/true_masks/*.png and cameras as
OUT/true_cameras.json: frames of `camera_to_world` (OpenGL axes, z up, the object at the origin) with fx, fy,
cx, cy, width and height.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import scipy
import torch
import trimesh
from PIL import Image

from lightprobe.core.files import write_json
from lightprobe.imaging import srgb_encode, write_png
from lightprobe.kernels import rasterize
from lightprobe.scene.camera import Camera

_ELEVATION, _DISTANCE = 25.0, 4.0  # degrees, radii
_PATCHES = 9000  # of the paint
_OVERSAMPLING = 2  # per pixel edge


@dataclass(frozen=True)
class Rendered:
    """One photo with its truth."""

    color: np.ndarray  # (H, W, 3) float32 linear
    alpha: np.ndarray  # (H, W) float32
    camera: Camera


def render(count: int, side: int, *, focal: float = 1.5, arc: float = 360.0, seed: int = 0) -> list[Rendered]:
    """Return photos, shapes as in `Rendered`, that go around it by `arc` degrees; `focal` is in sides."""
    rng = np.random.default_rng(seed)
    vertices, faces = _solid(rng)
    paint = scipy.spatial.cKDTree(rng.uniform(-1.2, 1.2, (_PATCHES, 3)))
    colors = rng.uniform(0.05, 0.9, (_PATCHES, 3))
    back = _backdrop(rng, side)
    cameras = [_camera(np.deg2rad(arc) * i / count, focal * side, side) for i in range(count)]
    photos = []
    for index, camera in enumerate(cameras):
        light = np.random.default_rng(1000 * seed + index)
        color, alpha = _object(camera, vertices, faces, paint, colors, light)
        level = color[alpha > 0.5].mean()
        composed = color + np.clip(1.5 * level * back, 0, 1) * (1 - alpha[..., None])
        photos.append(Rendered(np.clip(composed * 0.4 / level, 0, 1).astype(np.float32), alpha, camera))
    return photos


def _camera(azimuth: float, focal: float, side: int) -> Camera:
    up = np.deg2rad(_ELEVATION)
    back = np.array([np.cos(azimuth) * np.cos(up), np.sin(azimuth) * np.cos(up), np.sin(up)])
    right = np.array([-np.sin(azimuth), np.cos(azimuth), 0.0])
    pose = np.eye(4)
    pose[:3, :4] = np.stack([right, np.cross(back, right), back, _DISTANCE * back], axis=1)
    return Camera(pose, focal, focal, side / 2, side / 2, side, side)


def _solid(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Return vertices (V, 3) and faces (F, 3) of a sphere with lumps."""
    ball = trimesh.creation.icosphere(5)
    directions = np.asarray(ball.vertices)
    radius = np.full(len(directions), 0.62)
    for _ in range(14):
        towards = rng.normal(size=3)
        radius += rng.uniform(-0.12, 0.22) * np.exp(9 * (directions @ towards / np.linalg.norm(towards) - 1))
    return directions * radius[:, None] * [1.0, 0.8, 1.15], np.asarray(ball.faces)


def _object(
    camera: Camera,
    vertices: np.ndarray,
    faces: np.ndarray,
    paint: scipy.spatial.cKDTree,
    colors: np.ndarray,
    rng: np.random.Generator,
) -> tuple[np.ndarray, np.ndarray]:
    """Return premultiplied linear colour (H, W, 3) and coverage (H, W) of the object under a new light."""
    fine = camera.resized(_OVERSAMPLING * camera.width, _OVERSAMPLING * camera.height)
    screen = torch.from_numpy(fine.project(vertices).astype(np.float32))
    face = rasterize(screen, torch.from_numpy(faces.astype(np.int32)), fine.height, fine.width).face.numpy()
    rows, columns = np.nonzero(face >= 0)
    corners = vertices[faces[face[rows, columns]]]
    x, y = (columns + 0.5 - fine.cx) / fine.fx, -(rows + 0.5 - fine.cy) / fine.fy
    rays = np.stack([x, y, -np.ones(len(rows))], 1) @ fine.camera_to_world[:3, :3].T
    flat = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    flat /= np.linalg.norm(flat, axis=1, keepdims=True)
    along = ((corners[:, 0] - fine.position) * flat).sum(1) / (rays * flat).sum(1)
    points = fine.position + along[:, None] * rays
    view = -rays / np.linalg.norm(rays, axis=1, keepdims=True)
    shaded = colors[paint.query(points)[1]] * _light(flat, rng) + _gloss(flat, view, rng)
    picture, cover = np.zeros((*face.shape, 3)), (face >= 0).astype(float)
    picture[rows, columns] = shaded
    blocks = (camera.height, _OVERSAMPLING, camera.width, _OVERSAMPLING)
    return picture.reshape(*blocks, 3).mean((1, 3)), cover.reshape(blocks).mean((1, 3)).astype(np.float32)


def _light(normals: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Return irradiance (K, 3): light from everywhere, more from one side, and a lamp of some colour."""
    side, lamp = (direction / np.linalg.norm(direction) for direction in rng.normal(size=(2, 3)))
    soft = 0.35 + 0.25 * (normals @ side)[:, None]
    lit = 0.7 * np.maximum(normals @ lamp, 0)[:, None]
    return soft * rng.uniform(0.7, 1.3, 3) + lit * rng.uniform(0.6, 1.2, 3)


def _gloss(normals: np.ndarray, view: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Return the reflection (K, 3) of a broad lamp."""
    lamp = rng.normal(size=3)
    half = view + lamp / np.linalg.norm(lamp)
    half /= np.linalg.norm(half, axis=1, keepdims=True)
    return 0.15 * np.maximum((normals * half).sum(1), 0)[:, None] ** 40 * np.ones(3)


def _backdrop(rng: np.random.Generator, side: int) -> np.ndarray:
    """Return a picture (side, side, 3) of cloudy colours with boxes."""
    picture = np.zeros((side, side, 3))
    for cell in (16, 64, 256):
        noise = rng.normal(size=(side // cell + 3, side // cell + 3, 3))
        picture += cell**0.4 * scipy.ndimage.zoom(noise, (cell, cell, 1), order=1)[:side, :side]
    picture = (picture - picture.min()) / np.ptp(picture)
    for _ in range(250):
        top, left = rng.integers(0, side, 2)
        height, width = rng.integers(side // 50, side // 12, 2)
        picture[top : top + height, left : left + width] = rng.uniform(0, 1, 3)
    return picture**2.2


def write(photos: Sequence[Rendered], folder: Path) -> None:
    """Write the photos, their true masks and cameras; shapes as in `Rendered`."""
    (folder / "images").mkdir(parents=True, exist_ok=True)
    frames = {}
    for index, photo in enumerate(photos):
        name = f"p_{index:03d}"
        encoded = np.clip(srgb_encode(photo.color) * 255 + 0.5, 0, 255).astype(np.uint8)
        Image.fromarray(encoded).save(folder / "images" / f"{name}.jpg", quality=95)
        mask = np.repeat(photo.alpha[..., None], 3, axis=2)
        write_png(folder / "true_masks" / f"{name}.png", mask, srgb=False)
        frames[name] = photo.camera.to_json()
    write_json(folder / "true_cameras.json", frames)
