"""What the training loops look at: photos with their Phase I environments, and re-rendered ones under known
lights.

Everything that does not change while training is computed here once.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from lightprobe.core.config.distillation import DistillConfig, ExampleSource
from lightprobe.core.device import draw_rows, generator, to_device
from lightprobe.core.errors import InputError
from lightprobe.imaging import CLIPPED
from lightprobe.lessons.draw import Draw
from lightprobe.lessons.lesson import Lesson, LessonMaker
from lightprobe.lessons.synthetic import LightPool, rerender
from lightprobe.light.environment import Environment
from lightprobe.models.probe_maps import RESOLUTION
from lightprobe.render.asset import Asset, rasterize_asset
from lightprobe.render.gbuffer import GBuffer
from lightprobe.scene import load_pixels
from lightprobe.scene.camera import up_of
from lightprobe.scene.photo import OPAQUE, Photo, Scene

_FEWEST_PIXELS = 16  # of a photo that can tell of a light
_SYNTHETIC_PIXELS = 2048  # rendered for a re-rendered photo


@dataclass(frozen=True)
class _TrainingView:
    """The trusted pixels of a training photo."""

    photo: Photo
    gbuffer: GBuffer  # N pixels
    color: Tensor  # (N, 3) linear
    clipped: Tensor  # (N, 3) bool


def collect_lessons(
    asset: Asset,
    lights: Mapping[str, Environment],
    scene: Scene,
    config: DistillConfig,
    device: torch.device,
    seed: int,
    environments: Sequence[Environment] = (),
    on_lesson: Callable[[int, int], None] | None = None,
) -> list[Lesson]:
    """Return the lessons from each training photo that has a light and shows the object, in the scene's
    order.

    `environments`: of any resolution, to light re-rendered photos with. `on_lesson` hears of (done, all)
    photos. Raises `InputError` when no photo shows the object.
    """
    up = torch.from_numpy(up_of(photo.camera for photo in scene.train)).float()
    pool = LightPool(up, [lights[name] for name in sorted(lights)], environments, RESOLUTION, seed, device)
    lessons: list[Lesson] = []
    shown: _TrainingView | None = None
    photos, first = [photo for photo in scene.train if photo.name in lights], 0
    for done, photo in enumerate(photos, start=1):
        look = _training_view(asset, photo, scene, config, device, seed)
        if look is not None:
            if config.lessons is not ExampleSource.SYNTHETIC:
                desk = LessonMaker(look.gbuffer, up, config)
                light = lights[photo.name].to(device).texels
                lessons.append(desk.lesson(photo.name, look.color, look.clipped, light))
            if (
                config.lessons is not ExampleSource.TEACHER
            ):  # also the share of photos before it that show too little
                last = done * config.synthetic_lessons // len(photos)
                lessons += _synthetic(look, pool, range(first, last), config, seed)
                first, shown = last, look
        if on_lesson is not None:
            on_lesson(done, len(photos))
    if shown is not None:
        lessons += _synthetic(shown, pool, range(first, config.synthetic_lessons), config, seed)
    if not lessons:
        raise InputError(
            f"None of the {len(scene.train)} training photos in {scene.root} shows the reconstructed object; "
            "look at the masks and poses with `lightprobe inspect`."
        )
    return lessons


def _synthetic(
    look: _TrainingView, pool: LightPool, numbers: range, config: DistillConfig, seed: int
) -> list[Lesson]:
    """Return the re-rendered lessons `numbers` in the camera of a photo."""
    order = torch.randperm(len(look.color), generator=generator(seed, f"distill-rerender/{look.photo.name}"))
    gbuffer = look.gbuffer.select(to_device(order[:_SYNTHETIC_PIXELS], look.color.device))
    desk, lessons = LessonMaker(gbuffer, pool.up, config), []
    for number in numbers:
        light = pool.light(number)
        color, exposure = rerender(gbuffer, light, Draw(generator(seed, "rerender", number)))
        lessons.append(desk.lesson(f"synthetic {number}", color, color >= CLIPPED, light, exposure))
    return lessons


def _training_view(
    asset: Asset, photo: Photo, scene: Scene, config: DistillConfig, device: torch.device, seed: int
) -> _TrainingView | None:
    """Return at most `pixels_per_photo` object pixels of a training photo, chosen at random; None where it
    has few.
    """
    loaded, camera = load_pixels(photo, config.max_side)
    gbuffer = rasterize_asset(asset, camera.normalised(scene.similarity), device)
    opaque = torch.from_numpy(loaded.alpha).to(device).reshape(-1)[gbuffer.pixel] >= OPAQUE
    rows = opaque.nonzero()[:, 0]
    if len(rows) < _FEWEST_PIXELS:
        return None
    rows = draw_rows(rows, config.pixels_per_photo, generator(seed, f"distill-keep/{photo.name}"))
    at = gbuffer.pixel[rows]
    color, clipped = (
        torch.from_numpy(part).to(device).reshape(-1, 3)[at] for part in (loaded.color, loaded.clipped)
    )
    return _TrainingView(photo, gbuffer.select(rows), color, clipped)
