"""The object under a given light, for any camera of the user's, and cameras that no photo has."""

import math

import numpy as np
import torch
from torch import Tensor

from lightprobe.core.config.rendering import FAST_PICTURES, RenderConfig, Renderer
from lightprobe.light import prefilter
from lightprobe.light.environment import Environment
from lightprobe.models import Decomposition
from lightprobe.render.path_tracer import PathTracer
from lightprobe.render.picture import Picture
from lightprobe.scene.camera import Camera, up_of


class Relighter:
    """An object for many pictures under given lights: what depends on the object alone is made once."""

    def __init__(
        self, decomposition: Decomposition, device: torch.device, config: RenderConfig = FAST_PICTURES
    ):
        """Set the object up for lights on `device`. Raises `ConfigError` where a path tracer is missing."""
        self._asset, self._similarity = decomposition.asset.to(device), decomposition.similarity
        is_path = config.renderer is Renderer.PATH
        self._tracer = PathTracer(self._asset, config.samples) if is_path else None

    def picture(self, environment: Environment, camera: Camera) -> tuple[Tensor, Tensor]:
        """Return the image (H, W, 3) and the coverage (H, W) of `relight`."""
        camera, light = camera.normalised(self._similarity), environment.texels
        if self._tracer is not None:
            return self._tracer.render(camera, light)
        operator = prefilter.cached(light.shape[1], light.device)
        return Picture.of(self._asset, camera, operator, light.device).render(light)


def relight(
    decomposition: Decomposition,
    environment: Environment,
    camera: Camera,
    config: RenderConfig = FAST_PICTURES,
) -> tuple[Tensor, Tensor]:
    """Return the object under `environment` seen by an input-frame camera.

    The image (H, W, 3) is linear and premultiplied, the coverage (H, W) in [0, 1]; both on the environment's
    device. Raises `ConfigError` where `config` asks for a path tracer that is not installed.
    """
    return Relighter(decomposition, environment.device, config).picture(environment, camera)


def look_at(position: np.ndarray, target: np.ndarray, up: np.ndarray) -> np.ndarray:
    """Return the camera-to-world pose (4, 4) at `position` (3,) that looks at `target` with `up` upwards."""
    back = np.asarray(position, np.float64) - target
    back = back / np.linalg.norm(back)
    right = np.cross(up, back)
    if np.linalg.norm(right) < 1e-6:  # looking along the up direction: any right vector will do
        right = np.cross(np.eye(3)[np.argmin(np.abs(back))], back)
    right = right / np.linalg.norm(right)
    pose = np.eye(4)
    pose[:3] = np.stack([right, np.cross(back, right), back, position], axis=1)
    return pose


def cameras_around(count: int, side: int, radius: float) -> list[Camera]:
    """Return `count` square cameras evenly all around the origin that each see a ball of `radius` whole.

    They stand on a Fibonacci sphere at four radii.
    """
    distance = 4.0
    number = np.arange(count) + 0.5
    z, turn = 1 - 2 * number / count, math.pi * (1 + math.sqrt(5)) * number
    ring = np.sqrt(1 - z * z)
    directions = np.stack([ring * np.cos(turn), ring * np.sin(turn), z], axis=1)
    focal = 0.98 * 0.5 * side * math.sqrt(distance**2 - 1)  # a unit ball fills 98 % of the picture
    up, origin = np.array([0.0, 0.0, 1.0]), np.zeros(3)
    poses = [look_at(distance * radius * direction, origin, up) for direction in directions]
    return [Camera(pose, focal, focal, side / 2, side / 2, side, side) for pose in poses]


def turntable(photos: list[Camera], center: np.ndarray, frames: int, side: int) -> list[Camera]:
    """Return cameras circling `center` (3,) at the photos' median distance, height and framing.

    The axis of the circle is the mean upward direction of the photos, so frames stand upright in any user's
    frame.
    """
    up = up_of(photos)
    offsets = np.array([camera.position - center for camera in photos])
    distance = float(np.median(np.linalg.norm(offsets, axis=1)))
    elevation = float(np.clip(np.median(offsets @ up / np.linalg.norm(offsets, axis=1)), -0.9, 0.9))
    sideways = offsets - (offsets @ up)[:, None] * up
    beside = np.linalg.norm(sideways, axis=1)
    first = int(np.argmax(beside > 1e-3 * distance))  # a camera right above the object shows no way to begin
    start = sideways[first] / beside[first] if beside[first] > 0 else look_at(up, np.zeros(3), up)[:3, 0]
    across = np.cross(up, start)
    focal = side * float(np.median([camera.fx / max(camera.width, camera.height) for camera in photos]))
    cameras = []
    for turn in 2 * math.pi * np.arange(frames) / frames:
        around = math.cos(turn) * start + math.sin(turn) * across
        position = center + distance * (elevation * up + math.sqrt(1 - elevation**2) * around)
        cameras.append(Camera(look_at(position, center, up), focal, focal, side / 2, side / 2, side, side))
    return cameras
