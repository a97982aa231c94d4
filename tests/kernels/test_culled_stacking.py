"""Culled stacking through a tree: against the plain sums of all pairs, how much it visits, and wrong input.

How far it may be off for all kinds of lobes is tested in `tests.light.test_culled_stacking`.
"""

import pytest
import torch

from lightprobe.kernels import stack_probes, stack_probes_culled
from lightprobe.kernels.culled_stacking import ERROR, NODES
from lightprobe.kernels.lobe_frames import lobe_frames
from lightprobe.kernels.numba import culled_stacking as body
from lightprobe.kernels.reference import culled_stacking as reference
from lightprobe.light import cubemap
from lightprobe.light.culled_stacking import tile_tree
from tests.stacking import pixels


@pytest.mark.slow
def test_matches_the_reference():
    case, tree = pixels(torch.linspace(0.08, 1, 60)), tile_tree(64)
    exact = reference.stack(*(x.double() for x in case), tree)
    for found, true in zip(stack_probes_culled(*case, tree), exact, strict=True):
        assert float((found.double() - true).norm() / true.norm()) < ERROR


@pytest.mark.parametrize("resolution", [32, 64])
def test_the_reference_sums_at_the_texels_of_the_map(resolution):
    case = tuple(x.double() for x in pixels(torch.linspace(0.2, 1, 30)))
    found = stack_probes_culled(*case, tile_tree(resolution))
    expected = stack_probes(*case, cubemap.exact_directions(resolution).reshape(-1, 3))
    for one, other in zip(found, expected, strict=True):
        torch.testing.assert_close(one, other, rtol=1e-4, atol=1e-4)  # the tree holds its texels in float32


def test_it_culls():
    """A bound that lets every tile through, or none, would hide behind the error; the work would not."""
    tree = tile_tree(128)
    tiles, texels = tree.tiles.copy(), (torch.empty(6 * 128**2).numpy(), torch.empty(6 * 128**2, 3).numpy())
    frames = lobe_frames(*pixels(torch.full((1,), 0.2))[1:]).numpy()
    body._stack(frames, torch.ones(1, 4).numpy(), tree.bounds, 0 * tree.maps, tree.texels, tiles, *texels)
    touched = (tiles.reshape(-1, 7, NODES)[:, 3] != 0).any(axis=1).sum()
    assert 300 < touched < 900  # of 8160 tiles, where all texels take 6144


def test_there_is_no_gradient():
    colors, *lobes = pixels(torch.full((3,), 0.5))
    for found in stack_probes_culled(colors.requires_grad_(), *lobes, tile_tree(32)):
        assert not found.requires_grad


def test_wrong_input_is_refused():
    colors, normals, views, alpha2 = pixels(torch.full((4,), 0.5))
    with pytest.raises(ValueError, match="colors must have shape"):
        stack_probes_culled(colors[:3], normals, views, alpha2, tile_tree(32))
    with pytest.raises(ValueError, match="share a device and a floating dtype"):
        stack_probes_culled(colors.double(), normals, views, alpha2, tile_tree(32))


def test_a_map_too_small_for_quarters_is_refused():
    """The loop would go down to tiles that are not there."""
    with pytest.raises(ValueError, match="too small"):
        tile_tree(16)
