import math

import torch

from lightprobe.light import cubemap
from lightprobe.light.spherical_harmonics import BASIS, WINDOW, basis, harmonics

DIRECTIONS = cubemap.exact_directions(32)
ANGLES = cubemap.exact_solid_angles(32)


def test_the_basis_is_orthonormal_and_as_written():
    functions = basis(DIRECTIONS)
    products = torch.einsum("frca,frcb,frc->ab", functions, functions, ANGLES)
    torch.testing.assert_close(products, torch.eye(9, dtype=torch.float64), atol=2e-3, rtol=0)
    x, y, z = 0.6, -0.48, 0.64
    linear, products = [0.488603 * v for v in (y, z, x)], [1.092548 * v for v in (x * y, y * z, x * z)]
    zonal, sectoral = 0.315392 * (3 * z * z - 1), 0.546274 * (x * x - y * y)
    expected = torch.tensor([0.282095, *linear, *products[:2], zonal, products[2], sectoral])
    torch.testing.assert_close(basis(torch.tensor([x, y, z])), expected, atol=1e-5, rtol=0)
    assert len(BASIS) == 9


def test_a_light_of_low_order_comes_back_windowed():
    true = torch.randn(9, 3, generator=torch.Generator().manual_seed(0), dtype=torch.float64)
    light = basis(DIRECTIONS) @ true
    window = torch.tensor([WINDOW[k] for k in (0, 1, 1, 1, 2, 2, 2, 2, 2)], dtype=torch.float64)
    torch.testing.assert_close(harmonics(light.float()).double(), window[:, None] * true, atol=5e-3, rtol=0)


def test_the_window_is_hann_s_and_halves_what_a_lamp_rings():
    assert [round(w, 6) for w in WINDOW] == [1.0, 0.75, 0.25]
    lamp = torch.where((DIRECTIONS[..., 2] > 0.99)[..., None], 100.0, 0.0).expand(-1, -1, -1, 3).float()
    windowed = basis(DIRECTIONS).float() @ harmonics(lamp)
    plain = harmonics(lamp) / torch.tensor([WINDOW[k] for k in (0, 1, 1, 1, 2, 2, 2, 2, 2)])[:, None]
    assert float(windowed.min()) > 0.5 * float((basis(DIRECTIONS).float() @ plain).min())
    assert math.isclose(float(harmonics(torch.ones(6, 8, 8, 3))[0, 0]), 2 * math.sqrt(math.pi), rel_tol=1e-4)
