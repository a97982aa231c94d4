"""Row gathers and scatters: against the plain reference, by gradcheck, bit by bit, and on wrong input."""

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from torch.autograd import gradcheck

from lightprobe.kernels import gather_rows, scatter_rows, values_at, weighted_gather, weighted_scatter
from lightprobe.kernels.reference import gather as reference
from tests.threads import assert_same_bits


def problem(n=500, k=4, rows=60, channels=3, *, seed=0, index_dtype=torch.int32):
    random = torch.Generator().manual_seed(seed)
    values = torch.randn(rows, channels, generator=random)
    index = torch.randint(0, rows, (n, k), generator=random).to(index_dtype)
    weight = torch.randn(n, k, generator=random)
    return values, index, weight, torch.randn(n, channels, generator=random)


def value_and_gradients(values, index, weight, grad):
    values, weight = values.clone().requires_grad_(), weight.clone().requires_grad_()
    out = weighted_gather(values, index, weight)
    return out.detach(), *torch.autograd.grad(out, (values, weight), grad)


@pytest.mark.parametrize("index_dtype", [torch.int32, torch.int64])
@pytest.mark.parametrize("channels", [1, 3, 16, 80])
def test_weighted_gather_matches_the_reference(backend, channels, index_dtype):
    values, index, weight, grad = backend.move(*problem(channels=channels, index_dtype=index_dtype))
    out, grad_values, grad_weight = value_and_gradients(values, index, weight, grad)
    exact = [x.double() for x in (values, weight, grad)]
    expected = reference.weighted_gather(exact[0], index, exact[1])
    torch.testing.assert_close(out.double(), expected, rtol=1e-5, atol=1e-5)
    expected = reference.scatter_weighted(exact[2], index, exact[1], len(values))
    torch.testing.assert_close(grad_values.double(), expected, rtol=1e-4, atol=1e-4)
    assert torch.equal(weighted_scatter(grad, index, weight, len(values)), grad_values)
    expected = reference.row_products(exact[2], index, exact[0])
    torch.testing.assert_close(grad_weight.double(), expected, rtol=1e-4, atol=1e-4)


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 40), st.integers(0, 5), st.integers(1, 300), st.integers(1, 5), st.integers(0, 99))
def test_gradient_is_the_transpose_at_any_size(n, k, rows, channels, seed):
    values, index, weight, grad = problem(n, k, rows, channels, seed=seed)
    out, grad_values, grad_weight = value_and_gradients(values, index, weight, grad)
    inner = (out * grad).sum()
    torch.testing.assert_close(inner, (grad_values * values).sum(), rtol=1e-3, atol=1e-3)
    torch.testing.assert_close(inner, (grad_weight * weight).sum(), rtol=1e-3, atol=1e-3)


def test_gradients_in_float64():
    values, index, weight, _ = problem(n=7, k=3, rows=5, channels=2)
    values, weight = values.double().requires_grad_(), weight.double().requires_grad_()
    assert gradcheck(lambda v, w: weighted_gather(v, index, w), (values, weight))
    assert gradcheck(lambda v: gather_rows(v, index), (values,))
    assert gradcheck(lambda w: scatter_rows(w, index[:, 0], 9), (weight,))


@pytest.mark.parametrize("shape", [(), (7,), (4, 3), (2, 3, 5), (0,)])
def test_gather_rows_is_indexing_of_any_shape(backend, shape):
    values = torch.randn(11, 3, device=backend.device, requires_grad=True)
    index = torch.randint(0, 11, shape, device=backend.device)
    out = gather_rows(values, index)
    assert torch.equal(out, values[index])
    grad = torch.randn_like(out)
    (found,) = torch.autograd.grad(out, values, grad)
    (expected,) = torch.autograd.grad(values[index], values, grad)
    torch.testing.assert_close(found, expected)


@pytest.mark.parametrize("dtype", [torch.bool, torch.uint8, torch.int64, torch.float32])
def test_values_at_is_indexing_of_any_shape_and_type(dtype):
    values = torch.arange(300).remainder(7).to(dtype)
    index = torch.randint(0, 300, (5, 2, 3), generator=torch.Generator().manual_seed(0))
    assert torch.equal(values_at(values, index), values[index])
    assert torch.equal(values_at(values, index.int()), values[index])
    assert values_at(values, index[:0]).shape == (0, 2, 3)


def test_scatter_rows_is_the_transpose_of_gather_rows(backend):
    values, index, _, grad = backend.move(*problem(k=1))
    index = index[:, 0]
    out = scatter_rows(grad, index, len(values))
    torch.testing.assert_close(out, torch.zeros_like(values).index_add(0, index, grad))
    gathered = (grad * gather_rows(values, index)).sum()
    torch.testing.assert_close((out * values).sum(), gathered, rtol=1e-4, atol=1e-3)
    (found,) = torch.autograd.grad(scatter_rows(grad.requires_grad_(), index, len(values)), grad, values)
    assert torch.equal(found, values[index])


def test_a_sum_keeps_the_digits_of_small_terms(backend):
    """Gradients of very different size meet in different rows of one call."""
    size = 10.0 ** torch.arange(-6, 3).float()
    grad = (size[:, None] * (1 + torch.rand(9, 200))).reshape(-1, 1)
    index = torch.arange(9).repeat_interleave(200)
    out = scatter_rows(*backend.move(grad, index), 9).cpu().double()
    torch.testing.assert_close(out, grad.double().reshape(9, 200).sum(1, keepdim=True), rtol=1e-5, atol=0)


@pytest.mark.parametrize("bad", [torch.nan, torch.inf])
def test_a_broken_gradient_shows(backend, bad):
    grad, index = torch.ones(5, 2), torch.tensor([0, 1, 1, 2, 2])
    grad[3, 1] = bad
    assert not scatter_rows(*backend.move(grad, index), 3)[2, 1].isfinite()


def test_same_bits_again_and_on_one_thread(backend):
    case = backend.move(*problem(n=backend.size(2000, 300), rows=backend.size(900, 90), channels=17))
    assert_same_bits(lambda: value_and_gradients(*case))


@pytest.mark.parametrize("bad", [-1, 60])
def test_an_index_outside_the_rows_is_refused(bad):
    values, index, weight, grad = problem()
    index[3, 2] = bad
    with pytest.raises(IndexError, match=r"must lie in \[0, 60\)"):
        weighted_gather(values, index, weight)
    for call in (
        lambda: gather_rows(values, index),
        lambda: scatter_rows(grad, index[:, 2], 60),
        lambda: weighted_scatter(grad, index, weight, 60),
    ):
        with pytest.raises(IndexError):
            call()


def test_wrong_shapes_and_dtypes_are_refused():
    values, index, weight, _ = problem()
    with pytest.raises(ValueError, match="weight must have shape"):
        weighted_gather(values, index, weight[:, :2])
    with pytest.raises(ValueError, match="index must be int32 or int64"):
        weighted_gather(values, index.float(), weight)
    with pytest.raises(ValueError, match="share a device and a floating dtype"):
        weighted_gather(values, index, weight.double())
    with pytest.raises(ValueError, match="values must have shape"):
        gather_rows(values[:, 0], index)
