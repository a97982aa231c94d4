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
    for axis, sharp, color in (
        ((0.5, 0.6, 0.6), 300.0, (90.0, 70.0, 40.0)),
        ((-1.0, -0.2, 0.1), 40.0, (0.5, 1, 3)),
    ):
        towards = torch.nn.functional.normalize(torch.tensor(axis), dim=0)
        light = light + torch.exp(sharp * (d @ towards - 1))[..., None] * torch.tensor(color)
    return light


@pytest.fixture(scope="module")
def spheres():
    return ThreeSpheres(VIEW, UP)


def test_rough_spheres_against_plain_sums(spheres):
    """One pixel of each, summed in float64 over all texels of the 32 x 64 map."""
    light = marked_map(32)
    discs = spheres.light(light)
    bent, d = (m.double().reshape(-1, 3).numpy() for m in (balanced(light), equirect.directions(32)))
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
        assert discs["diffuse"].values[pixel].numpy() == pytest.approx(
            (solid * cosine) @ bent / math.pi, rel=1e-4
        )
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


def test_a_map_has_no_error_against_itself_at_any_brightness(spheres):
    light = marked_map()
    scores = sphere_scores(spheres.light(4 * light), spheres.light(light))
    assert all(value < 1e-3 for value in scores.values()), scores
    assert {name.split("_")[0] for name in scores} == set(SPHERES)


@pytest.mark.golden
def test_stored_numbers(spheres):
    """A constant map and coarser versions of the truth against a marked map."""
    light = marked_map()
    true = spheres.light(light)

    def errors(map):
        scores = sphere_scores(spheres.light(map), true)
        kinds = ("si_rmse", "angular", "n_rmse")
        return [round(scores[f"{name}_{error}"], 4) for error in kinds for name in SPHERES]

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


def test_a_tone_mapped_map_is_bent_and_scaled_whatever_is_black_or_negative() -> None:
    values = torch.tensor([1.0, 2.0**2.4, 4.0**2.4, 0.0, -3.0, 0.0])
    assert balanced(values.reshape(1, 2, 3)).flatten().tolist() == pytest.approx([0.25, 0.5, 1, 0, 0, 0])
    assert torch.equal(balanced(torch.zeros(2, 4, 3)), torch.zeros(2, 4, 3))


def test_weighted_errors_by_hand() -> None:
    """Three pixels of a half, a quarter and a quarter."""
    weight = torch.tensor([0.5, 0.25, 0.25], dtype=torch.float64)
    values = torch.tensor([[0.2, 0, 0], [0, 0.4, 0], [0, 0, 0]], dtype=torch.float64)
    true = torch.tensor([[0.1, 0.1, 0], [0, 0.3, 0], [0, 0, 0.8]], dtype=torch.float64)
    scale = (0.5 * 0.02 + 0.25 * 0.12) / (0.5 * 0.04 + 0.25 * 0.16)
    squares = [(0.2 * scale - 0.1) ** 2 + 0.01, (0.4 * scale - 0.3) ** 2, 0.64]
    assert si_rmse(values, true, weight) == pytest.approx(
        math.sqrt(0.5 * squares[0] + 0.25 * squares[1] + 0.25 * squares[2])
    )
    assert si_rmse(0 * values, true, weight) == pytest.approx(
        math.sqrt(0.5 * 0.02 + 0.25 * 0.09 + 0.25 * 0.64)
    )
    assert angular_error(values, true, weight) == pytest.approx((0.5 * 45 + 0.25 * 0) / 0.75)
    assert angular_error(true, values, weight) == pytest.approx(30)
    assert math.isnan(angular_error(torch.zeros_like(true), true, weight))  # black has no hue
    low_to_high = torch.tensor([[1.0, 1, 1], [3, 3, 3], [2, 2, 2]], dtype=torch.float64)  # to 0, 1 and 1/2
    other = torch.tensor([[7.0, 7, 7], [5, 5, 5], [6.5, 6.5, 6.5]], dtype=torch.float64)  # to 1, 0 and 3/4
    assert n_rmse(low_to_high, other, weight) == pytest.approx(math.sqrt(3 * (0.5 + 0.25 + 0.25 / 16)))


def test_the_range_of_a_sphere_leaves_a_thousandth_out_at_both_ends() -> None:
    """Of 2550 values, 2.55 are a thousandth: the third from either end, with half of it counted, is 0 or 1."""
    rng = np.random.default_rng(3)
    numbers = rng.permutation(2550).astype(np.float64) ** 2
    values = torch.from_numpy(numbers.reshape(850, 3))
    even = torch.full((850,), 1 / 850, dtype=torch.float64)
    low, high = 2.0**2, 2547.0**2
    found = protocol._unit_range(values, even)
    torch.testing.assert_close(found, (values - low) / (high - low))
    rare = torch.where((values == values.max()).any(1), 1e-9, even)  # a pixel that hardly counts
    assert float(protocol._unit_range(values, rare).min()) == pytest.approx(-4 / (high - low), rel=1e-2)


@pytest.mark.parametrize(("contrast", "flat"), [(0.0, True), (0.0029, True), (0.0031, False), (0.004, False)])
def test_a_range_below_three_thousandths_of_the_brightness_is_none(contrast: float, flat: bool) -> None:
    for unit in (0.02, 1.0, 50.0):
        values = unit * torch.tensor([[1 - contrast] * 3, [1.0] * 3], dtype=torch.float64)
        found = protocol._unit_range(values, torch.tensor([0.5, 0.5], dtype=torch.float64))
        assert found.flatten().tolist() == pytest.approx([0, 0, 0, 0, 0, 0] if flat else [0, 0, 0, 1, 1, 1])


def test_a_map_is_reduced_by_solid_angle_and_left_alone_where_it_is_not_larger() -> None:
    light = torch.rand(4, 8, 3, generator=torch.Generator().manual_seed(2))
    small = reduced(light, 2)
    near, far = 1 - math.cos(math.pi / 4), math.cos(math.pi / 4)  # bands of rows 0 and 1
    block = light[:2, 4:6].mean(1)
    torch.testing.assert_close(small[0, 2], near * block[0] + far * block[1])
    torch.testing.assert_close(small[1, 0], far * light[2, :2].mean(0) + near * light[3, :2].mean(0))
    assert reduced(light, 4) is light
    assert reduced(light, 6) is light


@pytest.mark.parametrize(
    ("view", "up", "expected"),
    [
        ((0.0, -2.0, 0.0), (0.0, 0.0, 3.0), [[1, 0, 0], [0, 0, 1], [0, -1, 0]]),
        ((3.0, 0.0, 4.0), (0.0, 0.0, 1.0), [[0, 1, 0], [-0.8, 0, 0.6], [0.6, 0, 0.8]]),
        ((0.0, 0.0, 2.0), (0.0, 0.0, 1.0), None),
        ((-2.0, 0.0, 0.0), (1.0, 0.0, 0.0), None),
    ],
)
def test_the_frame_is_right_up_and_towards_the_camera(
    view: tuple[float, ...], up: tuple[float, ...], expected: list[list[float]] | None
) -> None:
    """Where the camera looks along the upward direction, any frame about its axis will do."""
    frame = protocol._frame(torch.tensor(view).double(), torch.tensor(up).double())
    torch.testing.assert_close(frame @ frame.T, torch.eye(3, dtype=torch.float64))
    assert float(torch.linalg.det(frame)) == pytest.approx(1)
    towards = torch.tensor(view).double()
    torch.testing.assert_close(frame[2], towards / towards.norm())
    if expected is not None:
        torch.testing.assert_close(frame, torch.tensor(expected, dtype=torch.float64))


@pytest.mark.parametrize("rows", [8, 32, 160])
def test_under_an_even_light_all_spheres_are_of_its_colour_and_all_else_is_black(
    rows: int, spheres: ThreeSpheres
) -> None:
    """Grey of any brightness becomes 1/2, twice as much green 2^(1/2.4) as much."""
    light = 7 * torch.tensor([1.0, 2.0, 1.0]).expand(rows, 2 * rows, 3)
    discs, color = spheres.light(light), torch.tensor([0.5, 0.5 * 2 ** (1 / 2.4), 0.5])
    for name in SPHERES:
        torch.testing.assert_close(discs[name].values, color.expand_as(discs[name].values), rtol=0.01, atol=0)
        assert float(discs[name].weight.sum()) == pytest.approx(1, abs=1e-4)
        assert len(discs[name].weight) == len(discs[name].values)
    assert discs["diffuse"].weight.tolist() == pytest.approx(
        [1 / len(spheres.normals)] * len(spheres.normals)
    )
    if rows == 8:
        picture = spheres.picture(light)
        _, inside = protocol._disc_normals(128)
        assert picture.shape == (128, 384, 3)
        for ball in picture.split(128, 1):
            torch.testing.assert_close(ball[inside], color.expand_as(ball[inside]), rtol=0.01, atol=0)
            assert float(ball[~inside].abs().max()) == 0


def test_a_lamp_is_seen_where_the_normal_halves_its_way_to_the_camera(spheres: ThreeSpheres) -> None:
    """In the mirror, sharp; in the matte sphere wider, and in the diffuse one facing the lamp."""
    view = VIEW / VIEW.norm()
    right = torch.linalg.cross(UP, view)
    right = right / right.norm()
    up = torch.linalg.cross(view, right)
    lamp = torch.nn.functional.normalize(0.8 * right + 0.5 * up + 0.3 * view, dim=0)
    light = 0.2 + 30 * torch.exp(60 * (equirect.directions(64) @ lamp - 1))[..., None].expand(-1, -1, 3)
    diffuse, matte, mirror = spheres.picture(light, 96).mean(-1).split(96, 1)
    half = (lamp + view) / (lamp + view).norm()
    for ball, normal, near in ((mirror, half, 2), (matte, half, 5), (diffuse, lamp, 8)):
        row, column = divmod(int(ball.argmax()), 96)
        assert column + 0.5 == pytest.approx(48 * (1 + float(normal @ right)), abs=near)
        assert row + 0.5 == pytest.approx(48 * (1 - float(normal @ up)), abs=near)
    assert float(mirror.max()) > 1.3 * float(matte.max()) > 1.3 * 1.05 * float(diffuse.max())
