"""The tree of a cubemap's tiles: where each tile and its nodes lie, how far it extends, and what hands sums down."""

import itertools
import math

import numpy as np
import pytest
import torch

from lightprobe.light import cubemap
from lightprobe.light.culled_stacking import tile_tree

CHEBYSHEV = [-math.cos(math.pi * k / 8) for k in (1, 3, 5, 7)]  # the zeros of the fourth polynomial
TEXELS = [-0.75, -0.25, 0.25, 0.75]


def tiles(levels: int) -> list[tuple[float, float, float]]:
    """Return the middles (along columns, along rows) and half widths of one face's tiles, root by root."""
    middles = (-0.75, -0.25, 0.25, 0.75)
    found = []
    for down, along in itertools.product(middles, middles):
        level = [(along, down, 0.25)]
        for _ in range(levels):
            found += level
            quarters = list(itertools.product((-1, 1), (-1, 1)))
            level = [(a + x * h / 2, b + y * h / 2, h / 2) for a, b, h in level for y, x in quarters]
    return found


def directions(face: int, a: np.ndarray, b: np.ndarray) -> np.ndarray:
    points = cubemap.face_points(torch.full(a.shape, face), torch.from_numpy(a), torch.from_numpy(b)).numpy()
    return np.asarray(points / np.linalg.norm(points, axis=-1, keepdims=True))


@pytest.mark.parametrize(("resolution", "levels"), [(32, 2), (64, 3)])
def test_tiles_lie_row_by_row_and_each_before_its_quarters(resolution: int, levels: int) -> None:
    tree, count = tile_tree(resolution), (4**levels - 1) // 3
    assert tree.tiles.shape == (96, count, 112)
    assert all(part.dtype == np.float32 for part in (tree.tiles, tree.bounds, tree.maps))
    assert not tree.tiles[..., 48:].any()
    a, b, half = np.array(tiles(levels)).T[:, :, None]
    for face in (0, 3, 4):
        roots = slice(16 * face, 16 * face + 16)
        centres = directions(face, a, b)[:, 0]
        assert tree.bounds[roots, :, :3].reshape(-1, 3) == pytest.approx(centres, abs=1e-6)
        corners = directions(face, a + half * [-1, 1, -1, 1], b + half * [-1, -1, 1, 1])
        radii = np.linalg.norm(corners - centres[:, None], axis=-1).max(1)
        assert tree.bounds[roots, :, 3].ravel() == pytest.approx(radii, rel=1e-5)
        for leaf, places in ((False, CHEBYSHEV), (True, TEXELS)):
            kept = np.array([(half < 0.3 / 2 ** (levels - 1)).ravel() == leaf])[0]
            nodes = directions(face, a + half * np.tile(places, 4), b + half * np.repeat(places, 4))
            found = tree.tiles[roots, :, :48].reshape(-1, 3, 16).transpose(0, 2, 1)
            assert found[kept] == pytest.approx(nodes[kept], abs=1e-6)


@pytest.mark.parametrize("resolution", [32, 64])
def test_the_last_quarters_hold_every_texel_once_at_its_own_direction(resolution: int) -> None:
    tree = tile_tree(resolution)
    leaves = tree.texels.shape[1]
    assert tree.texels.shape == (96, (resolution // 16) ** 2, 16)
    assert np.array_equal(np.sort(tree.texels, axis=None), np.arange(6 * resolution**2))
    towards = cubemap.exact_directions(resolution).reshape(-1, 3).numpy()[tree.texels]
    nodes = tree.tiles[:, -leaves:, :48].reshape(96, leaves, 3, 16).transpose(0, 1, 3, 2)
    assert nodes == pytest.approx(towards, abs=1e-6)


def surface(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Return a polynomial of third order in each, which four nodes hold exactly."""
    return np.asarray(1 + 2 * x - y + 0.5 * x * y**2 - 3 * x**3 * y + 0.7 * x**2 * y**3)


@pytest.mark.parametrize(("kind", "places"), [(0, CHEBYSHEV), (1, TEXELS)])
def test_sums_at_nodes_are_handed_down_by_cubic_interpolation(kind: int, places: list[float]) -> None:
    nodes = np.array(CHEBYSHEV)
    values = surface(np.tile(nodes, 4), np.repeat(nodes, 4))
    for quarter, (y, x) in enumerate(itertools.product((-1, 1), (-1, 1))):
        within = np.array(places)
        expected = surface(np.tile((within + x) / 2, 4), np.repeat((within + y) / 2, 4))
        assert values @ tile_tree(32).maps[kind, quarter] == pytest.approx(expected, abs=1e-5)
