import math
from dataclasses import replace
from pathlib import Path

import pytest
import torch

from lightprobe.evaluation.stand_in import StandIn
from lightprobe.light import prefilter
from lightprobe.light.environment import Environment
from lightprobe.render.asset import rasterize_asset
from lightprobe.render.gbuffer import GBuffer
from lightprobe.render.split_sum import shade
from lightprobe.scene.photo import Photo, Scene
from tests.known_scene import SIMILARITY, known_decomposition
from tests.lit_sphere import CPU, glossy_sphere, patch_light
from tests.shapes import camera_at


@pytest.fixture(scope="module")
def stand_in():
    asset = glossy_sphere()
    cameras = {
        "a": camera_at((3.0, 0, 0.5), size=32, focal=40),
        "b": camera_at((0, 3.0, 0.5), size=32, focal=40),
    }
    return StandIn({name: rasterize_asset(asset, camera, CPU) for name, camera in cameras.items()})


LIGHT = Environment(patch_light((1.0, 1.0, 0.5), brightness=2.0))


def test_the_true_light_relights_perfectly_and_a_factor_shows_only_unscaled(stand_in):
    assert stand_in.scores("c", LIGHT, LIGHT)["relit_psnr"] == 100
    tinted = stand_in.scores("c", LIGHT.scaled(torch.tensor([0.5, 0.7, 0.9])), LIGHT)
    assert tinted["relit_psnr"] < 25
    assert tinted["relit_psnr_scaled"] > 55


def test_a_light_elsewhere_is_worse_than_a_blurred_one(stand_in):
    elsewhere = stand_in.scores("c", Environment(patch_light((-1.0, -1.0, 0.5), brightness=2.0)), LIGHT)
    even = stand_in.scores(
        "c", Environment(LIGHT.texels.mean((0, 1, 2)).expand_as(LIGHT.texels).contiguous()), LIGHT
    )
    assert elsewhere["relit_psnr_scaled"] + 1 < even["relit_psnr_scaled"]


def test_the_photos_own_view_does_not_count(stand_in):
    """From where the lamp's side is not seen, losing the lamp costs less."""
    dark = Environment(LIGHT.texels.clamp(max=0.4))
    only_b, only_a = stand_in.scores("a", dark, LIGHT), stand_in.scores("b", dark, LIGHT)
    both = stand_in.scores("c", dark, LIGHT)
    assert only_a["relit_psnr"] != only_b["relit_psnr"]
    assert min(only_a["relit_psnr"], only_b["relit_psnr"]) <= both["relit_psnr"]
    assert StandIn({"a": stand_in.views["a"]}).scores("a", dark, LIGHT) == {}


def scene(folder: Path, sizes: list[tuple[int, int]]) -> Scene:
    """Return a scene of test photos around the object, in a frame with another origin and unit."""
    photos = []
    for k, (width, height) in enumerate(sizes):
        camera = camera_at((6 * math.cos(k), 6 * math.sin(k), 1.0), size=height, width=width, focal=width)
        pose = camera.camera_to_world.copy()
        pose[:3, 3] = SIMILARITY.invert(pose[:3, 3])
        photos.append(Photo(f"p{k}", replace(camera, camera_to_world=pose), folder / f"p{k}.png"))
    return Scene(folder, "transforms", (), tuple(photos), (), SIMILARITY)


@pytest.mark.parametrize(("count", "chosen"), [(3, [0, 1, 2]), (5, [0, 1, 2, 3, 4]), (12, [0, 2, 4, 7, 9])])
def test_five_of_the_test_cameras_at_most_are_taken_evenly(
    tmp_path: Path, count: int, chosen: list[int]
) -> None:
    known = known_decomposition()
    found = StandIn.of(known, scene(tmp_path, [(20, 20)] * count), CPU)
    assert list(found.views) == [f"p{k}" for k in chosen]


def test_pictures_are_reduced_to_128_pixels_and_never_enlarged(tmp_path: Path) -> None:
    sizes = [(256, 100), (60, 512), (128, 64), (30, 20)]
    views = StandIn.of(known_decomposition(), scene(tmp_path, sizes), CPU).views.values()
    assert [(view.width, view.height) for view in views] == [(128, 50), (15, 128), (128, 64), (30, 20)]
    for view in views:  # a unit ball at some six units, in the middle
        radius = view.width * math.tan(math.asin(1 / math.sqrt(37)))
        assert len(view.pixel) == pytest.approx(math.pi * radius**2, rel=0.05, abs=4)
        assert (view.pixel % view.width).float().mean() == pytest.approx(view.width / 2 - 0.5, abs=0.3)


def white_views(colors: list[tuple[float, float, float]]) -> dict[str, GBuffer]:
    """Return views of one pixel each, along the normal of a rough surface of these colours."""
    up = torch.tensor([[0.0, 0.0, 1.0]])
    zero = torch.zeros(1, dtype=torch.int64)
    return {
        f"p{k}": GBuffer(1, 1, zero, zero, up, up, up, torch.tensor([color]), torch.ones(1), torch.zeros(1))
        for k, color in enumerate(colors)
    }


def decibels(mine: list[float], true: list[float]) -> float:
    def srgb(x: float) -> float:
        return float(1.055 * min(x, 1.0) ** (1 / 2.4) - 0.055)

    return -10 * math.log10(
        sum((srgb(a) - srgb(b)) ** 2 for a, b in zip(mine, true, strict=True)) / len(mine)
    )


def test_displayed_values_of_the_other_views_are_compared_and_white_is_the_brightest() -> None:
    """Of an even light L a surface shows L times some colour c, which a light of 1/8 tells; red is above
    white.
    """
    found = StandIn(white_views([(0.2, 0.4, 0.1), (0.6, 0.1, 0.3), (0.9, 0.9, 0.9)]))
    even = Environment(torch.ones(6, 16, 16, 3))
    operator = prefilter.cached(16, CPU)
    parts = [shade(view, operator, operator.apply(even.texels))[0] for view in found.views.values()]
    true, factors = even.scaled(torch.tensor([8.0, 0.5, 0.5])), (0.5, 0.5, 1.5)
    mine = true.scaled(torch.tensor(factors))
    seen = [float(c * light) for part in parts[:2] for c, light in zip(part, (8.0, 0.5, 0.5), strict=True)]
    assert seen[0] > 1.5
    expected = decibels([factor * value for factor, value in zip(factors * 2, seen, strict=True)], seen)
    scores = found.scores("p2", mine, true)
    assert scores["relit_psnr"] == pytest.approx(expected, abs=0.01)
    assert scores["relit_psnr_scaled"] > 60
    assert scores.keys() == {"relit_psnr", "relit_psnr_scaled"}


def test_a_view_that_shows_nothing_of_the_object_does_not_count() -> None:
    views = white_views([(0.2, 0.4, 0.1), (0.6, 0.1, 0.3)])
    empty = views["p0"].select(torch.zeros(0, dtype=torch.int64))
    light = Environment(torch.ones(6, 16, 16, 3))
    assert StandIn({"p0": empty}).scores("a", light, light) == {}
    assert StandIn({"p0": empty, "p1": views["p1"]}).scores("a", light, light)["relit_psnr"] == 100
