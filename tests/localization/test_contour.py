"""The outline and the photo's edges."""

import numpy as np
import torch

from lightprobe.localization.appearance import appearance
from lightprobe.localization.contour import edge_support, nearest_edges, outline_of
from lightprobe.localization.level import Levels

SIDE, RADIUS = 80, 20.0
DOWN, ACROSS = np.mgrid[:SIDE, :SIDE] + 0.5


def disc(x: float, y: float) -> np.ndarray:
    return np.hypot(ACROSS - x, DOWN - y) < RADIUS


def photo_of_disc(x: float, inside=(0.6, 0.3, 0.2)) -> Levels:
    return Levels(np.where(disc(x, 40)[..., None], inside, (0.1, 0.2, 0.4)))


def outline():
    return outline_of(np.flatnonzero(disc(40, 40)), SIDE, SIDE, 100)


def test_the_outline_runs_around_the_object_and_looks_outwards():
    found = outline()
    away = found.place - 40
    assert len(found.row) == 100
    assert np.abs(np.linalg.norm(away, axis=1) - RADIUS).max() < 1.2
    assert ((away * found.normal).sum(1) > 0.95 * np.linalg.norm(away, axis=1)).all()


def test_edges_are_found_where_the_object_really_is():
    looks = appearance(torch.tensor([[0.6, 0.3, 0.2]])).numpy().repeat(100, 0)
    support = edge_support(photo_of_disc(43).near(1.0), outline(), looks, 6)
    distance, weight = nearest_edges(support)
    expected = 3 * outline().normal[:, 0]
    assert np.median(np.abs(distance - expected)) < 0.6
    assert weight.mean() > 0.7


def test_an_edge_of_something_else_has_no_support():
    looks = appearance(torch.tensor([[0.02, 0.3, 0.02]])).numpy().repeat(100, 0)
    assert nearest_edges(edge_support(photo_of_disc(43).near(1.0), outline(), looks, 6))[1].max() < 0.1


def test_an_object_outside_the_photo_has_no_outline():
    assert len(outline_of(np.arange(0), SIDE, SIDE, 10).row) == 0
