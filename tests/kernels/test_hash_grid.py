"""Hash grid: against the plain reference, by gradcheck, bit by bit, and what interpolation must do."""

import pytest
import torch
from torch.autograd import gradcheck

from lightprobe.kernels import hash_encode
from lightprobe.kernels.reference import hash_grid as reference
from tests.threads import torch_threads

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
def test_matches_the_reference(body, features):
    points, table, resolutions = body.move(*problem(features=features))
    grad = torch.randn(len(points), len(CELLS) * features, device=body.device)
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


def test_only_what_is_asked_for_gets_a_gradient(monkeypatch):
    points, table, resolutions = problem(n=5)
    called = []
    for name in ("encode_backward", "encode_backward_to_points"):
        monkeypatch.setattr(reference, name, lambda *_, name=name: called.append(name))
    for one in (0, 1):
        variables = [
            tensor.double().requires_grad_(place == one) for place, tensor in enumerate((points, table))
        ]
        hash_encode(*variables, resolutions).sum().backward()
    assert called == ["encode_backward_to_points", "encode_backward"]


def test_a_clamped_point_does_not_move(body):
    points, table, resolutions = body.move(*problem(n=6))
    points[0, 0], points[1, 2], points[2, 1] = -0.2, 1.3, float("nan")
    grad = torch.ones(6, 2 * len(CELLS), device=body.device)
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


def test_corner_rows_follow_the_paper(body):
    points = (
        torch.tensor([[5.0, 9.0, 14.0]], device=body.device) / 32
    )  # a lattice corner: one row holds all the weight
    grad_out, cells = torch.ones(1, 1, device=body.device), torch.tensor([32])
    _, grad, _ = value_and_gradients(points, torch.zeros(1, 256, 1, device=body.device), cells, grad_out)
    row = (5 ^ (9 * 2654435761 % 2**32) ^ (14 * 805459861 % 2**32)) % 256
    assert grad[0, :, 0].nonzero().flatten().tolist() == [row]
    _, grad, _ = value_and_gradients(points, torch.zeros(1, 65536, 1, device=body.device), cells, grad_out)
    assert grad[0, :, 0].nonzero().flatten().tolist() == [5 + 33 * (9 + 33 * 14)]


@pytest.mark.parametrize("body_dtype", [torch.float32, torch.float64])
def test_points_outside_are_clamped(body, body_dtype):
    _, table, resolutions = body.move(*problem())
    outside = torch.tensor([[-0.5, 0.3, 1.5], [2.0, -1.0, 0.5]], dtype=body_dtype, device=body.device)
    table = table.to(body_dtype)
    assert torch.equal(
        hash_encode(outside, table, resolutions), hash_encode(outside.clamp(0, 1), table, resolutions)
    )


def test_the_far_face_reads_no_row_beyond_its_level(body):
    table = torch.full((2, 64, 1), torch.inf)
    table[0, :, 0] = torch.arange(64)
    out = hash_encode(
        *body.move(torch.tensor([[1.0, 1.0, 1.0], [1.0, 0.0, 1.0]]), table), torch.tensor([3, 3])
    )
    assert out[:, 0].tolist() == [63, 51]


def test_continuous_across_cells():
    _, table, resolutions = problem()
    boundary = torch.rand(200, 3, dtype=torch.float64)
    boundary[:, 0] = torch.randint(1, 64, (200,)) / 64
    step = torch.tensor([1e-9, 0, 0], dtype=torch.float64)
    low, high = (hash_encode(boundary + side * step, table.double(), resolutions) for side in (-1, 1))
    torch.testing.assert_close(low, high, rtol=0, atol=1e-5)


def test_same_bits_again_and_on_one_thread(body):
    count = body.size(3000, 100)
    case = body.move(*problem(n=count), torch.randn(count, len(CELLS) * 2))
    with torch_threads(2):
        first, again = value_and_gradients(*case), value_and_gradients(*case)
    with torch_threads(1):
        alone = value_and_gradients(*case)
    for a, b, c in zip(first, again, alone, strict=True):
        assert torch.equal(a, b)
        assert torch.equal(a, c)


def test_no_points_give_no_features_and_no_gradient(body):
    _, table, resolutions = problem()
    out, grad, _ = value_and_gradients(*body.move(torch.zeros(0, 3), table, resolutions, torch.zeros(0, 8)))
    assert out.shape == (0, 8)
    assert not grad.any()


def test_wrong_input_is_refused():
    points, table, resolutions = problem()
    with pytest.raises(ValueError, match="power of two"):
        hash_encode(points, table[:, :1000], resolutions)
    with pytest.raises(ValueError, match="Resolutions must lie"):
        hash_encode(points, table, resolutions * 0)
    with pytest.raises(ValueError, match="points must have shape"):
        hash_encode(points[:, :2], table, resolutions)
    with pytest.raises(ValueError, match="resolutions must have shape"):
        hash_encode(points, table, resolutions[:2])


@pytest.mark.parametrize("value", [float("nan"), float("inf"), -1e30])
def test_points_that_are_nowhere_stay_within_the_table(body, value):
    """What is no number has no features, and touches no other level's or point's."""
    points, table, resolutions = body.move(*problem(n=8))
    points[3] = value
    out, grad, _ = value_and_gradients(
        points, table, resolutions, torch.ones(8, 2 * len(CELLS), device=body.device)
    )
    fine = torch.arange(8) != 3
    expected = reference.encode(points.cpu(), table.cpu(), CELLS)
    torch.testing.assert_close(out.cpu()[fine], expected[fine], rtol=1e-5, atol=1e-5)
    assert grad.shape == table.shape
    if body.device.type == "cpu" and not body.interpreted:  # Triton's maximum of NaN and 0 is 0
        torch.testing.assert_close(out, expected, rtol=1e-5, atol=1e-5, equal_nan=True)
