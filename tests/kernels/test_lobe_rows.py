"""Lobes over the pyramid: against the plain reference and the lobe's integral, and finer where less is
tolerated.
"""

import itertools

import numpy as np
import pytest
import torch

from lightprobe.kernels import dispatch, lobe_rows
from lightprobe.light import cubemap
from lightprobe.light.lobes import _FRAMES, Nodes, _lobe_integral
from tests.threads import torch_threads

RESOLUTION = 8


def rows(directions, alpha, tolerance=0.01):
    return lobe_rows(directions, _FRAMES, alpha, _lobe_integral(alpha), RESOLUTION, tolerance)


def some_directions(count=9):
    random = torch.Generator().manual_seed(0)
    axes = torch.tensor([[0.0, 0, 1], [1, 1, 1], [1, 0, 1]])
    points = torch.cat([axes, torch.randn(count - 3, 3, generator=random)]).double()
    return torch.nn.functional.normalize(points, dim=1).numpy()


@pytest.mark.parametrize("alpha", [0.0064, 0.05, 0.3, 1.0])
def test_matches_the_reference(monkeypatch, alpha):
    """Squares may be cut or not where rounding decides, which moves a ten thousandth of a row at most."""
    directions = some_directions()
    found = rows(directions, alpha)
    monkeypatch.setattr(dispatch, "body_for", lambda device: dispatch.Body.REFERENCE)
    expected = rows(directions, alpha)
    for one, other in zip(found, expected, strict=True):
        assert one.dtype == other.dtype
    assert found[0][-1] == pytest.approx(expected[0][-1], rel=0.01)
    dense = [_dense(*result) for result in (found, expected)]
    assert np.abs(dense[0] - dense[1]).sum(axis=1).max() <= 1e-4 * dense[1].sum(axis=1).min()


def _dense(start, index, weight):
    out = np.zeros((len(start) - 1, Nodes(RESOLUTION, 4).total))
    np.add.at(out, (np.repeat(np.arange(len(start) - 1), np.diff(start)), index), weight)
    return out


@pytest.mark.parametrize("alpha", [0.0064, 0.05, 0.3, 1.0])
def test_a_row_sums_to_the_integral_of_its_lobe(alpha):
    """The kink at the lobe's horizon is what Gauss points see least of; narrow lobes have little left there."""
    start, _, weight = rows(some_directions(), alpha)
    np.testing.assert_allclose(np.add.reduceat(weight, start[:-1]), _lobe_integral(alpha), rtol=0.02)


def test_a_node_is_named_once_and_its_weight_is_not_negative():
    start, index, weight = rows(some_directions(), 0.0064)
    for first, end in itertools.pairwise(start):
        assert len(np.unique(index[first:end])) == end - first
    assert (weight >= 0).all()
    assert index.max() < Nodes(RESOLUTION, 4).squares


def test_less_tolerance_takes_more_squares():
    directions = some_directions()
    entries = [len(rows(directions, 0.05, tolerance)[1]) for tolerance in (0.1, 0.01, 0.001)]
    assert entries == sorted(entries)
    assert entries[0] < entries[-1]


def test_symmetric_directions_have_equal_rows_but_for_their_nodes():
    directions = cubemap.exact_directions(4).reshape(-1, 3).numpy()[[0, 3, 12, 15]]  # the corners of one face
    start, _, weight = rows(directions, 0.1)
    assert len(set(np.diff(start))) == 1
    for first, end in itertools.pairwise(start[1:]):
        np.testing.assert_allclose(np.sort(weight[first:end]), np.sort(weight[: start[1]]), rtol=1e-9)


def test_bits_do_not_depend_on_threads():
    results = []
    for count in (1, 2):
        with torch_threads(count):
            results.append(rows(some_directions(40), 0.1))
    for one, two in zip(*results, strict=True):
        assert np.array_equal(one, two)
