"""Views of random solids, and lessons from them under generated lights; the same for the same number."""

import math
from collections.abc import Iterator

import numpy as np
import torch
from torch import Tensor
from torch.nn.functional import normalize

from lightprobe.core.config.distillation import DistillConfig
from lightprobe.core.device import draw_rows, generator
from lightprobe.distillation.draw import Draw
from lightprobe.distillation.examples import ExampleMaker, TrainingExample
from lightprobe.distillation.generated_lights import generated_light
from lightprobe.distillation.synthetic import rerender
from lightprobe.evaluation.relighting import look_at
from lightprobe.geometry.mesh import vertex_normals
from lightprobe.models.probe_maps import RESOLUTION
from lightprobe.render.gbuffer import GBuffer
from lightprobe.render.surface import View, face_camera, visible_surface
from lightprobe.render.visibility import PointVisibility, vertex_visibility
from lightprobe.scene.camera import Camera
from lightprobe.scene.photo import CLIPPED
from pretraining.solids import random_solid

SIDE = 128  # pixels of a view
VIEWS, LIGHTS = 8, 6  # of a solid, of a view
PIXELS = 2048  # of a view that lessons keep
_FEWEST_PIXELS = 600
_DEPTH_MAP = 256
_UP = torch.tensor([0.0, 0.0, 1.0])
_UP_ERROR = 0.12  # cameras tell only about where up is


class Paint:
    """One to four materials in blotches, with a common texture."""

    def __init__(self, draw: Draw):
        self._kinds = [_material(draw) for _ in range(draw.count(1, 4))]
        self._seed = draw.count(0, 10**6)
        self._blotches, self._texture, self._bumps = draw.scale(1, 8), draw.scale(3, 25), draw.scale(5, 40)
        self._contrast = draw.uniform(0, 0.5) if draw.uniform(0, 1) < 0.6 else 0.0
        self._wear, self._height = draw.uniform(0, 0.15), draw.uniform(0, 0.15)

    def at(self, points: Tensor) -> tuple[Tensor, Tensor, Tensor, Tensor]:
        """Return base colour (P, 3), roughness (P,), metallic (P,) and normal offset (P, 3) at points (P, 3)."""
        draw = Draw(generator(self._seed, "paint"))
        kind = torch.stack([draw.noise(points, self._blotches) for _ in self._kinds], 1).argmax(1)
        color, roughness, metallic = (torch.stack(part)[kind] for part in zip(*self._kinds, strict=True))
        texture, wear = draw.noise(points, self._texture), draw.noise(points, self._texture)
        color = (color * torch.exp(self._contrast * texture)[:, None]).clamp(0.01, 0.95)
        bumps = torch.stack([draw.noise(points, self._bumps) for _ in range(3)], 1)
        return color, (roughness + self._wear * wear).clamp(0.08, 1), metallic, self._height * bumps


def _material(draw: Draw) -> tuple[Tensor, Tensor, Tensor]:
    if draw.uniform(0, 1) < 0.25:
        return draw.paint(0.25, 0.9, 0.25), torch.tensor(draw.uniform(0.1, 0.7)), torch.tensor(1.0)
    return draw.paint(0.04, 0.8, 0.35), torch.tensor(draw.uniform(0.15, 0.95)), torch.tensor(0.0)


def views(number: int, seed: int) -> Iterator[GBuffer]:
    """Yield the views of solid `number` in which it is large enough to tell something."""
    draw = Draw(generator(seed, "solid", number))
    vertices, faces = random_solid(draw)
    paint = Paint(draw)
    middles = vertices[faces.long()].mean(1)
    around = vertex_visibility(vertices, faces, paint.at(middles)[0].contiguous(), _DEPTH_MAP)
    normals = vertex_normals(vertices, faces)
    for _ in range(VIEWS):
        view = View.of(_camera(draw), vertices.device)
        seen = visible_surface(vertices, faces, view)
        if len(seen.pixel) < _FEWEST_PIXELS:
            continue
        color, roughness, metallic, bumps = paint.at(seen.position)
        normal = normalize(normalize(seen.interpolate(normals, faces), dim=1) + bumps, dim=1)
        around_seen = PointVisibility.of(around, faces, seen.face, seen.barycentric)
        surface = (
            view.height,
            view.width,
            seen.pixel,
            seen.face,
            seen.position,
            face_camera(normal, seen.view),
        )
        yield GBuffer(*surface, seen.view, color, roughness, metallic, around_seen)


@torch.no_grad()
def lessons_of(number: int, config: DistillConfig, seed: int) -> list[TrainingExample]:
    """Return the lessons of all views of solid `number`, each under lights of its own."""
    lessons = []
    error = Draw(generator(seed, "up", number)).normal(3)
    up = normalize(_UP + _UP_ERROR * error, dim=0)
    for k, gbuffer in enumerate(views(number, seed)):
        every = torch.arange(len(gbuffer.pixel))
        gbuffer = gbuffer.select(draw_rows(every, PIXELS, generator(seed, f"pixels/{number}", k)))
        desk = ExampleMaker(gbuffer, up, config)
        for light_number in range((number * VIEWS + k) * LIGHTS, (number * VIEWS + k + 1) * LIGHTS):
            light = generated_light(RESOLUTION, seed=seed, step=light_number)
            color, exposure = rerender(gbuffer, light, Draw(generator(seed, "rerender", light_number)))
            lessons.append(
                desk.example(
                    f"solid {number}, light {light_number}", color, color >= CLIPPED, light, exposure
                )
            )
    return lessons


def _camera(draw: Draw) -> Camera:
    """Return a camera that has the unit sphere in view, mostly from above."""
    back = draw.towards(-15, 75)
    up = _UP + 0.1 * draw.normal(3)
    distance = draw.scale(2.2, 6)
    pose = look_at((distance * back).numpy(), np.zeros(3), up.numpy())
    focal = SIDE / 2 * math.sqrt(distance**2 - 1) * draw.uniform(0.8, 1.0)
    return Camera(pose, focal, focal, SIDE / 2, SIDE / 2, SIDE, SIDE)
