"""nvdiffrec's image loss against loops written from its description."""

import math

import pytest
import torch
from lightprobe.reconstruction.frame_loss import color_change, frame_loss

from lightprobe.core.config import ImageLoss


def displayed(x: float) -> float:
    y = math.log(1 + x)
    return 12.92 * y if y <= 0.0031308 else 1.055 * y ** (1 / 2.4) - 0.055


@pytest.mark.parametrize("kind", [ImageLoss.LOG_L1, ImageLoss.L2])
def test_the_loss_is_the_loop_s(kind):
    random = torch.Generator().manual_seed(3)
    cover, alpha = torch.rand(2, 20, generator=random).unbind(0)
    render, photo = (2 * torch.rand(2, 20, 3, generator=random)).unbind(0)
    background = torch.rand(3, generator=random)
    expected = 0.0
    for k in range(20):
        for channel in range(3):
            ours = float(alpha[k] * (render[k, channel] + (1 - cover[k]) * background[channel]))
            theirs = float(alpha[k] * (photo[k, channel] + (1 - alpha[k]) * background[channel]))
            expected += (
                (ours - theirs) ** 2 if kind is ImageLoss.L2 else abs(displayed(ours) - displayed(theirs))
            )
    expected = expected / 60 + 0.5 * float((cover - alpha).square().sum()) / 20
    assert float(frame_loss(render, cover, photo, alpha, background, 0.5, kind)) == pytest.approx(
        expected, rel=1e-4
    )


def test_light_beyond_a_clipped_pixel_costs_as_it_does_there():
    one, white = torch.ones(4), torch.ones(4, 3)
    loss = frame_loss(2 * white, one, white, one, torch.zeros(3), 1.0, ImageLoss.LOG_L1)
    assert float(loss) == pytest.approx(displayed(2.0) - displayed(1.0), rel=1e-4)


def test_smoothness_comes_in_over_500_steps_and_counts_by_frame():
    here, there = torch.zeros(8, 3), torch.full((8, 3), 0.5)
    assert float(color_change(here, there, 0.25, 0)) == 0
    assert float(color_change(here, there, 0.25, 250)) == pytest.approx(0.5 * 0.25 * 0.5)
    assert float(color_change(here, there, 0.25, 9000)) == pytest.approx(0.25 * 0.5)
