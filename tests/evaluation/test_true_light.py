import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from lightprobe.evaluation.true_light import BINS, ConfidenceBins, StandIn, TrueLight, falls
from lightprobe.imaging import write_exr
from lightprobe.light import cubemap, equirect, prefilter
from lightprobe.light.environment import Environment
from lightprobe.prediction import Prediction
from lightprobe.render.asset import rasterize_asset
from lightprobe.render.gbuffer import GBuffer
from lightprobe.render.split_sum import shade
from lightprobe.scene.photo import Photo, Scene
from tests.known_scene import SIMILARITY, known_decomposition
from tests.lit_sphere import CPU, glossy_sphere, patch_light
from tests.shapes import camera_at

CAMERA = camera_at((2.0, 3.0, 1.0), size=20, focal=20)


@pytest.fixture(scope="module")
def true_light(tmp_path_factory):
    path = tmp_path_factory.mktemp("light") / "sky.exr"
    d = equirect.directions(64)
    glow = torch.exp(12 * (d @ torch.tensor([0.6, 0.0, 0.8]) - 1))[..., None] * torch.tensor([8.0, 6.0, 3.0])
    write_exr(path, (0.2 + 0.1 * d[..., 2:] + glow).numpy())
    return TrueLight.load(path, CAMERA, np.zeros(3), 16, CPU)


def guess(environment: torch.Tensor, confidence: torch.Tensor | None = None) -> Prediction:
    trust = torch.full((6, 16, 16), 0.5) if confidence is None else confidence
    return Prediction(Environment(environment), trust, {}, 1.0)


def test_the_truth_has_hardly_an_error_and_a_factor_only_a_raw_one(true_light):
    scores = true_light.scores(guess(true_light.environment.texels))
    assert scores["light_log_rmse"] == pytest.approx(0, abs=1e-6)
    assert scores["diffuse_si_rmse"] < 0.005
    assert scores["mirror_si_rmse"] < 0.08  # 6 x 16 x 16 texels for 64 x 128
    doubled = true_light.scores(guess(2 * true_light.environment.texels))
    assert doubled["light_log_rmse"] == pytest.approx(math.log(2), rel=0.03)
    assert doubled["light_log_rmse_scaled"] < 0.03
    assert doubled["mirror_si_rmse"] == pytest.approx(scores["mirror_si_rmse"], rel=1e-3)


def test_a_mirrored_map_is_found_out_by_every_sphere(true_light):
    """Cubemap and equirectangular conventions meet here: left for right must cost."""
    d = cubemap.directions(16) * torch.tensor([-1.0, 1.0, 1.0])
    wrong = cubemap.bilinear_taps(d.reshape(-1, 3), 16)
    taps = true_light.environment.texels.reshape(-1, 3)[wrong[0].long()] * wrong[1][..., None]
    mirrored = taps.sum(1).reshape(6, 16, 16, 3)
    right, other = (true_light.scores(guess(light)) for light in (true_light.environment.texels, mirrored))
    for sphere in ("diffuse", "matte", "mirror"):
        assert other[f"{sphere}_si_rmse"] > 5 * right[f"{sphere}_si_rmse"]


def test_bins_are_means_by_solid_angle_of_texels_in_the_order_of_confidence() -> None:
    """Six texels of a sixth of the sphere: by their middles, the third and fourth share the middle bin of
    five.
    """
    true = torch.tensor([[2.0, 1.0, 0.5]]).expand(6, 3).reshape(6, 1, 1, 3).contiguous()
    floor = 0.01 * 3.5 / 3
    errors = torch.tensor(
        [[0.6, -0.2, 0.1], [-1.0, 0.4, 0.3], [0.2, 0.2, 0.5], [0, 0, -0.3], [0.8, 0, 0], [0.1, 0, 0]]
    )
    light = (true.reshape(6, 3) + floor) * torch.exp(errors) - floor
    confidence = torch.tensor([0.5, 0.1, 0.9, 0.3, 0.2, 0.4])
    bins = ConfidenceBins()
    bins.add(guess(light.reshape(6, 1, 1, 3), confidence.reshape(6, 1, 1)), Environment(true))
    scaled = errors - errors.mean()
    members = ([1], [4], [3, 5], [0], [2])
    for found, texels in zip(bins.result(), members, strict=True):
        assert found["confidence"] == pytest.approx(float(confidence[texels].mean()))
        assert found["log_rmse"] == pytest.approx(float(errors[texels].square().mean().sqrt()), rel=1e-4)
        assert found["log_rmse_scaled"] == pytest.approx(
            float(scaled[texels].square().mean().sqrt()), rel=1e-4
        )


def test_bins_gather_photos_and_weigh_texels_by_solid_angle() -> None:
    """Two maps of 6 x 4 texels; confidence and error are told apart by the corners, which are smaller."""
    true, solid = torch.ones(6, 4, 4, 3), cubemap.solid_angles(4)
    corner = (solid < solid.mean()).float()
    light = torch.exp(corner)[..., None] * (true + 0.01) - 0.01
    bins = ConfidenceBins()
    for trust in (0.2, 0.4):
        bins.add(guess(light, torch.full((6, 4, 4), trust)), Environment(true))
    found = bins.result()
    share = float((solid * corner).sum() / solid.sum())
    whole = sum(b["log_rmse"] ** 2 for b in found) / BINS  # the bins are about equally large
    assert whole == pytest.approx(share, rel=0.03)
    assert abs(share - float(corner.mean())) > 0.05
    assert found[0]["confidence"] == pytest.approx(0.2)
    assert found[2]["confidence"] == pytest.approx(0.3, abs=0.02)
    assert found[4]["confidence"] == pytest.approx(0.4)


def test_an_error_that_stays_or_rises_somewhere_does_not_fall() -> None:
    def bins(*errors: float) -> list[dict[str, float]]:
        return [{"log_rmse_scaled": error, "log_rmse": -error} for error in errors]

    assert falls(bins(0.5, 0.4, 0.1))
    assert not falls(bins(0.5, 0.4, 0.4))
    assert not falls(bins(0.5, 0.6, 0.1))
    assert not falls(bins(0.5, 0.4, 0.1), "log_rmse")


def test_spheres_are_seen_from_the_camera_and_stand_upright_in_the_photo(tmp_path: Path) -> None:
    """The middle of the object is not the origin; maps are read with their first three channels and made
    smaller.
    """
    image = np.random.default_rng(5).random((200, 400, 4)).astype(np.float32) + 0.1
    write_exr(tmp_path / "sky.exr", image)
    center = np.array([1.0, -2.0, 0.5])
    light = TrueLight.load(tmp_path / "sky.exr", CAMERA, center, 8, CPU)
    assert light.environment.resolution == 8
    assert light.environment.mean().tolist() == pytest.approx([0.6, 0.6, 0.6], abs=0.02)
    assert light.height == 128
    towards = (CAMERA.position - center) / np.linalg.norm(CAMERA.position - center)
    assert light.spheres.view.numpy() == pytest.approx(towards, abs=1e-6)
    up = CAMERA.camera_to_world[:3, 1]
    upright = up - (up @ towards) * towards
    assert light.spheres.frame[1].numpy() == pytest.approx(upright / np.linalg.norm(upright), abs=1e-6)
    assert light.discs.keys() == {"diffuse", "matte", "mirror"}
    assert len(light.discs["mirror"].values) == 128 * 256
    write_exr(tmp_path / "small.exr", image[:32, :64, :3])
    assert TrueLight.load(tmp_path / "small.exr", CAMERA, center, 16, CPU).height == 32


def test_errors_of_a_light_are_of_the_texels_that_their_names_say(true_light: TrueLight) -> None:
    """One face of six is too bright by e^.9 in red and by e^.3 in blue, and confidence is 1/2 there, 1/4
    elsewhere.
    """
    true = true_light.environment.texels
    floor = 0.01 * float((cubemap.solid_angles(16)[..., None] * true).sum() / (12 * math.pi))
    errors = torch.zeros(6, 16, 16, 3)
    errors[1] = torch.tensor([0.9, 0.0, 0.3])
    trust = torch.full((6, 16, 16), 0.25)
    trust[1] = 0.5
    scores = true_light.scores(guess((true + floor) * torch.exp(errors) - floor, trust))
    square = (0.81 + 0.09) / 3  # on the face; the mean over all is .2 / 3 = .0667
    assert scores["light_log_rmse"] == pytest.approx(math.sqrt(square / 6), rel=1e-3)
    assert scores["light_log_rmse_confident"] == pytest.approx(math.sqrt(square * 2 / 7), rel=1e-3)
    assert scores["light_log_rmse_scaled"] == pytest.approx(math.sqrt(square / 6 - (0.4 / 6) ** 2), rel=1e-3)
    channels = square / 6 - (0.15**2 + 0.05**2) / 3
    assert scores["light_log_rmse_channels"] == pytest.approx(math.sqrt(channels), rel=1e-3)
    assert scores["light_log_rmse_bright"] == pytest.approx(0, abs=1e-5)  # the lamp is elsewhere
    assert scores["light_log_rmse_bright_scaled"] == pytest.approx(0.4 / 6, rel=1e-3)


@pytest.fixture(scope="module")
def stand_in():
    asset = glossy_sphere()
    places = {"a": (3.0, 0, 0.5), "b": (0, 3.0, 0.5)}
    cameras = {name: camera_at(place, size=32, focal=40) for name, place in places.items()}
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
