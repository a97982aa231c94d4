import numpy as np
import pytest
import scipy.sparse
import torch

from lightprobe.light import cubemap
from lightprobe.light.lobes import Nodes, Orbits, narrow_rows, wide_rows
from lightprobe.light.prefilter import Accuracy, _lobe_matrix, accuracy_for, plan_levels

CPU = torch.device("cpu")


def row_by_row(levels, nodes: Nodes, accuracy: Accuracy) -> scipy.sparse.csr_array:
    """Return the matrix of the levels from the lobe around every texel of theirs, without symmetry."""
    rows = []
    for level in levels:
        directions = cubemap.exact_directions(level.resolution).reshape(-1, 3).numpy()
        alpha = level.roughness**2
        if level.roughness < accuracy.wide:
            rows.append(narrow_rows(directions, alpha, nodes, accuracy.tolerance))
        else:
            rows.append(wide_rows(directions, alpha, nodes))
    return scipy.sparse.csr_array(scipy.sparse.vstack(rows, format="csr"), dtype=np.float32)


@pytest.mark.parametrize("resolution", [4, 8, 16])
def test_the_rows_of_an_orbit_are_those_computed_one_by_one(resolution):
    levels, accuracy = plan_levels(resolution), accuracy_for(resolution)
    nodes = Nodes(resolution, min(resolution, accuracy.tent_resolution))
    expected, unfolded = row_by_row(levels, nodes, accuracy), _lobe_matrix(levels, nodes, accuracy)
    expected.sort_indices()
    unfolded.sort_indices()
    assert np.array_equal(unfolded.indptr, expected.indptr)
    assert np.array_equal(unfolded.indices, expected.indices)
    # they differ in float64 by the order of their sums, which float32 all but never shows
    assert np.abs(unfolded.data / expected.data - 1).max() <= np.finfo(np.float32).eps
    assert (unfolded.data != expected.data).mean() < 1e-5


@pytest.mark.parametrize("resolution", [4, 8, 32])
def test_every_texel_is_carried_onto_the_first_of_its_orbit(resolution):
    orbits, (index, _) = Orbits.of(resolution), cubemap.symmetries(resolution, CPU)
    assert len(orbits.first) == resolution * (resolution + 2) // 8
    carried = index.numpy()[orbits.by, np.arange(6 * resolution**2)]
    assert np.array_equal(carried, orbits.first[orbits.which])


@pytest.mark.parametrize("resolution", [8, 32])
def test_nodes_are_carried_with_the_texels_they_average(resolution):
    """The averages of a turned light are those of the light at the nodes that the turn carries there."""
    nodes = Nodes(resolution, 8)
    matrix, index = nodes.matrix(), cubemap.symmetries(resolution, CPU)[0].numpy()
    light = np.random.default_rng(0).random(6 * resolution**2)
    for turn, source in zip(index, nodes.sources(), strict=True):
        np.testing.assert_allclose((matrix @ light[turn])[source], matrix @ light, rtol=1e-12)
