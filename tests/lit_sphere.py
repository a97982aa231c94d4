"""A sphere of known material under known lights, for tests of what learns and predicts light."""

import numpy as np
import torch
from torch import Tensor

from lightprobe.core.config.distillation import DistillConfig
from lightprobe.distillation.examples import ExampleMaker, TrainingExample
from lightprobe.geometry.textures import Textures
from lightprobe.light import cubemap, prefilter
from lightprobe.prediction.observation import Observation, observe
from lightprobe.render.asset import Asset, rasterize_asset
from lightprobe.render.split_sum import shade
from lightprobe.scene.camera import Camera
from lightprobe.scene.photo import Pixels
from tests.shapes import camera_at, sphere_mesh

CPU = torch.device("cpu")


def glossy_sphere() -> Asset:
    """Return a unit sphere with blotches of colour, roughness .1 to .5 and some metal."""
    random = torch.Generator().manual_seed(11)
    blotches = torch.rand(1, 5, 8, 8, generator=random)
    maps = (
        torch.nn.functional.interpolate(blotches, (128, 128), mode="bilinear")[0]
        .permute(1, 2, 0)
        .contiguous()
    )
    normal = torch.tensor([0.0, 0.0, 1.0]).expand(128, 128, 3).contiguous()
    textures = Textures(
        0.1 + 0.8 * maps[..., :3], 0.1 + 0.4 * maps[..., 3], (maps[..., 4] > 0.6).float(), normal
    )
    return Asset(sphere_mesh(3, 128), textures)


def patch_light(direction, resolution: int = 16, brightness: float = 8.0, color=(1.0, 0.9, 0.7)) -> Tensor:
    """Return a dim bluish light (6, R, R, 3) with a bright patch of about 25 degrees around `direction`."""
    axis = torch.nn.functional.normalize(torch.tensor(direction, dtype=torch.float32), dim=0)
    inside = (cubemap.directions(resolution) @ axis > 0.9)[..., None]
    return torch.where(inside, brightness * torch.tensor(color), torch.tensor([0.3, 0.35, 0.4])).contiguous()


def photograph(asset: Asset, camera: Camera, light: Tensor) -> Pixels:
    """Return the unclipped photo of the asset."""
    gbuffer = rasterize_asset(asset, camera, CPU)
    operator = prefilter.cached(light.shape[1], CPU)
    color = np.zeros((camera.height * camera.width, 3), np.float32)
    color[gbuffer.pixel] = shade(gbuffer, operator, operator.apply(light)).numpy()
    alpha = np.zeros(len(color), np.float32)
    alpha[gbuffer.pixel] = 1
    shape = (camera.height, camera.width)
    return Pixels.of(color.reshape(*shape, 3), alpha.reshape(shape))


def lesson(
    asset: Asset, camera: Camera, light: Tensor, name: str, config: DistillConfig | None = None
) -> TrainingExample:
    """Return the lesson of a photo whose teacher is the true light."""
    photo = photograph(asset, camera, light)
    gbuffer = rasterize_asset(asset, camera, CPU)
    color, clipped = (torch.from_numpy(x).reshape(-1, 3)[gbuffer.pixel] for x in (photo.color, photo.clipped))
    return ExampleMaker(gbuffer, torch.tensor([0.0, 0.0, 1.0]), config or DistillConfig()).example(
        name, color, clipped, light
    )


CORNER = camera_at((2.6, 1.4, 1.2), size=64, focal=85.0)


def corner(device: torch.device = CPU) -> tuple[Observation, Tensor]:
    """Return the observation of a corner of a sphere, lit from the side, and the direction that the corner
    faces.
    """
    asset = glossy_sphere()
    photo = photograph(asset, CORNER, patch_light((0.2, 1.0, 0.5)))
    mask = np.zeros_like(photo.alpha)
    mask[30:38, 18:26] = photo.alpha[30:38, 18:26]
    observation = observe(asset.to(device), Pixels.of(photo.color, mask), CORNER, device, 65_536)
    return observation, observation.gbuffer.normal[observation.rows].mean(0)


PATCHES = (
    (1.0, 0.3, 0.4),
    (-0.8, 0.9, 0.2),
    (0.2, -1.0, 0.5),
    (0.1, 0.2, 1.0),
    (-0.6, -0.6, 0.5),
    (0.7, 0.2, -0.5),
)


def lessons(asset: Asset) -> list[TrainingExample]:
    """Return six photos from one viewpoint, each with its patch elsewhere."""
    camera = camera_at((2.6, 1.4, 1.2), size=48, focal=64.0)
    return [lesson(asset, camera, patch_light(patch), f"photo{k}") for k, patch in enumerate(PATCHES)]
