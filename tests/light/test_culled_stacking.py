"""Culled stacking: within its bound of the exact sums for all kinds of lobes, with the same bits on any threads."""

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from lightprobe.kernels import dispatch, stack_probes
from lightprobe.kernels.culled_stacking import ERROR, NODES
from lightprobe.kernels.stacking import lobe_frames
from lightprobe.light import cubemap
from lightprobe.light.culled_stacking import stack_on_cubemap, tile_tree
from tests.stacking import pixels
from tests.threads import assert_same_bits


def exact(case, resolution):
    colors, *lobes = (x.double() for x in case)
    directions = cubemap.exact_directions(resolution).reshape(-1, 3)
    radiance, weight = stack_probes(colors, *lobes, directions)
    return radiance.reshape(6, resolution, resolution, 3), weight.reshape(6, resolution, resolution)


def errors(case, resolution):
    """Return the relative L2 errors of radiance and weight."""
    pairs = zip(stack_on_cubemap(*case, resolution), exact(case, resolution), strict=True)
    return [float((found.double() - true).norm() / true.norm()) for found, true in pairs]


@pytest.mark.slow
@settings(max_examples=20, deadline=None)
@given(
    st.lists(st.floats(0.08, 1), min_size=1, max_size=4),
    st.one_of(st.none(), st.floats(0, 1)),
    st.integers(0, 10_000),
    st.sampled_from([64, 128]),
)
def test_few_pixels_of_any_kind_stay_within_the_bound(roughness, tilt, seed, resolution):
    assert max(errors(pixels(torch.tensor(roughness), seed=seed, tilt=tilt), resolution)) < ERROR


@pytest.mark.slow
@pytest.mark.parametrize(
    "roughness",
    [torch.full((200,), 0.08), torch.full((200,), 1.0), torch.linspace(0.08, 1, 200), torch.full((40,), 0.3)],
    ids=["mirrors", "matte", "mixed", "glossy"],
)
def test_many_pixels_stay_within_the_bound(roughness):
    assert max(errors(pixels(roughness), 64)) < ERROR


def test_mirrors_that_face_corners_and_edges_and_texels_stay_within_the_bound():
    """Almost: a horizon that runs through texel centres leaves it to rounding whether they are seen."""
    normals = torch.tensor([[0.0, 0.0, 1.0], [1.0, 1.0, 1.01], [1.0, 1.0, 0.01], [1.0, 1 / 64, 1 / 64]])
    normals = torch.nn.functional.normalize(normals, dim=1)
    for roughness in (0.08, 0.4):
        case = torch.eye(3)[[0, 1, 2, 0]], normals, normals, torch.full((4,), roughness**4)
        assert max(errors(case, 64)) < ERROR


def test_unseen_directions_are_exactly_black():
    case = pixels(torch.full((1,), 0.5))
    radiance, weight = stack_on_cubemap(*case, 64)
    behind = cubemap.directions(64) @ case[1][0] < -1e-6
    assert not weight[behind].any()
    assert not radiance[behind].any()


def test_a_broken_normal_shows():
    colors, normals, views, alpha2 = pixels(torch.linspace(0.1, 1, 5))
    normals[2] = torch.nan
    assert stack_on_cubemap(colors, normals, views, alpha2, 64)[1].isnan().any()


@pytest.mark.parametrize("resolution", [8, 32, 48])
def test_small_and_odd_cubemaps_are_exact(resolution):
    assert max(errors(pixels(torch.linspace(0.1, 1, 20)), resolution)) < 1e-5


def test_no_pixels_see_nothing():
    radiance, weight = stack_on_cubemap(*pixels(torch.zeros(0)), 64)
    assert radiance.shape == (6, 64, 64, 3)
    assert not radiance.any()
    assert not weight.any()


def test_bits_do_not_depend_on_threads():
    case = pixels(torch.linspace(0.08, 1, 300))
    assert_same_bits(lambda: stack_on_cubemap(*case, 64))


def test_it_culls():
    """A bound that lets every tile through, or none, would hide behind the error; the work would not."""
    tree = tile_tree(128)
    tiles, texels = tree.tiles.copy(), (torch.empty(6 * 128**2).numpy(), torch.empty(6 * 128**2, 3).numpy())
    frames = lobe_frames(*pixels(torch.full((1,), 0.2))[1:]).numpy()
    loops = dispatch.compiled_loops("culled_stacking", 1)
    loops.stack(frames, torch.ones(1, 4).numpy(), tree.bounds, 0 * tree.maps, tree.texels, tiles, *texels)
    touched = (tiles.reshape(-1, 7, NODES)[:, 3] != 0).any(axis=1).sum()
    assert 300 < touched < 900  # of 8160 tiles, where all texels take 6144


def test_there_is_no_gradient():
    colors, *lobes = pixels(torch.full((3,), 0.5))
    assert not any(found.requires_grad for found in stack_on_cubemap(colors.requires_grad_(), *lobes, 64))


def test_a_map_too_small_for_quarters_is_refused():
    """The loop would go down to tiles that are not there."""
    with pytest.raises(ValueError, match="too small"):
        tile_tree(16)
