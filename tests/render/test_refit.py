"""The refit: finds brightness and contrast again, whatever the exposure, and does not mind clipped or stray pixels."""

import pytest
import torch

from lightprobe.light.prefilter import cached
from lightprobe.render.refit import refit_contrast
from lightprobe.render.transport import Transport
from tests.gbuffers import R, sky, sphere_gbuffer


def case(exposure=1.0):
    transport = Transport(sphere_gbuffer(800, roughness=0.3, metallic=0.5), cached(R))
    light = exposure * sky(R).clamp(max=4)
    return transport, light, transport.apply(light)


def dimmed(light, brightness, contrast):
    mean = light.mean((0, 1, 2)).expand_as(light)
    return brightness * mean + contrast * (light - mean)


@pytest.mark.parametrize("exposure", [1.0, 0.01, 50.0])
def test_brightness_and_contrast_come_back(exposure):
    transport, light, observed = case(exposure)
    found = refit_contrast(transport, dimmed(light, 0.8, 0.75), observed, torch.zeros_like(observed, dtype=torch.bool))
    torch.testing.assert_close(found, light, rtol=1e-3, atol=1e-3 * exposure)


def test_stray_and_clipped_pixels_do_not_count():
    transport, light, observed = case()
    white = torch.quantile(observed, 0.6)
    shown = observed.clamp(max=float(white))
    shown[::10] = 0.0  # shadows that the model does not know
    found = refit_contrast(transport, dimmed(light, 0.9, 0.9), shown, shown >= white)
    assert float((transport.apply(found) - observed).abs().mean() / observed.mean()) < 0.02
    taken_as_true = refit_contrast(transport, dimmed(light, 0.9, 0.9), shown, torch.zeros_like(shown, dtype=torch.bool))
    assert float((transport.apply(taken_as_true) - observed).abs().mean() / observed.mean()) > 0.1


def test_a_constant_light_keeps_its_colour():
    transport = Transport(sphere_gbuffer(300), cached(R))
    light = torch.ones(6, R, R, 3) * torch.tensor([0.5, 0.4, 0.3])
    found = refit_contrast(transport, light, 1.5 * transport.apply(light), torch.zeros(300, 3, dtype=torch.bool))
    torch.testing.assert_close(found, 1.5 * light, rtol=1e-3, atol=1e-4)
