"""The refit finds brightness and contrast again, whatever the exposure, despite clipped and stray pixels."""

import numpy as np
import pytest
import torch

from lightprobe.light.prefilter import cached
from lightprobe.render.refit import refit_contrast
from lightprobe.render.transport import Transport
from tests.gbuffers import R, sky, sphere_gbuffer
from tests.render.dense import DenseTransport


def case(exposure=1.0):
    transport = Transport(sphere_gbuffer(800, roughness=0.3, metallic=0.5), cached(R))
    light = exposure * sky(R).clamp(max=4)
    return transport, light, transport.apply(light)


def refitted(transport, light, observed, clipped=None):
    """Return a light with brightness and contrast refitted to pixels, by default none of them clipped."""
    clipped = torch.zeros_like(observed, dtype=torch.bool) if clipped is None else clipped
    return refit_contrast(transport, transport.lit(light), observed, clipped)


def dimmed(light, brightness, contrast):
    mean = light.mean((0, 1, 2)).expand_as(light)
    return brightness * mean + contrast * (light - mean)


@pytest.mark.parametrize("exposure", [1.0, 0.01, 50.0])
def test_brightness_and_contrast_come_back(exposure):
    transport, light, observed = case(exposure)
    found = refitted(transport, dimmed(light, 0.8, 0.75), observed)
    torch.testing.assert_close(found, light, rtol=1e-3, atol=1e-3 * exposure)


def test_stray_and_clipped_pixels_do_not_count():
    transport, light, observed = case()
    white = torch.quantile(observed, 0.6)
    shown = observed.clamp(max=float(white))
    shown[::10] = 0.0  # shadows that the model does not know
    found = refitted(transport, dimmed(light, 0.9, 0.9), shown, shown >= white)
    assert float((transport.apply(found) - observed).abs().mean() / observed.mean()) < 0.02
    taken_as_true = refitted(transport, dimmed(light, 0.9, 0.9), shown)
    assert float((transport.apply(taken_as_true) - observed).abs().mean() / observed.mean()) > 0.1


@pytest.mark.parametrize("channels", [[0], [0, 1, 2]])
def test_what_is_clipped_throughout_leaves_a_light_as_it_is(channels):
    transport, light, observed = case(20.0)
    clipped = torch.zeros_like(observed, dtype=torch.bool)
    clipped[:, channels] = True
    shown = torch.where(clipped, observed.min(), observed)
    torch.testing.assert_close(refitted(transport, light, shown, clipped), light, rtol=1e-3, atol=1e-3)


@pytest.mark.parametrize(("factor", "most"), [(9.0, 2.0), (0.1, 0.5)])
def test_a_light_is_at_most_doubled_or_halved(factor, most):
    transport, light, observed = case()
    found = refitted(transport, light, factor * observed)
    torch.testing.assert_close(found, most * light)


def test_six_rounds_of_reweighted_least_squares_in_displayed_values():
    """By `numpy.linalg.lstsq` over the four unknowns, on a photo that no brightness and contrast explain."""
    random = torch.Generator().manual_seed(3)
    transport = DenseTransport.random(40, 2)
    light = torch.rand(6, 2, 2, 3, generator=random, dtype=torch.float64) * torch.tensor([0.9, 0.6, 0.4])
    observed = transport.apply(light) * (0.4 + 1.4 * torch.rand(40, 3, generator=random, dtype=torch.float64))
    clipped = observed > observed.quantile(0.8)
    flat = light.mean((0, 1, 2)).expand_as(light)
    unit = observed.mean() / 0.22
    pictures = transport.apply(flat), transport.apply(light), observed
    mean, both, target = ((x / unit).numpy() for x in pictures)
    varying, a, b = both - mean, np.ones(3), 1.0
    for _ in range(6):
        render = np.maximum(a * mean + b * varying, 0)
        slope = (render + 0.02) ** -0.55
        weight = slope**2 / (slope * np.abs(render - target) + 0.005)
        weight[clipped.numpy() & (render > target)] = 0
        rows = np.concatenate([np.eye(3)[None] * mean[..., None], varying[..., None]], 2)
        rows = rows * np.sqrt(weight)[..., None]
        steady = np.sqrt(1e-4 * (weight * mean**2).sum())  # keeps b at 1 where nothing tells
        rows = np.concatenate([rows.reshape(-1, 4), [[0, 0, 0, steady]]])
        wanted = np.append((np.sqrt(weight) * target).ravel(), steady)
        *a, b = np.linalg.lstsq(rows, wanted, rcond=None)[0]
        a = np.array(a)
    assert all(0.55 < x < 1.9 for x in (*a, b))
    assert clipped.sum() > 10
    expected = torch.from_numpy(a) * flat + b * (light - flat)
    torch.testing.assert_close(refitted(transport, light, observed, clipped), expected.clamp(min=0))
