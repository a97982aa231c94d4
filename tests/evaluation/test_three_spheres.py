"""The protocol against slow, obvious integrals, and stored numbers of one marked map."""

import math

import numpy as np
import pytest
import torch

from lightprobe.evaluation import three_spheres as protocol
from lightprobe.evaluation.three_spheres import (
    SPHERES,
    ThreeSpheres,
    angular_error,
    balanced,
    n_rmse,
    reduced,
    si_rmse,
    sphere_scores,
)
from lightprobe.light import equirect

VIEW, UP = torch.tensor([0.6, -0.7, 0.4]), torch.tensor([0.0, 0.0, 1.0])


def marked_map(height: int = 128) -> torch.Tensor:
    """A sky over brown ground with a warm sun of some degrees and a blue window."""
    d = equirect.directions(height)
    sky = 0.4 + 0.3 * d[..., 2:] * torch.tensor([0.6, 0.8, 1.0])
    ground = torch.tensor([0.15, 0.1, 0.07]).expand_as(d)
    light = torch.where(d[..., 2:] > 0, sky, ground)
    for axis, sharp, color in (((0.5, 0.6, 0.6), 300.0, (90.0, 70.0, 40.0)), ((-1.0, -0.2, 0.1), 40.0, (0.5, 1, 3))):
        towards = torch.nn.functional.normalize(torch.tensor(axis), dim=0)
        light = light + torch.exp(sharp * (d @ towards - 1))[..., None] * torch.tensor(color)
    return light


@pytest.fixture(scope="module")
def spheres():
    return ThreeSpheres(VIEW, UP)


def test_half_the_positive_values_of_a_tone_mapped_map_lie_below_a_half():
    light = marked_map(32)
    light[:5] = 0
    bent = balanced(light)
    assert float(bent[light > 0].median()) == pytest.approx(0.5, rel=1e-4)
    assert float(bent.max()) > 1  # nothing is cut off
    assert torch.equal(bent == 0, light == 0)
    torch.testing.assert_close(balanced(7.3 * light), bent, rtol=1e-4, atol=1e-5)


def test_rough_spheres_against_plain_sums(spheres):
    """One pixel of each, summed in float64 over all texels of the 32 x 64 map."""
    light = marked_map(32)
    discs = spheres.light(light)
    bent, d = balanced(light).double().reshape(-1, 3).numpy(), equirect.directions(32).double().reshape(-1, 3).numpy()
    solid = equirect.solid_angles(32).double().reshape(-1).numpy()
    view = VIEW.double().numpy() / np.linalg.norm(VIEW.double().numpy())
    for pixel in (3, 200, 501, 780):
        n = spheres.normals[pixel].double().numpy()
        cosine = np.maximum(d @ n, 0)
        half = d + view
        half /= np.maximum(np.linalg.norm(half, axis=1, keepdims=True), 1e-9)
        alpha2 = 0.369**4
        ggx = alpha2 / (math.pi * ((half @ n) ** 2 * (alpha2 - 1) + 1) ** 2)
        matte = (solid * ggx * cosine) @ bent / (solid * ggx * cosine).sum()
        assert discs["diffuse"].values[pixel].numpy() == pytest.approx((solid * cosine) @ bent / math.pi, rel=1e-4)
        assert discs["matte"].values[pixel].numpy() == pytest.approx(matte, rel=1e-3)


def test_the_mirror_sees_all_directions_alike(spheres):
    """A raster of the mirror's disc, fine enough, has the statistics that the texels have by solid angle."""
    light = marked_map()
    other = light.flip(1)
    exact = sphere_scores(spheres.light(other), spheres.light(light))["mirror_si_rmse"]
    local, _ = protocol._disc_normals(600)
    normals = (local @ spheres.frame).float()
    mirrored = 2 * (normals @ spheres.view)[:, None] * normals - spheres.view
    seen = [equirect.sample(balanced(m), mirrored).double() for m in (other, light)]
    even = torch.full((len(local),), 1 / len(local), dtype=torch.float64)
    assert si_rmse(*seen, even) == pytest.approx(exact, rel=0.02)


def test_spheres_turn_with_the_camera():
    """A light from the camera's right brightens the right half of the picture."""
    towards = torch.linalg.cross(UP, VIEW)
    light = 0.1 + torch.exp(8 * (equirect.directions(64) @ (towards / towards.norm()) - 1))[..., None].expand(-1, -1, 3)
    picture = ThreeSpheres(VIEW, UP).picture(light, 64)
    assert picture.shape == (64, 192, 3)
    for ball in picture.split(64, 1):
        assert float(ball[:, 36:].mean()) > 1.2 * float(ball[:, :28].mean())
    high = 0.1 + torch.exp(8 * (equirect.directions(64)[..., 2:] - 1)).expand(-1, -1, 3)
    above, below = ThreeSpheres(VIEW, UP).picture(high, 64).split(32)
    assert float(above.mean()) > 1.2 * float(below.mean())


def test_errors_by_hand():
    even = torch.tensor([0.5, 0.5], dtype=torch.float64)
    true = torch.tensor([[1.0, 0, 0], [0, 2.0, 0]], dtype=torch.float64)
    assert si_rmse(3 * true, true, even) == pytest.approx(0, abs=1e-9)
    grey = torch.ones(2, 3, dtype=torch.float64)  # best factor (1 + 2) / 6 = 1/2: errors .75 and 2.75, summed over RGB
    assert si_rmse(grey, true, even) == pytest.approx(math.sqrt((0.75 + 2.75) / 2))
    assert angular_error(grey, true, even) == pytest.approx(math.degrees(math.acos(1 / math.sqrt(3))))
    assert math.isnan(angular_error(torch.zeros_like(true), true, even))  # black has no hue
    assert n_rmse(5 * true + 1, true, even) == pytest.approx(0, abs=1e-9)
    assert n_rmse(1 - true, true, even) > 0.5


def test_a_map_has_no_error_against_itself_at_any_brightness(spheres):
    light = marked_map()
    scores = sphere_scores(spheres.light(4 * light), spheres.light(light))
    assert all(value < 1e-3 for value in scores.values()), scores
    assert {name.split("_")[0] for name in scores} == set(SPHERES)


def test_reduction_keeps_the_light_and_takes_any_size():
    light = marked_map(96)
    for height in (32, 24, 20):
        small = reduced(light, height)
        assert small.shape == (height, 2 * height, 3)
        whole = (light * equirect.solid_angles(96)[..., None]).sum((0, 1))
        kept = (small * equirect.solid_angles(height)[..., None]).sum((0, 1))
        torch.testing.assert_close(kept, whole, rtol=0.02, atol=0)
    assert reduced(light, 128) is light


@pytest.mark.golden
def test_stored_numbers(spheres):
    """A constant map and coarser versions of the truth against a marked map."""
    light = marked_map()
    true = spheres.light(light)

    def errors(map):
        scores = sphere_scores(spheres.light(map), true)
        return [round(scores[f"{name}_{error}"], 4) for error in ("si_rmse", "angular", "n_rmse") for name in SPHERES]

    def coarse(height):
        return reduced(light, height).repeat_interleave(128 // height, 0).repeat_interleave(128 // height, 1)

    assert errors(torch.ones(128, 256, 3)) == pytest.approx(GOLDEN["constant"], abs=2e-3)
    assert errors(coarse(4)) == pytest.approx(GOLDEN["4 x 8"], abs=2e-3)
    assert errors(coarse(16)) == pytest.approx(GOLDEN["16 x 32"], abs=2e-3)


GOLDEN = {
    "constant": [0.1375, 0.2557, 0.3726, 1.6045, 3.6429, 4.4487, 1.0886, 0.4923, 0.1706],
    "4 x 8": [0.024, 0.1208, 0.2829, 0.4748, 1.0188, 1.2758, 0.0791, 0.1641, 0.3926],
    "16 x 32": [0.0044, 0.0146, 0.1269, 0.0711, 0.0872, 0.2164, 0.0121, 0.026, 0.043],
}
