import itertools
import math

import pytest
import torch

from lightprobe.core.errors import ConfigError
from lightprobe.light import cubemap
from lightprobe.light.prefilter import DRAFT, ROUGHNESSES, Prefilter, PrefilterPart, cached, plan_levels

R = 8


def random_light(seed: int = 0) -> torch.Tensor:
    return torch.rand(6, R, R, 3, generator=torch.Generator().manual_seed(seed))


def some_normals(count: int) -> torch.Tensor:
    points = torch.randn(count, 3, generator=torch.Generator().manual_seed(4))
    return torch.nn.functional.normalize(points, dim=1)


def level_lookup(levels, taps):
    index, weight = taps
    return (levels[index.long()] * weight[..., None]).sum(1)


def test_a_constant_light_stays_constant():
    levels = cached(R).apply(torch.full((6, R, R, 3), 0.7))
    assert (levels - 0.7).abs().max() < 1e-5


def test_adjoint_is_the_transpose():
    operator = cached(R)
    light = random_light().double().float()
    levels = operator.apply(light)
    other = torch.rand(levels.shape, generator=torch.Generator().manual_seed(1))
    left, right = (levels * other).double().sum(), (light * operator.adjoint(other)).double().sum()
    assert float(left) == pytest.approx(float(right), rel=1e-5)


def test_a_draft_holds_fewer_entries_and_says_nearly_the_same():
    exact, draft = cached(32), cached(32, accuracy=DRAFT)
    light = torch.rand(6, 32, 32, 3, generator=torch.Generator().manual_seed(0)) ** 4
    assert len(draft.lobes.forward.value) < 0.7 * len(exact.lobes.forward.value)
    error = (draft.apply(light) - exact.apply(light)).abs()[exact.levels[3].offset : exact.first_block]
    assert 0 < float(error.mean()) < 0.02 * float(light.mean())
    assert cached(32, accuracy=DRAFT) is draft
    assert cached(32) is exact


def test_the_dense_levels_are_the_operator():
    operator, light = cached(R), random_light()
    levels = (operator.dense_levels @ light.reshape(-1, 3)).contiguous()
    assert torch.allclose(levels, operator.apply(light)[: operator.first_block], atol=1e-6)


def test_diffuse_level_is_the_cosine_integral():
    """Irradiance / pi against a sum over the light's own texels, in directions off every grid."""
    light = random_light(3)
    normals = some_normals(50)
    cosine = (cubemap.directions(R).reshape(1, -1, 3) * normals[:, None]).sum(-1).clamp(min=0)
    weight = cosine * cubemap.solid_angles(R).reshape(1, -1) / math.pi
    operator = cached(R)
    looked_up = level_lookup(operator.apply(light), operator.diffuse_taps(normals))
    assert (looked_up - weight @ light.reshape(-1, 3)).abs().max() < 0.01


@pytest.mark.parametrize("roughness", [0.2, 0.35, 0.5, 0.8])
def test_specular_level_is_the_lobe_average(roughness):
    """Against the definition: the mean of the light under D(h) n.l with v = n, by direct summation."""
    smooth = cubemap.directions(32)
    fine = torch.stack([1 + smooth[..., 0], 1 + smooth[..., 1] * smooth[..., 2], 1 + smooth[..., 2]], -1)
    operator = cached(32)
    normals = some_normals(40)
    cosine = (smooth.reshape(1, -1, 3) * normals[:, None]).sum(-1)
    half = ((1 + cosine) / 2).clamp(0, 1)
    angle = cubemap.solid_angles(32).reshape(1, -1)
    lobe = cosine.clamp(min=0) / (half * (roughness**4 - 1) + 1) ** 2 * angle
    expected = lobe @ fine.reshape(-1, 3) / lobe.sum(1, keepdim=True)
    taps = operator.specular_taps(normals, torch.full((40,), roughness))
    assert (level_lookup(operator.apply(fine), taps) - expected).abs().max() < 0.03


SIZES = {  # of the levels, by the light's resolution: 1.8 texels in half a lobe's width, but 16 or R
    4: [4, 4, 4, 4, 4, 16, 16],  # without the narrow lobes between the first and .305
    8: [8, 8, 8, 8, 8, 8, 16, 16],
    32: [32, 32, 32, 32, 32, 16, 16, 16, 16, 16, 16],
    256: [256, 128, 64, 64, 32, 16, 16, 16, 16, 16, 16],
}


@pytest.mark.parametrize(("resolution", "sizes"), SIZES.items())
def test_levels_are_as_fine_as_their_lobe_and_lie_one_after_the_other(
    resolution: int, sizes: list[int]
) -> None:
    levels, rows = plan_levels(resolution), 0
    assert [level.resolution for level in levels] == sizes
    assert [level.roughness for level in levels] == [0.08, *ROUGHNESSES[1 - len(sizes) :]]
    for level in levels:
        assert level.offset == rows
        rows += 6 * level.resolution**2


@pytest.mark.parametrize("resolution", [0, 1, 2, 3, 6, 12, 33])
def test_a_resolution_that_is_no_power_of_two_from_four_is_refused(resolution: int) -> None:
    with pytest.raises(ConfigError, match=f"must be a power of two from 4, not {resolution}"):
        Prefilter(resolution)


@pytest.mark.parametrize("shape", [(6, 8, 8, 4), (6, 4, 4, 3), (384, 3)])
def test_a_light_of_another_shape_is_refused(shape: tuple[int, ...]) -> None:
    operator, rows = cached(R), torch.tensor([3])
    for apply in (operator.apply, PrefilterPart(operator, rows).apply):
        with pytest.raises(ConfigError) as caught:
            apply(torch.zeros(shape))
        assert str(caught.value) == f"This prefilter takes cubemaps (6, 8, 8, 3), not {shape}."


@pytest.mark.parametrize("resolution", [4, 8, 16])
def test_blocks_are_the_light_averaged_by_solid_angle_over_an_eighth_of_an_edge(resolution: int) -> None:
    light = torch.rand(6, resolution, resolution, 3, generator=torch.Generator().manual_seed(resolution))
    blocks = cached(resolution).apply(light)[-384:].reshape(6, 8, 8, 3)
    fine = light.repeat_interleave(16 // resolution, 1).repeat_interleave(16 // resolution, 2)
    weighted = fine * cubemap.solid_angles(16)[..., None]
    parts = weighted, cubemap.solid_angles(16)[..., None]
    expected, share = (part.reshape(6, 8, 2, 8, 2, -1).sum((2, 4)) for part in parts)
    torch.testing.assert_close(blocks, expected / share)


def shares(roughness: float, scale: float = 1.0) -> dict[float, float]:
    """Return the summed weights by the roughness of their level."""
    operator = cached(R)
    index, weight = operator.specular_taps(torch.tensor([[0.3, -0.8, 0.1]]), torch.tensor([roughness]), scale)
    assert index.shape == weight.shape == (1, 8)
    ends = [*(level.offset for level in operator.levels), operator.first_block]
    sums = [float(weight[(index >= first) & (index < end)].sum()) for first, end in itertools.pairwise(ends)]
    pairs = zip(operator.levels, sums, strict=True)
    return {level.roughness: total for level, total in pairs if abs(total) > 1e-6}


@pytest.mark.parametrize(
    ("roughness", "expected"),
    [
        (0.0, {0.08: 1}),
        (0.08, {0.08: 1}),
        (1.4, {1.4: 1}),
        (3.0, {1.4: 1}),
        (0.305, {0.305: 1}),
        (1.0, {1.0: 1}),
        ((0.75 / 0.5**2 + 0.25 / 0.67**2) ** -0.5, {0.5: 0.75, 0.67: 0.25}),
        ((0.1 / 0.08**2 + 0.9 / 0.24**2) ** -0.5, {0.08: 0.1, 0.24: 0.9}),
        ((0.6 / 1.0**2 + 0.4 / 1.4**2) ** -0.5, {1.0: 0.6, 1.4: 0.4}),
    ],
)
def test_between_two_levels_the_lobe_is_linear_in_one_over_alpha(
    roughness: float, expected: dict[float, float]
) -> None:
    assert shares(roughness) == pytest.approx(expected, abs=1e-5)
    more = {level: 2.5 * part for level, part in expected.items()}
    assert shares(roughness, 2.5) == pytest.approx(more, abs=1e-5)


def test_taps_of_a_level_are_those_of_its_own_cubemap() -> None:
    operator, direction = cached(R), torch.tensor([[0.3, -0.8, 0.1], [-1.0, 0.99, 1.0]])
    for level in operator.levels:
        expected, weight = cubemap.bilinear_taps(direction, level.resolution)
        for index, found in (
            operator.specular_taps(direction, torch.full((2,), level.roughness)),
            *([operator.diffuse_taps(direction)] if level.roughness == 1 else []),
        ):
            dense = torch.zeros(2, operator.total).scatter_add_(1, index.long(), found)
            truth = torch.zeros(2, operator.total).scatter_add_(1, expected.long() + level.offset, weight)
            torch.testing.assert_close(dense, truth, atol=2e-5, rtol=0)


def test_a_part_of_the_levels_is_those_rows_and_all_blocks() -> None:
    operator, rows = cached(R), torch.tensor([2400, 7, 500])
    part, light = PrefilterPart(operator, rows), random_light(6)
    assert part.first_block == 3
    whole = operator.apply(light)
    expected = torch.cat([whole[rows], whole[operator.first_block :]])
    torch.testing.assert_close(part.apply(light.requires_grad_()), expected)
    other = torch.rand(3 + 384, 3, generator=torch.Generator().manual_seed(7))
    padded = torch.zeros(operator.total, 3)
    padded[rows], padded[operator.first_block :] = other[:3], other[3:]
    torch.testing.assert_close(part.adjoint(other), operator.adjoint(padded))
