import math
from dataclasses import replace

import numpy as np
import pytest
import torch

from lightprobe.evaluation.true_light import BINS, ConfidenceBins, TrueLight, falls
from lightprobe.imaging import write_exr
from lightprobe.light import cubemap, equirect
from lightprobe.light.environment import Environment
from lightprobe.prediction import Prediction
from tests.shapes import camera_at

CPU = torch.device("cpu")
CAMERA = camera_at((2.0, 3.0, 1.0), size=20, focal=20)


@pytest.fixture(scope="module")
def true_light(tmp_path_factory):
    path = tmp_path_factory.mktemp("light") / "sky.exr"
    d = equirect.directions(64)
    glow = torch.exp(12 * (d @ torch.tensor([0.6, 0.0, 0.8]) - 1))[..., None] * torch.tensor([8.0, 6.0, 3.0])
    write_exr(path, (0.2 + 0.1 * d[..., 2:] + glow).numpy())
    return TrueLight.load(path, CAMERA, np.zeros(3), 16, CPU)


def guess(environment: torch.Tensor, confidence: torch.Tensor | None = None) -> Prediction:
    trust = torch.full((6, 16, 16), 0.5) if confidence is None else confidence
    return Prediction(Environment(environment), trust, {}, 1.0)


def test_the_truth_has_hardly_an_error_and_a_factor_only_a_raw_one(true_light):
    scores = true_light.scores(guess(true_light.environment.texels))
    assert scores["light_log_rmse"] == pytest.approx(0, abs=1e-6)
    assert scores["diffuse_si_rmse"] < 0.005
    assert scores["mirror_si_rmse"] < 0.08  # 6 x 16 x 16 texels for 64 x 128
    doubled = true_light.scores(guess(2 * true_light.environment.texels))
    assert doubled["light_log_rmse"] == pytest.approx(math.log(2), rel=0.03)
    assert doubled["light_log_rmse_scaled"] < 0.03
    assert doubled["mirror_si_rmse"] == pytest.approx(scores["mirror_si_rmse"], rel=1e-3)


def test_a_mirrored_map_is_found_out_by_every_sphere(true_light):
    """Cubemap and equirectangular conventions meet here: left for right must cost."""
    d = cubemap.directions(16) * torch.tensor([-1.0, 1.0, 1.0])
    wrong = cubemap.bilinear_taps(d.reshape(-1, 3), 16)
    mirrored = (
        (true_light.environment.texels.reshape(-1, 3)[wrong[0].long()] * wrong[1][..., None])
        .sum(1)
        .reshape(6, 16, 16, 3)
    )
    right, other = (true_light.scores(guess(light)) for light in (true_light.environment.texels, mirrored))
    for sphere in ("diffuse", "matte", "mirror"):
        assert other[f"{sphere}_si_rmse"] > 5 * right[f"{sphere}_si_rmse"]


def test_bins_of_confidence_hold_equal_solid_angles_and_their_errors():
    """The error is made larger where confidence is lower; the bins must find exactly that."""
    order = torch.rand(6, 16, 16, generator=torch.Generator().manual_seed(3))
    true = torch.ones(6, 16, 16, 3)
    sign = torch.where(torch.arange(16) % 2 == 0, 1.0, -1.0)[:, None]
    error = (1.5 - order)[..., None] * sign * torch.ones(3)
    bins = ConfidenceBins()
    bins.add(guess(torch.exp(error), order), Environment(true))
    result = bins.result()
    assert len(result) == BINS
    assert [b["confidence"] for b in result] == pytest.approx([0.1, 0.3, 0.5, 0.7, 0.9], abs=0.05)
    assert [b["log_rmse"] for b in result] == pytest.approx([1.4, 1.2, 1.0, 0.8, 0.6], abs=0.1)
    assert falls(result)
    assert falls(result, "log_rmse")
    assert not falls(result[::-1])
    assert ConfidenceBins().result() == []


def test_a_confident_error_weighs_more(true_light):
    wrong = true_light.environment.texels.clone()
    wrong[0] *= 5
    sure, unsure = torch.full((6, 16, 16), 0.1), torch.full((6, 16, 16), 0.9)
    sure[0], unsure[0] = 0.9, 0.1
    prediction = guess(wrong, sure)
    high = true_light.scores(prediction)["light_log_rmse_confident"]
    low = true_light.scores(replace(prediction, confidence=unsure))["light_log_rmse_confident"]
    assert high > 2 * low


def test_a_clipped_sun_costs_the_brightest_percent_most(true_light):
    clipped = true_light.environment.texels.clamp(max=float(true_light.environment.texels.max()) / 8)
    scores = true_light.scores(guess(clipped))
    assert scores["light_log_rmse_bright"] > 1
    assert scores["light_log_rmse_bright"] > 3 * scores["light_log_rmse"]
    brighter = true_light.scores(guess(3 * clipped))  # one factor for the whole map brings the sun no nearer
    assert brighter["light_log_rmse_bright"] < scores["light_log_rmse_bright"]
    assert brighter["light_log_rmse_bright_scaled"] == pytest.approx(scores["light_log_rmse_bright_scaled"], rel=0.05)
    exact = true_light.scores(guess(true_light.environment.texels))
    assert exact["light_log_rmse_bright"] == pytest.approx(0, abs=1e-6)
