"""Hash grid: against the plain reference, by gradcheck, bit by bit, and what interpolation must do."""

import pytest
import torch
from torch.autograd import gradcheck

from lightprobe.kernels import hash_encode
from lightprobe.kernels.reference import hash_grid as reference
from tests.threads import assert_same_bits

CELLS = [3, 8, 21, 64]  # with 1024 rows: dense, dense, hashed, hashed


def problem(n=700, size=1024, features=2, *, seed=0):
    random = torch.Generator().manual_seed(seed)
    points = torch.rand(n, 3, generator=random)
    table = torch.randn(len(CELLS), size, features, generator=random)
    return points, table, torch.tensor(CELLS, dtype=torch.int32)


def value_and_gradients(points, table, resolutions, grad):
    """Return the features and the gradients to table and points."""
    points, table = points.clone().requires_grad_(), table.clone().requires_grad_()
    out = hash_encode(points, table, resolutions)
    return out.detach(), *torch.autograd.grad(out, (table, points), grad)


@pytest.mark.parametrize("features", [1, 2, 4])
def test_matches_the_reference(backend, features):
    points, table, resolutions = backend.move(*problem(features=features))
    grad = torch.randn(len(points), len(CELLS) * features, device=backend.device)
    out, grad_table, grad_points = value_and_gradients(points, table, resolutions, grad)
    torch.testing.assert_close(out, reference.encode(points, table, CELLS), rtol=1e-5, atol=1e-5)
    expected = reference.encode_backward(grad, points, CELLS, table.shape)
    torch.testing.assert_close(grad_table, expected, rtol=1e-4, atol=1e-5)
    expected = reference.encode_backward_to_points(grad, points, table, CELLS)
    torch.testing.assert_close(grad_points, expected, rtol=1e-4, atol=1e-3)


@pytest.mark.slow
def test_gradients_in_float64():
    points, table, resolutions = problem(n=5, size=16)
    variables = points.double().requires_grad_(), table.double().requires_grad_()
    assert gradcheck(lambda p, t: hash_encode(p, t, resolutions), variables)


def test_a_clamped_point_does_not_move(backend):
    points, table, resolutions = backend.move(*problem(n=6))
    points[0, 0], points[1, 2], points[2, 1] = -0.2, 1.3, float("nan")
    grad = torch.ones(6, 2 * len(CELLS), device=backend.device)
    _, _, to_points = value_and_gradients(points, table, resolutions, grad)
    held = torch.zeros(6, 3, dtype=torch.bool)
    held[0, 0] = held[1, 2] = held[2, 1] = True
    assert torch.equal(to_points.cpu() == 0, held)


def test_dense_level_reproduces_a_linear_function():
    side = 9
    z, y, x = torch.meshgrid(*[torch.arange(side) / (side - 1)] * 3, indexing="ij")
    corners = torch.stack([2 * x - y + 3 * z + 1, y], dim=-1).reshape(-1, 2)
    table = torch.zeros(1, 1024, 2)
    table[0, : len(corners)] = corners
    points = torch.cat([torch.rand(200, 3), torch.tensor([[0.0, 0, 0], [1, 1, 1], [0.5, 1, 0]])])
    out = hash_encode(points, table, torch.tensor([side - 1]))
    expected = torch.stack([2 * points[:, 0] - points[:, 1] + 3 * points[:, 2] + 1, points[:, 1]], dim=1)
    torch.testing.assert_close(out, expected, rtol=1e-5, atol=1e-5)


def test_corner_rows_follow_the_paper(backend):
    points = torch.tensor([[5.0, 9, 14]], device=backend.device) / 32  # a lattice corner has all weight
    grad_out, cells = torch.ones(1, 1, device=backend.device), torch.tensor([32])
    _, grad, _ = value_and_gradients(points, torch.zeros(1, 256, 1, device=backend.device), cells, grad_out)
    row = (5 ^ (9 * 2654435761 % 2**32) ^ (14 * 805459861 % 2**32)) % 256
    assert grad[0, :, 0].nonzero().flatten().tolist() == [row]
    _, grad, _ = value_and_gradients(points, torch.zeros(1, 65536, 1, device=backend.device), cells, grad_out)
    assert grad[0, :, 0].nonzero().flatten().tolist() == [5 + 33 * (9 + 33 * 14)]


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_points_outside_are_clamped(backend, dtype):
    _, table, resolutions = backend.move(*problem())
    outside = torch.tensor([[-0.5, 0.3, 1.5], [2.0, -1.0, 0.5]], dtype=dtype, device=backend.device)
    table = table.to(dtype)
    inside = hash_encode(outside.clamp(0, 1), table, resolutions)
    assert torch.equal(hash_encode(outside, table, resolutions), inside)


def test_the_far_face_reads_no_row_beyond_its_level(backend):
    table = torch.full((2, 64, 1), torch.inf)
    table[0, :, 0] = torch.arange(64)
    points = torch.tensor([[1.0, 1.0, 1.0], [1.0, 0.0, 1.0]])
    out = hash_encode(*backend.move(points, table), torch.tensor([3, 3]))
    assert out[:, 0].tolist() == [63, 51]


def test_continuous_across_cells():
    _, table, resolutions = problem()
    boundary = torch.rand(200, 3, dtype=torch.float64)
    boundary[:, 0] = torch.randint(1, 64, (200,)) / 64
    step = torch.tensor([1e-9, 0, 0], dtype=torch.float64)
    low, high = (hash_encode(boundary + side * step, table.double(), resolutions) for side in (-1, 1))
    torch.testing.assert_close(low, high, rtol=0, atol=1e-5)


def test_same_bits_again_and_on_one_thread(backend):
    count = backend.size(3000, 100)
    case = backend.move(*problem(n=count), torch.randn(count, len(CELLS) * 2))
    assert_same_bits(lambda: value_and_gradients(*case))


def test_no_points_give_no_features_and_no_gradient(backend):
    _, table, resolutions = problem()
    case = backend.move(torch.zeros(0, 3), table, resolutions, torch.zeros(0, 8))
    out, grad, _ = value_and_gradients(*case)
    assert out.shape == (0, 8)
    assert not grad.any()


def test_wrong_input_is_refused():
    points, table, resolutions = problem()
    for words, case in {
        "power of two": (points, table[:, :1000], resolutions),
        "Resolutions must lie": (points, table, resolutions * 0),
        "points must have shape": (points[:, :2], table, resolutions),
        "resolutions must have shape": (points, table, resolutions[:2]),
    }.items():
        with pytest.raises(ValueError, match=words):
            hash_encode(*case)


@pytest.mark.parametrize("value", [float("nan"), float("inf"), -1e30])
def test_points_that_are_nowhere_stay_within_the_table(backend, value):
    """What is no number has no features, and touches no other level's or point's."""
    points, table, resolutions = backend.move(*problem(n=8))
    points[3] = value
    ones = torch.ones(8, 2 * len(CELLS), device=backend.device)
    out, grad, _ = value_and_gradients(points, table, resolutions, ones)
    fine = torch.arange(8) != 3
    expected = reference.encode(points.cpu(), table.cpu(), CELLS)
    torch.testing.assert_close(out.cpu()[fine], expected[fine], rtol=1e-5, atol=1e-5)
    assert grad.shape == table.shape
    if backend.device.type == "cpu" and not backend.interpreted:  # Triton's maximum of NaN and 0 is 0
        torch.testing.assert_close(out, expected, rtol=1e-5, atol=1e-5, equal_nan=True)
