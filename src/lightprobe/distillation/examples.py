"""Training examples of Phase II: photos with their Phase I lights, and re-rendered photos under known lights.

What does not change while training is computed here once.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields

import torch
from torch import Tensor

from lightprobe.core.config.distillation import DistillConfig, ExampleSource
from lightprobe.core.device import draw_rows, generator, to_device
from lightprobe.core.errors import InputError
from lightprobe.distillation.draw import Draw
from lightprobe.distillation.synthetic import LightPool, rerender
from lightprobe.imaging import CLIPPED
from lightprobe.light import cubemap
from lightprobe.light.environment import Environment
from lightprobe.light.resize import resize_light
from lightprobe.models.probe_distribution import total_distribution
from lightprobe.models.probe_maps import RESOLUTION, SOLVED_PIXELS, coarse_lights
from lightprobe.models.probe_pixels import ProbePixels, probe_pixels
from lightprobe.render.asset import Asset, rasterize_asset
from lightprobe.render.coarse_transport import CoarseTransport
from lightprobe.render.gbuffer import GBuffer
from lightprobe.scene import load_pixels
from lightprobe.scene.camera import up_of
from lightprobe.scene.photo import OPAQUE, Photo, Scene

_FEWEST_PIXELS = 16  # of a photo that can tell of a light
_SYNTHETIC_PIXELS = 2048  # rendered for a re-rendered photo


@dataclass(frozen=True)
class TrainingExample:
    """One photo's pixels on the asset, and M texels of the light it was taken in, on the training device."""

    name: str
    pixels: ProbePixels  # N pixels, linear colour in the photo's own exposure
    clipped: Tensor  # (N, 3) bool
    light_level: Tensor  # () radiance
    distribution: Tensor  # (M,) distribution of all pixels, the divisor of the sample weight
    solved: Tensor  # (2, 384, 3) from `probe_maps.coarse_lights`
    up: Tensor  # (3,) unit, for most of the cameras
    target: Tensor  # (M, 3) the light to predict: radiance / light_level

    def to(self, device: torch.device) -> "TrainingExample":
        """Return the example on `device`."""
        _, *parts = (getattr(self, field.name) for field in fields(self))
        return TrainingExample(self.name, *(part.to(device) for part in parts))


class ExampleMaker:
    """One camera's view of the asset, from which any number of examples under different lights are made."""

    def __init__(self, gbuffer: GBuffer, up: Tensor, config: DistillConfig):
        """Take the G-buffer of the N pixels of all examples, in any order, and the direction (3,) that is up."""
        self.gbuffer, self.config = gbuffer, config
        self.up = up.to(gbuffer.normal.device)
        some = -(-len(gbuffer.pixel) // SOLVED_PIXELS)
        self._some = torch.arange(0, len(gbuffer.pixel), some, device=gbuffer.pixel.device)
        self._transport = CoarseTransport.of(gbuffer.select(self._some))
        rows = torch.arange(len(gbuffer.pixel), device=gbuffer.pixel.device)
        self._pixels = probe_pixels(gbuffer, rows, torch.zeros_like(gbuffer.base_color))
        directions = cubemap.directions(config.light_resolution, rows.device).reshape(-1, 3)
        self._distribution = total_distribution(
            self._pixels, directions, config.alpha_rule, config.total_distribution, config.samples
        )

    def example(
        self, name: str, color: Tensor, clipped: Tensor, light: Tensor, exposure: Tensor | float = 1.0
    ) -> TrainingExample:
        """Return the example of a photo taken in `light` (6, R, R, 3) times `exposure`.

        color (N, 3): its linear colours; clipped (N, 3) bool: which of them are only bounds from below.
        """
        pixels = self._pixels.photographed(color)
        level = pixels.light_level()
        side = self.config.light_resolution
        target = (resize_light(light, side) * exposure).reshape(-1, 3) / level
        solved = coarse_lights(self._transport, color[self._some], level)
        return TrainingExample(name, pixels, clipped, level, self._distribution, solved, self.up, target)


@dataclass(frozen=True)
class _TrainingView:
    """The trusted pixels of a training photo."""

    photo: Photo
    gbuffer: GBuffer  # N pixels
    color: Tensor  # (N, 3) linear
    clipped: Tensor  # (N, 3) bool


def collect_examples(
    asset: Asset,
    lights: Mapping[str, Environment],
    scene: Scene,
    config: DistillConfig,
    device: torch.device,
    seed: int,
    environments: Sequence[Environment] = (),
    on_example: Callable[[int, int], None] | None = None,
) -> list[TrainingExample]:
    """Return the examples from each training photo that has a light and shows the object, in the scene's
    order.

    `environments`: of any resolution, to light re-rendered photos with. `on_example` hears of (done, all)
    photos. Raises `InputError` when no photo shows the object.
    """
    up = torch.from_numpy(up_of(photo.camera for photo in scene.train)).float()
    pool = LightPool(up, [lights[name] for name in sorted(lights)], environments, RESOLUTION, seed, device)
    examples: list[TrainingExample] = []
    shown: _TrainingView | None = None
    photos, first = [photo for photo in scene.train if photo.name in lights], 0
    for done, photo in enumerate(photos, start=1):
        view = _training_view(asset, photo, scene, config, device, seed)
        if view is not None:
            if config.lessons is not ExampleSource.SYNTHETIC:
                maker = ExampleMaker(view.gbuffer, up, config)
                light = lights[photo.name].to(device).texels
                examples.append(maker.example(photo.name, view.color, view.clipped, light))
            if config.lessons is not ExampleSource.TEACHER:
                # Also the share of photos before this one that show too little.
                last = done * config.synthetic_lessons // len(photos)
                examples += _synthetic(view, pool, range(first, last), config, seed)
                first, shown = last, view
        if on_example is not None:
            on_example(done, len(photos))
    if shown is not None:
        examples += _synthetic(shown, pool, range(first, config.synthetic_lessons), config, seed)
    if not examples:
        raise InputError(
            f"None of the {len(scene.train)} training photos in {scene.root} shows the reconstructed object; "
            "look at the masks and poses with `lightprobe inspect`."
        )
    return examples


def _synthetic(
    view: _TrainingView, pool: LightPool, numbers: range, config: DistillConfig, seed: int
) -> list[TrainingExample]:
    """Return the re-rendered examples `numbers` in the camera of a photo."""
    order = torch.randperm(len(view.color), generator=generator(seed, f"distill-rerender/{view.photo.name}"))
    gbuffer = view.gbuffer.select(to_device(order[:_SYNTHETIC_PIXELS], view.color.device))
    maker, examples = ExampleMaker(gbuffer, pool.up, config), []
    for number in numbers:
        light = pool.light(number)
        color, exposure = rerender(gbuffer, light, Draw(generator(seed, "rerender", number)))
        examples.append(maker.example(f"synthetic {number}", color, color >= CLIPPED, light, exposure))
    return examples


def _training_view(
    asset: Asset, photo: Photo, scene: Scene, config: DistillConfig, device: torch.device, seed: int
) -> _TrainingView | None:
    """Return at most `pixels_per_photo` random object pixels of a training photo; None where it has few."""
    loaded, camera = load_pixels(photo, config.max_side)
    gbuffer = rasterize_asset(asset, camera.normalised(scene.similarity), device)
    opaque = torch.from_numpy(loaded.alpha).to(device).reshape(-1)[gbuffer.pixel] >= OPAQUE
    rows = opaque.nonzero()[:, 0]
    if len(rows) < _FEWEST_PIXELS:
        return None
    rows = draw_rows(rows, config.pixels_per_photo, generator(seed, f"distill-keep/{photo.name}"))
    at = gbuffer.pixel[rows]
    parts = (loaded.color, loaded.clipped)
    color, clipped = (torch.from_numpy(part).to(device).reshape(-1, 3)[at] for part in parts)
    return _TrainingView(photo, gbuffer.select(rows), color, clipped)
