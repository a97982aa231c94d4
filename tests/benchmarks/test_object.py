"""Phase I alone: fields are changed by name, and lights are compared without their level."""

import pytest
import torch

from lightprobe.core.config import DecomposeConfig
from lightprobe.core.errors import ConfigError
from measure_object import changed, light_errors
from tests.gbuffers import sky


def test_fields_are_changed_by_name_and_kind():
    config = changed(DecomposeConfig(), ["light_chroma=0", "trial_steps=7"])
    assert (config.light_chroma, config.trial_steps) == (0.0, 7)


@pytest.mark.parametrize(
    "change", ["nonsense=1", "light_chroma", "trial_steps=1.5", "sdf=mlp", "light_chroma=-1"]
)
def test_what_is_no_number_of_the_configuration_is_refused(change):
    with pytest.raises(ConfigError):
        changed(DecomposeConfig(), [change])


def test_lights_are_compared_without_their_level_and_casts_told_from_brightness():
    true = sky(16)
    assert light_errors(true * torch.tensor([3.0, 2.0, 1.0]), true) == pytest.approx((0, 0), abs=1e-5)
    half = torch.ones(6, 16, 16, 1)
    half[0] = 4.0
    error, cast = light_errors(true * half, true)
    assert error > 0.3
    assert cast < 0.2 * error
    assert light_errors(true * torch.where(half > 1, torch.tensor([1.0, 1.0, 4.0]), 1.0), true)[1] > 0.2
