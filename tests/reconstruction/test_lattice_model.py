"""The first pass's model keeps its colours valid without losing its hold on them."""

import numpy as np
import torch

from lightprobe.core.config import DecomposeConfig
from lightprobe.reconstruction.lattice_model import LatticeModel
from lightprobe.reconstruction.start import start_from_hull
from lightprobe.scene.hull import Hull


def test_a_colour_beyond_white_shows_white_and_can_come_back():
    axis = np.linspace(-1.15, 1.15, 16)
    ball = sum(a**2 for a in np.meshgrid(axis, axis, axis)) < 0.8
    hull = Hull(ball, ball.astype(np.float32), np.full(3, -1.15), np.full(3, 1.15))
    model = LatticeModel(start_from_hull(hull, 8), DecomposeConfig(), torch.device("cpu"), 0)
    model.brighten(10.0)
    color = model.material(torch.tensor([[0.1, 0.2, 0.3]]))[:, :3]
    assert torch.equal(color, torch.ones(1, 3))
    color.sum().backward()
    gradient = model.material.field.biases[-1].grad
    assert gradient is not None
    assert (gradient[:3] > 0).all()
