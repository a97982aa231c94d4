import pytest
import torch

from lightprobe.core.config import StartShape
from lightprobe.reconstruction.start import BOX, start_from_box


def test_the_ball_fills_the_box_s_lattice():
    start = start_from_box(StartShape.SPHERE, 8, 0)
    assert start.lattice.vertices.shape == (9**3, 3)
    assert start.lattice.vertices.abs().max() == pytest.approx(BOX)
    torch.testing.assert_close(start.distance + 1, start.lattice.vertices.norm(dim=1))


def test_noise_has_a_tenth_inside_and_follows_the_seed():
    first, again, other = (start_from_box(StartShape.RANDOM, 16, seed) for seed in (0, 0, 1))
    assert float((first.distance < 0).float().mean()) == pytest.approx(0.1, abs=0.02)
    assert torch.equal(first.distance, again.distance)
    assert not torch.equal(first.distance, other.distance)
