"""Sparse products: against the plain reference and SciPy, as each other's transpose, and on wrong input."""

from dataclasses import replace

import numpy as np
import pytest
import scipy.sparse
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from lightprobe.kernels import CompressedRows, permute_rows, sparse_product, sparse_product_transposed
from lightprobe.kernels.reference import sparse as reference
from lightprobe.light.sparse import ChosenRows, SparseOperator
from tests.threads import assert_same_bits


def matrix(rows=70, columns=50, density=0.2, seed=0):
    return scipy.sparse.random_array(
        (rows, columns), density=density, format="csr", dtype=np.float32, rng=np.random.default_rng(seed)
    )


def triples(count, dtype=torch.float32, seed=0):
    return torch.randn(count, 3, generator=torch.Generator().manual_seed(seed), dtype=torch.float64).to(dtype)


def some_rows(operator, count, seed=0):
    random, rows = torch.Generator().manual_seed(seed), operator.forward.start.numel() - 1
    return ChosenRows.of(operator, torch.randint(0, rows, (count,), generator=random))


@pytest.mark.slow
@pytest.mark.parametrize(("dtype", "tolerance"), [(torch.float32, 1e-5), (torch.float64, 1e-13)])
def test_matches_the_reference(dtype, tolerance):
    operator = SparseOperator.build(matrix())
    chosen, x, y = some_rows(operator, 40), triples(50, dtype), triples(40, dtype)
    for rows in (None, chosen.rows):
        found = sparse_product(operator.forward, x, rows)
        assert found.dtype == dtype
        expected = reference.product(operator.forward, x, rows)
        torch.testing.assert_close(found, expected, rtol=tolerance, atol=tolerance)
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
    chosen = some_rows(operator, count, seed)
    x, y = triples(columns, torch.float64), triples(count, torch.float64)
    left, right = (chosen.apply(x) * y).sum(), (x * chosen.adjoint(y)).sum()
    torch.testing.assert_close(left, right, rtol=1e-12, atol=1e-12)


def test_bits_do_not_depend_on_threads():
    operator = SparseOperator.build(matrix(900, 800))
    chosen, x, y = some_rows(operator, 700), triples(800), triples(700)
    assert_same_bits(lambda: (operator.apply(x), chosen.apply(x), chosen.adjoint(y)))


def on(backend, matrix):
    """Return a matrix on a backend's device; only NumPy holds uint16 columns, so the interpreter's are widened."""
    held = SparseOperator.build(matrix, backend.device).forward
    return replace(held, column=held.column.int()) if backend.interpreted else held


@pytest.mark.parametrize("shape", [(70, 50, 0.2), (1, 1, 1.0), (3, 2000, 0.8), (40, 7, 0.02)])
def test_every_backend_gives_the_product(backend, shape):
    rows = matrix(*shape)
    there, x = on(backend, rows), triples(shape[1])
    found = sparse_product(there, *backend.move(x))
    torch.testing.assert_close(found.cpu(), torch.from_numpy(rows @ x.numpy()), rtol=1e-5, atol=1e-4)
    assert torch.equal(found, sparse_product(there, *backend.move(x)))


def test_every_backend_gives_nothing_of_no_entries(backend):
    there = on(backend, scipy.sparse.csr_array((4, 2), dtype=np.float32))
    assert not sparse_product(there, *backend.move(triples(2))).any()


def test_wrong_input_is_refused():
    operator = SparseOperator.build(matrix())
    chosen = some_rows(operator, 4)
    with pytest.raises(ValueError, match="x must have shape"):
        sparse_product(operator.forward, triples(49))
    with pytest.raises(ValueError, match="y must have shape"):
        sparse_product_transposed(operator.forward, triples(5), chosen.rows, chosen.bounds)


def test_an_empty_matrix_is_zero():
    nothing = CompressedRows(torch.zeros(4).int(), torch.zeros(0).int(), torch.zeros(0), 2)
    assert torch.equal(sparse_product(nothing, triples(2)), torch.zeros(3, 3))


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 60), st.integers(1, 30), st.sampled_from([np.float32, np.float64]), st.integers(0, 99))
def test_a_permuted_row_is_the_old_one_times_its_permutation(new, columns, dtype, seed):
    random = np.random.default_rng(seed)
    old = scipy.sparse.random_array((12, columns), density=0.3, format="csr", dtype=dtype, rng=random)
    source = np.stack([random.permutation(columns) for _ in range(6)]).astype(np.int32)
    which, by = random.integers(0, 12, new), random.integers(0, 6, new)
    start, column, value = permute_rows(old.indptr, old.indices, old.data, which, by, source)
    assert value.dtype == dtype
    found = scipy.sparse.csr_array((value, column, start), shape=(new, columns)).toarray()
    for row in range(new):
        assert np.array_equal(found[row, source[by[row]]], old.toarray()[which[row]])
