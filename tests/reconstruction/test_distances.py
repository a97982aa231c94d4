"""Coarse grids interpolate linearly at the lattice's vertices; their gradients are sums of those there."""

import numpy as np
import torch

from lightprobe.geometry.tet_lattice import build_lattice
from lightprobe.reconstruction.distances import CoarseGrids

CELL = 0.1


def some_lattice():
    keep = np.ones((10, 9, 7), bool)
    keep[0] = keep[:3, :2] = False  # the kept part neither starts at the corner nor fills a box
    return build_lattice(keep, np.array([-0.3, 0.2, 0.5]), CELL)


def test_they_start_at_zero():
    assert not CoarseGrids(some_lattice())().any()


def test_values_of_a_linear_function_give_it_at_every_vertex():
    lattice, slope = some_lattice(), torch.tensor([1.0, -2.0, 3.0])
    for level, spacing in ((0, 4), (1, 8)):
        grids = CoarseGrids(lattice)
        values = grids.values[level]
        nodes = torch.stack(torch.meshgrid(*(torch.arange(n) for n in values.shape), indexing="ij"), -1)
        values.data = (spacing * CELL * nodes) @ slope
        expected = (lattice.vertices - lattice.vertices.min(0).values) @ slope
        torch.testing.assert_close(grids(), expected, atol=1e-5, rtol=0)


def test_one_value_moves_what_lies_around_it():
    lattice = some_lattice()
    grids = CoarseGrids(lattice)
    grids().sum().backward()
    reach = grids.values[0].grad
    assert reach is not None
    grids.values[0].data[1, 1, 1] = 1
    moved = grids()
    torch.testing.assert_close(moved.sum(), reach[1, 1, 1])
    center = lattice.vertices.min(0).values + 4 * CELL
    inside = ((lattice.vertices - center).abs() < 3.99 * CELL).all(1)
    assert torch.equal(moved > 0, inside)
