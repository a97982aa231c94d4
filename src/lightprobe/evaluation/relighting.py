"""The object under a given light, for any camera of the user's."""

from typing import Protocol

import torch
from torch import Tensor

from lightprobe.core.config.rendering import FAST_PICTURES, RenderConfig, Renderer
from lightprobe.light import prefilter
from lightprobe.light.environment import Environment
from lightprobe.models import Decomposition
from lightprobe.render.asset import Asset
from lightprobe.render.path_tracer import PathTracer
from lightprobe.render.picture import Picture
from lightprobe.scene.camera import Camera


class _Render(Protocol):
    """Makes pictures of one asset."""

    def render(self, camera: Camera, light: Tensor) -> tuple[Tensor, Tensor]:
        """Return the image (H, W, 3) and coverage (H, W) from a normalised-frame camera under `light` (6, R,
        R, 3).
        """


class _Fast:
    def __init__(self, asset: Asset):
        self._asset = asset

    def render(self, camera: Camera, light: Tensor) -> tuple[Tensor, Tensor]:
        operator = prefilter.cached(light.shape[1], light.device)
        return Picture.of(self._asset, camera, operator, light.device).render(light)


class Relighter:
    """An object for many pictures under given lights: what depends on the object alone is made once."""

    def __init__(
        self, decomposition: Decomposition, device: torch.device, config: RenderConfig = FAST_PICTURES
    ):
        """Set the object up; lights will be on `device`. Raises `ConfigError` where a path tracer is missing."""
        asset = decomposition.asset.to(device)
        path = config.renderer is Renderer.PATH
        self._render: _Render = PathTracer(asset, config.samples) if path else _Fast(asset)
        self._similarity = decomposition.similarity

    def picture(self, environment: Environment, camera: Camera) -> tuple[Tensor, Tensor]:
        """Return the image (H, W, 3) and the coverage (H, W) of `relight`."""
        return self._render.render(camera.normalised(self._similarity), environment.texels)


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
