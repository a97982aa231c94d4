import numpy as np
import pytest
import torch

from lightprobe.imaging import srgb_decode, srgb_encode

# Published points of the curve (IEC 61966-2-1): 8-bit code -> linear value.
KNOWN = {0: 0.0, 1: 0.000303527, 10: 0.00303527, 11: 0.00334654, 128: 0.215861, 188: 0.502886, 255: 1.0}


@pytest.mark.parametrize("kind", ["numpy", "torch"])
def test_known_points_and_inverse(kind):
    wrap = np.asarray if kind == "numpy" else torch.tensor
    codes = wrap([code / 255 for code in KNOWN])
    linear = srgb_decode(codes)
    np.testing.assert_allclose(np.asarray(linear), list(KNOWN.values()), rtol=2e-5)
    np.testing.assert_allclose(np.asarray(srgb_encode(linear)), np.asarray(codes), atol=1e-7)


def test_float32_stays_float32_and_negative_values_survive():
    values = np.linspace(-1, 4, 101, dtype=np.float32)
    assert srgb_encode(values).dtype == np.float32
    np.testing.assert_allclose(srgb_decode(srgb_encode(values)), values, atol=2e-6)


def test_gradient_is_finite_everywhere():
    values = torch.tensor([-1.0, 0.0, 1e-8, 0.5, 2.0], dtype=torch.float64, requires_grad=True)
    for function in (srgb_encode, srgb_decode):
        (gradient,) = torch.autograd.grad(function(values).sum(), values)
        assert torch.isfinite(gradient).all()
        assert (gradient > 0).all()
