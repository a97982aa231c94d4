import dataclasses
import math

import numpy as np
import pytest
import torch
from torch import Tensor

from lightprobe.core.config.rendering import RenderConfig, Renderer
from lightprobe.evaluation import relighting
from lightprobe.evaluation.relighting import Relighter, relight
from lightprobe.light.environment import Environment
from lightprobe.render.asset import Asset
from lightprobe.scene.camera import Camera
from tests.known_scene import CPU, SIMILARITY, known_decomposition
from tests.shapes import camera_at


def camera(width: int = 60, height: int = 40) -> Camera:
    """A camera of the user's frame, 9 units from the object's middle."""
    found = camera_at((6.0, 6.0, 3.0), size=height, width=width, focal=50)
    pose = found.camera_to_world.copy()
    pose[:3, 3] += SIMILARITY.center
    return dataclasses.replace(found, camera_to_world=pose)


def test_the_object_has_its_size_and_place_in_the_user_s_frame() -> None:
    """A ball of radius 2 at 9 units and a focal length of 50 pixels: its outline has the radius 50 tan(asin(2
    / 9)).
    """
    light = Environment(torch.full((6, 16, 16, 3), 0.5))
    image, cover = relight(known_decomposition(), light, camera())
    assert image.shape == (40, 60, 3)
    assert cover.shape == (40, 60)
    radius = 50 * math.tan(math.asin(2 / 9))
    assert float(cover.sum()) == pytest.approx(math.pi * radius**2, rel=0.02)
    rows, columns = np.mgrid[:40, :60] + 0.5
    assert float((cover * torch.from_numpy(columns)).sum() / cover.sum()) == pytest.approx(30, abs=0.1)
    assert float((cover * torch.from_numpy(rows)).sum() / cover.sum()) == pytest.approx(20, abs=0.1)
    assert float(image[cover == 0].abs().max()) == 0
    reddish = light.scaled(torch.tensor([3.0, 1.0, 1.0]))
    tinted, _ = Relighter(known_decomposition(), CPU).picture(reddish, camera())
    torch.testing.assert_close(tinted, image * torch.tensor([3.0, 1.0, 1.0]))


@pytest.mark.parametrize(("renderer", "rays"), [(Renderer.PATH, [77]), (Renderer.FAST, [])])
def test_the_configured_renderer_makes_the_picture(
    renderer: Renderer, rays: list[int], monkeypatch: pytest.MonkeyPatch
) -> None:
    asked, made = [], torch.full((40, 60), 0.125)

    class Traced:
        def __init__(self, asset: Asset, samples: int):
            asked.append(samples)

        def render(self, camera: Camera, light: Tensor) -> tuple[Tensor, Tensor]:
            assert camera.position == pytest.approx([3, 3, 1.5])  # of the normalised frame
            assert light.shape == (6, 16, 16, 3)
            return torch.zeros(40, 60, 3), made

    monkeypatch.setattr(relighting, "PathTracer", Traced)
    config = RenderConfig(renderer, samples=77)
    _, cover = relight(known_decomposition(), Environment(torch.ones(6, 16, 16, 3)), camera(), config)
    assert asked == rays
    assert (cover is made) == (renderer is Renderer.PATH)
