"""Sparse products: against the plain reference and SciPy, as each other's transpose, and on wrong input."""

from dataclasses import replace

import numpy as np
import pytest
import scipy.sparse
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from lightprobe.kernels import CompressedRows, dispatch, sparse_product, sparse_product_transposed
from lightprobe.kernels.reference import sparse as reference
from lightprobe.light.sparse import ChosenRows, SparseOperator
from tests.threads import torch_threads


def matrix(rows=70, columns=50, density=0.2, seed=0):
    return scipy.sparse.random_array(
        (rows, columns), density=density, format="csr", dtype=np.float32, rng=np.random.default_rng(seed)
    )


def triples(count, dtype=torch.float32, seed=0):
    return torch.randn(count, 3, generator=torch.Generator().manual_seed(seed), dtype=torch.float64).to(dtype)


def some_rows(operator, count, seed=0):
    rows = torch.randint(
        0, operator.forward.start.numel() - 1, (count,), generator=torch.Generator().manual_seed(seed)
    )
    return ChosenRows.of(operator, rows)


@pytest.mark.slow
@pytest.mark.parametrize(("dtype", "tolerance"), [(torch.float32, 1e-5), (torch.float64, 1e-13)])
def test_matches_the_reference(dtype, tolerance):
    operator = SparseOperator.build(matrix())
    chosen, x, y = some_rows(operator, 40), triples(50, dtype), triples(40, dtype)
    for rows in (None, chosen.rows):
        found = sparse_product(operator.forward, x, rows)
        assert found.dtype == dtype
        torch.testing.assert_close(
            found, reference.product(operator.forward, x, rows), rtol=tolerance, atol=tolerance
        )
    found = sparse_product_transposed(operator.forward, y, chosen.rows, chosen.bounds)
    expected = reference.product_transposed(operator.forward, y, chosen.rows, chosen.bounds)
    assert found.dtype == dtype
    torch.testing.assert_close(found, expected, rtol=tolerance, atol=tolerance)


def test_the_reference_is_the_product():
    rows, x, y = matrix(), triples(50), triples(70)
    operator = SparseOperator.build(rows)
    every = ChosenRows.of(operator, torch.arange(70))
    product = reference.product(operator.forward, x, None)
    torch.testing.assert_close(product, torch.from_numpy(rows @ x.numpy()), rtol=1e-5, atol=1e-5)
    transposed = reference.product_transposed(operator.forward, y, every.rows, every.bounds)
    torch.testing.assert_close(transposed, torch.from_numpy(rows.T @ y.numpy()), rtol=1e-5, atol=1e-5)


@settings(max_examples=30, deadline=None)
@given(st.integers(1, 60), st.integers(1, 60), st.floats(0, 1), st.integers(0, 80), st.integers(0, 99))
def test_the_products_are_each_other_s_transpose_at_any_size(rows, columns, density, count, seed):
    operator = SparseOperator.build(matrix(rows, columns, density, seed))
    chosen, x, y = (
        some_rows(operator, count, seed),
        triples(columns, torch.float64),
        triples(count, torch.float64),
    )
    left, right = (chosen.apply(x) * y).sum(), (x * chosen.adjoint(y)).sum()
    torch.testing.assert_close(left, right, rtol=1e-12, atol=1e-12)


def test_wide_columns_need_no_uint16():
    operator = SparseOperator.build(matrix(5, 1 << 17, 1e-3))
    assert operator.forward.column.dtype == torch.int32
    x = triples(1 << 17)
    torch.testing.assert_close(
        operator.apply(x), reference.product(operator.forward, x, None), rtol=1e-4, atol=1e-4
    )


def test_bits_do_not_depend_on_threads():
    operator = SparseOperator.build(matrix(900, 800))
    chosen, x, y = some_rows(operator, 700), triples(800), triples(700)
    results = []
    for count in (1, 2):
        with torch_threads(count):
            results.append((operator.apply(x), chosen.apply(x), chosen.adjoint(y)))
    for one, two in zip(*results, strict=True):
        assert torch.equal(one, two)


def test_elsewhere_the_reference_serves(monkeypatch):
    operator, x = SparseOperator.build(matrix()), triples(50)
    here = sparse_product(operator.forward, x)
    monkeypatch.setattr(dispatch, "body_for", lambda device: dispatch.Body.REFERENCE)
    torch.testing.assert_close(sparse_product(operator.forward, x), here, rtol=1e-5, atol=1e-5)


def on(body, matrix):
    """Return a matrix on a body's device; only NumPy holds uint16 columns, so the interpreter's are widened."""
    held = SparseOperator.build(matrix, body.device).forward
    return replace(held, column=held.column.int()) if body.interpreted else held


@pytest.mark.parametrize("shape", [(70, 50, 0.2), (1, 1, 1.0), (3, 2000, 0.8), (40, 7, 0.02)])
def test_every_body_gives_the_product(body, shape):
    rows = matrix(*shape)
    there, x = on(body, rows), triples(shape[1])
    found = sparse_product(there, *body.move(x))
    torch.testing.assert_close(found.cpu(), torch.from_numpy(rows @ x.numpy()), rtol=1e-5, atol=1e-4)
    assert torch.equal(found, sparse_product(there, *body.move(x)))


def test_every_body_gives_nothing_of_no_entries(body):
    there = on(body, scipy.sparse.csr_array((4, 2), dtype=np.float32))
    assert not sparse_product(there, *body.move(triples(2))).any()


def test_wrong_input_is_refused():
    operator = SparseOperator.build(matrix())
    chosen = some_rows(operator, 4)
    with pytest.raises(ValueError, match="x must have shape"):
        sparse_product(operator.forward, triples(49))
    with pytest.raises(ValueError, match="y must have shape"):
        sparse_product_transposed(operator.forward, triples(5), chosen.rows, chosen.bounds)


def test_an_empty_matrix_is_zero():
    nothing = CompressedRows(
        torch.zeros(4, dtype=torch.int32), torch.zeros(0, dtype=torch.int32), torch.zeros(0), 2
    )
    assert torch.equal(sparse_product(nothing, triples(2)), torch.zeros(3, 3))
