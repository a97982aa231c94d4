"""Equation 6 against a loop written from the paper."""

import math

import pytest
import torch

from lightprobe.core.config.distillation import LossSpace, RadianceUnit
from lightprobe.distillation.loss import intensity_weight, sample_weight, weighted_l2


def naive_loss(predicted, teacher, sampled, total, solid_angle, *, use_sample, use_intensity, log):
    loss = 0.0
    for k in range(len(teacher)):
        w = sampled[k] / total[k] if total[k] > 0 else 0.0
        r, g, b = (min(max(v, 0.0), 1e30) for v in teacher[k])
        luma = min((0.299 * r + 0.587 * g + 0.114 * b) / 2, 1.0)  # the photo's light level counts as .5
        y = abs(luma - 0.5) + 0.5
        difference = 0.0
        for p, e in zip(predicted[k], teacher[k], strict=True):
            difference += (math.log(1 + p) - math.log(1 + e)) ** 2 if log else (p - e) ** 2
        loss += (w if use_sample else 1.0) * (y if use_intensity else 1.0) * difference * solid_angle[k]
    return loss / (4 * math.pi)


@pytest.mark.parametrize("use_sample", [False, True])
@pytest.mark.parametrize("use_intensity", [False, True])
@pytest.mark.parametrize("space", list(LossSpace))
def test_all_combinations_match_the_loop(use_sample, use_intensity, space):
    random = torch.Generator().manual_seed(2)
    predicted, teacher = (3 * torch.rand(2, 40, 3, generator=random, dtype=torch.float64)).unbind(0)
    teacher[3] = torch.tensor([500.0, 400.0, 300.0])
    sampled, total, angle = torch.rand(3, 40, generator=random, dtype=torch.float64).unbind(0)
    sampled[5] = total[5] = 0
    weight = torch.ones(40, dtype=torch.float64)
    weight = weight * sample_weight(sampled, total) if use_sample else weight
    weight = weight * intensity_weight(teacher) if use_intensity else weight
    expected = naive_loss(
        predicted.tolist(),
        teacher.tolist(),
        sampled.tolist(),
        total.tolist(),
        angle.tolist(),
        use_sample=use_sample,
        use_intensity=use_intensity,
        log=space is LossSpace.LOG,
    )
    assert float(weighted_l2(predicted, teacher, weight, angle, space)) == pytest.approx(expected, rel=1e-12)


def test_intensity_weight_is_least_at_the_light_level():
    grey = torch.tensor([0.0, 0.5, 1.0, 1.5, 2.0, 1000.0])[:, None].expand(-1, 3)
    torch.testing.assert_close(intensity_weight(grey), torch.tensor([1.0, 0.75, 0.5, 0.75, 1.0, 1.0]))


def test_the_printed_intensity_weight_is_not_bounded():
    grey = torch.tensor([0.0, 0.5, 1.0, 20.0])[:, None].expand(-1, 3)
    torch.testing.assert_close(
        intensity_weight(grey, RadianceUnit.PHOTO), torch.tensor([1.0, 0.5, 1.0, 20.0])
    )


@pytest.mark.golden
def test_golden_number():
    teacher = torch.tensor([[0.0, 0.0, 0.0], [2.0, 1.0, 0.5], [8.0, 8.0, 8.0]], dtype=torch.float64)
    predicted = torch.tensor([[0.5, 0.5, 0.5], [1.0, 1.0, 1.0], [4.0, 8.0, 2.0]], dtype=torch.float64)
    weight = sample_weight(torch.tensor([1.0, 3.0, 0.5]), torch.tensor([2.0, 2.0, 0.5])) * intensity_weight(
        teacher
    )
    angle = torch.full((3,), 4 * math.pi / 3, dtype=torch.float64)
    # by hand: w Y = .5 * 1, 1.5 * (.5 + |1.242/2 - .5|), 1 * 1; squared differences .75, 1.25, 52
    expected = (0.5 * 0.75 + 1.5 * 0.621 * 1.25 + 52) / 3
    assert float(weighted_l2(predicted, teacher, weight, angle, LossSpace.LINEAR)) == pytest.approx(
        expected, rel=1e-6
    )
