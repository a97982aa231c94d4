import pytest
import torch

from lightprobe.evaluation.stand_in import StandIn
from lightprobe.light.environment import Environment
from lightprobe.render.asset import rasterize_asset
from tests.lit_sphere import CPU, glossy_sphere, patch_light
from tests.shapes import camera_at


@pytest.fixture(scope="module")
def stand_in():
    asset = glossy_sphere()
    cameras = {"a": camera_at((3.0, 0, 0.5), size=32, focal=40), "b": camera_at((0, 3.0, 0.5), size=32, focal=40)}
    return StandIn({name: rasterize_asset(asset, camera, CPU) for name, camera in cameras.items()})


LIGHT = Environment(patch_light((1.0, 1.0, 0.5), brightness=2.0))


def test_the_true_light_relights_perfectly_and_a_factor_shows_only_unscaled(stand_in):
    assert stand_in.scores("c", LIGHT, LIGHT)["relit_psnr"] == 100
    tinted = stand_in.scores("c", LIGHT.scaled(torch.tensor([0.5, 0.7, 0.9])), LIGHT)
    assert tinted["relit_psnr"] < 25
    assert tinted["relit_psnr_scaled"] > 55


def test_a_light_elsewhere_is_worse_than_a_blurred_one(stand_in):
    elsewhere = stand_in.scores("c", Environment(patch_light((-1.0, -1.0, 0.5), brightness=2.0)), LIGHT)
    even = stand_in.scores("c", Environment(LIGHT.texels.mean((0, 1, 2)).expand_as(LIGHT.texels).contiguous()), LIGHT)
    assert elsewhere["relit_psnr_scaled"] + 1 < even["relit_psnr_scaled"]


def test_the_photos_own_view_does_not_count(stand_in):
    """From where the lamp's side is not seen, losing the lamp costs less."""
    dark = Environment(LIGHT.texels.clamp(max=0.4))
    only_b, only_a = stand_in.scores("a", dark, LIGHT), stand_in.scores("b", dark, LIGHT)
    both = stand_in.scores("c", dark, LIGHT)
    assert only_a["relit_psnr"] != only_b["relit_psnr"]
    assert min(only_a["relit_psnr"], only_b["relit_psnr"]) <= both["relit_psnr"]
    assert StandIn({"a": stand_in.views["a"]}).scores("a", dark, LIGHT) == {}
