"""Permuted rows: against the plain reference to the bit, and against the permutation as a matrix."""

import numpy as np
import pytest
import scipy.sparse

from lightprobe.kernels import dispatch, permute_rows
from tests.threads import torch_threads


def problem(old=12, new=40, columns=15, permutations=6, seed=0, dtype=np.float32):
    random = np.random.default_rng(seed)
    rows = scipy.sparse.random_array((old, columns), density=0.3, format="csr", dtype=dtype, rng=random)
    source = np.stack([random.permutation(columns) for _ in range(permutations)]).astype(np.int32)
    which, by = random.integers(0, old, new), random.integers(0, permutations, new)
    return rows.indptr, rows.indices, rows.data, which, by, source


@pytest.mark.slow
@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_matches_the_reference(monkeypatch, dtype):
    case = problem(dtype=dtype)
    found = permute_rows(*case)
    monkeypatch.setattr(dispatch, "body_for", lambda device: dispatch.Body.REFERENCE)
    for one, other in zip(found, permute_rows(*case), strict=True):
        assert one.dtype == other.dtype
        assert np.array_equal(one, other)
    assert found[2].dtype == dtype


def test_a_row_is_the_old_one_times_its_permutation():
    start, column, value, which, by, source = problem()
    old = scipy.sparse.csr_array((value, column, start), shape=(12, 15)).toarray()
    begin, index, weight = permute_rows(start, column, value, which, by, source)
    new = scipy.sparse.csr_array((weight, index, begin), shape=(40, 15)).toarray()
    for row in range(40):
        assert np.array_equal(new[row, source[by[row]]], old[which[row]])


def test_no_rows():
    start, column, value, which, by, source = problem()
    begin, index, weight = permute_rows(start, column, value, which[:0], by[:0], source)
    assert begin.tolist() == [0]
    assert len(index) == len(weight) == 0


def test_bits_do_not_depend_on_threads():
    case, results = problem(old=300, new=20_000, columns=100), []
    for count in (1, 2):
        with torch_threads(count):
            results.append(permute_rows(*case))
    for one, two in zip(*results, strict=True):
        assert np.array_equal(one, two)
