import numpy as np
import pillow_heif
import pytest
import torch

from lightprobe.imaging import read_ldr, srgb_decode, srgb_encode, write_exr
from lightprobe.imaging.color import straight

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


@pytest.mark.parametrize(("dtype", "white"), [(np.float32, 1.0), (np.uint8, 255), (np.uint16, 65535)])
@pytest.mark.parametrize("colors", [1, 3])
def test_color_is_divided_by_alpha(dtype, white, colors):
    stored = np.zeros((2, 3, colors + 1), np.float64)
    stored[..., :-1], stored[..., -1] = 0.2, 0.4
    stored = (stored * white).astype(dtype)
    color = straight(stored.copy(), white)
    assert color.dtype == dtype
    np.testing.assert_allclose(color[..., :-1] / white, 0.5, atol=3e-3)
    np.testing.assert_array_equal(color[..., -1], stored[..., -1])


def test_integers_end_at_white_and_what_has_no_alpha_stays():
    assert straight(np.full((1, 1, 4), 100, np.uint8) * np.array([2, 1, 1, 1], np.uint8), 255)[0, 0, 0] == 255
    grey = np.full((2, 2, 3), 7, np.uint8)
    assert straight(grey, 255) is grey


def test_light_that_covers_nothing_stays_as_stored(tmp_path):
    """A glow beside a cut-out object, and a picture whose alpha was left at 0."""
    pixels = np.zeros((4, 6, 4), np.float32)
    pixels[..., :3], pixels[:2] = 0.5, (0.02, 0.02, 0.02, 1e-7)
    write_exr(tmp_path / "a.exr", pixels)
    np.testing.assert_allclose(read_ldr(tmp_path / "a.exr")[0], pixels[..., :3])


def test_heif_of_premultiplied_color(tmp_path):
    stored = np.full((64, 64, 4), (100, 100, 100, 128), np.uint8)
    pillow_heif.from_bytes("RGBa", (64, 64), stored.tobytes()).save(tmp_path / "a.heic", quality=-1)
    color, alpha = read_ldr(tmp_path / "a.heic")[:2]
    np.testing.assert_allclose(color, srgb_decode(np.float32(100 / 128)), atol=0.01)
    np.testing.assert_allclose(alpha, 128 / 255, atol=1e-6)
