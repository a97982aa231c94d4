"""Lobes over the pyramid: against plain recursion and the lobe's integral, and finer where less is tolerated."""

import itertools
import math

import numpy as np
import pytest
import torch

from lightprobe.kernels import lobe_rows
from lightprobe.light import cubemap
from lightprobe.light.lobes import _FRAMES, Nodes, _lobe_integral
from tests.threads import assert_same_bits

RESOLUTION = 8


def rows(directions, alpha, tolerance=0.01):
    return lobe_rows(directions, _FRAMES, alpha, _lobe_integral(alpha), RESOLUTION, tolerance)


def some_directions(count=9):
    random = torch.Generator().manual_seed(0)
    axes = torch.tensor([[0.0, 0, 1], [1, 1, 1], [1, 0, 1]])
    points = torch.cat([axes, torch.randn(count - 3, 3, generator=random)]).double()
    return torch.nn.functional.normalize(points, dim=1).numpy()


def seen(frame, direction, a, b, size):
    """Return the lobe's argument, the chord to the face point (a, b), and the solid angle of a small square."""
    length = math.sqrt(1 + a * a + b * b)
    chord = np.linalg.norm(np.array([1.0, a, b]) @ frame / length - direction)
    return float(chord), 4 / (size**2 * length**3)


def lobe(chord, alpha):
    return max(1 - chord**2 / 2, 0.0) / (alpha**2 + (1 - alpha**2) * chord**2 / 4) ** 2


def plain_row(direction, alpha, tolerance=0.01):
    """Return one row (nodes,) and its entries, as the definition in `kernels.lobe_rows` has it."""
    weights, named = np.zeros(Nodes(RESOLUTION, 4).total), set()
    squares = [(2, *place) for place in itertools.product(range(6), range(2), range(2))]
    while squares:
        size, face, y, x = squares.pop()
        chord, area = seen(_FRAMES[face], direction, (2 * x + 1) / size - 1, (2 * y + 1) / size - 1, size)
        near = max(chord - 0.75 * math.sqrt(area), 0.0)
        share = min(area * lobe(near, alpha) / _lobe_integral(alpha), 1.0)
        if share * math.sqrt(area) > tolerance * math.sqrt(4 * alpha**2 + near**2):
            squares += [(2 * size, face, 2 * y + down, 2 * x + along) for down in (0, 1) for along in (0, 1)]
        elif share > 0:
            level = min(size, RESOLUTION)
            node = 2 * (level**2 - 4) + (face * level + y * level // size) * level + x * level // size
            named.add(node)
            for along, down in itertools.product((1 - 1 / math.sqrt(3), 1 + 1 / math.sqrt(3)), repeat=2):
                a, b = (2 * x + along) / size - 1, (2 * y + down) / size - 1
                chord, area = seen(_FRAMES[face], direction, a, b, 2 * size)
                weights[node] += area * lobe(chord, alpha)
    return weights, len(named)


@pytest.mark.parametrize("alpha", [0.0064, 0.05, 0.3, 1.0])
def test_matches_the_reference(alpha):
    """Squares may be cut or not where rounding decides, which moves a ten thousandth of a row at most."""
    plain = [plain_row(direction, alpha) for direction in some_directions()]
    expected = np.array([row for row, _ in plain])
    start, index, weight = rows(some_directions(), alpha)
    assert (start.dtype, index.dtype, weight.dtype) == (np.int64, np.int32, np.float64)
    assert start[-1] == pytest.approx(sum(named for _, named in plain), rel=0.01)
    found = np.zeros_like(expected)
    np.add.at(found, (np.repeat(np.arange(len(start) - 1), np.diff(start)), index), weight)
    assert np.abs(found - expected).sum(axis=1).max() <= 1e-4 * expected.sum(axis=1).min()


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
    assert_same_bits(lambda: rows(some_directions(40), 0.1))
