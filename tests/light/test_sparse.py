"""A sparse matrix on radiance triples: its products, what it stores, and how chosen rows are parted."""

import numpy as np
import pytest
import scipy.sparse
import torch

from lightprobe.light.sparse import PARTS, ChosenRows, SparseOperator

DENSE = np.array([[0, 2, 0, 1], [3, 0, 0, 0], [0, 0, 0, 5]], np.float64)
LIGHT = torch.tensor([[1.0, 10, 100], [2, 20, 200], [3, 30, 300], [4, 40, 400]])


def test_products_are_those_of_the_matrix_and_its_transpose() -> None:
    operator = SparseOperator.build(scipy.sparse.csr_array(DENSE))
    assert operator.apply(LIGHT)[:, 0].tolist() == [8, 3, 20]
    assert torch.equal(operator.apply(LIGHT)[:, 2], 100 * operator.apply(LIGHT)[:, 0])
    back = operator.adjoint(torch.tensor([[1.0, 0, 2], [10, 0, 0], [100, 1, 0]]))
    assert back.tolist() == [[30, 0, 0], [2, 0, 4], [0, 0, 0], [501, 5, 2]]
    again = operator.matrix()
    assert (again.shape, again.dtype, again.indices.dtype) == ((3, 4), np.float32, np.int32)
    assert np.array_equal(again.toarray(), DENSE)


def test_rows_keep_the_order_of_their_entries_and_those_of_the_transpose_are_sorted() -> None:
    start, column, value = np.array([0, 2, 4]), np.array([2, 0, 1, 0]), np.array([7.0, 5, 3, 2])
    operator = SparseOperator.build(scipy.sparse.csr_array((value, column, start), shape=(2, 3)))
    assert operator.forward.column.tolist() == [2, 0, 1, 0]
    assert operator.forward.value.tolist() == [7, 5, 3, 2]
    turned = operator.transpose
    assert (turned.columns, turned.start.tolist(), turned.column.tolist()) == (2, [0, 2, 3, 4], [0, 1, 1, 0])
    assert turned.value.tolist() == [5, 2, 3, 7]


@pytest.mark.parametrize(("columns", "kind"), [(1 << 16, torch.uint16), ((1 << 16) + 1, torch.int32)])
def test_columns_are_stored_in_two_bytes_where_they_fit(columns: int, kind: torch.dtype) -> None:
    matrix = scipy.sparse.csr_array(([2.0], ([0], [columns - 1])), shape=(1, columns))
    operator = SparseOperator.build(matrix)
    assert operator.forward.column.dtype == kind
    light = torch.zeros(columns, 3)
    light[-1] = torch.tensor([1.0, 2.0, 3.0])
    assert operator.apply(light).tolist() == [[2, 4, 6]]


def test_chosen_rows_come_in_their_order_and_as_often_as_they_are_named() -> None:
    chosen = ChosenRows.of(SparseOperator.build(scipy.sparse.csr_array(DENSE)), torch.tensor([2, 0, 2]))
    assert chosen.apply(LIGHT)[:, 1].tolist() == [200, 80, 200]
    back = chosen.adjoint(torch.tensor([[1.0, 0, 0], [10, 0, 0], [100, 0, 1]]))
    assert back.tolist() == [[0, 0, 0], [20, 0, 0], [0, 0, 0], [515, 0, 5]]


@pytest.mark.parametrize(
    ("count", "bounds"),
    [
        (0, [0, 0]),
        (15, [0, 15]),
        (16, [0, 7, 16]),
        (64, [0, 12, 25, 38, 51, 64]),
        (200, [0, 24, 49, 74, 99, 124, 149, 174, 200]),
    ],
)
def test_every_65536_entries_are_a_part_of_their_own_up_to_eight(count: int, bounds: list[int]) -> None:
    wide = SparseOperator.build(scipy.sparse.csr_array(np.ones((1, 4096), np.float32)))
    assert PARTS == 8
    chosen = ChosenRows.of(wide, torch.zeros(count, dtype=torch.int64))
    assert chosen.bounds.tolist() == bounds
    assert chosen.bounds.dtype == np.int32
    assert chosen.rows.dtype == torch.int32
    assert torch.equal(chosen.adjoint(torch.ones(count, 3)), torch.full((4096, 3), float(count)))


def test_parts_hold_about_as_many_entries_where_rows_differ() -> None:
    filled = np.tri(512, dtype=np.float32)  # row k has k + 1 entries
    chosen = ChosenRows.of(SparseOperator.build(scipy.sparse.csr_array(filled)), torch.arange(512))
    entries = [int(part.sum()) for part in np.split(np.arange(1, 513), chosen.bounds[1:-1])]
    assert len(entries) == 3
    assert max(entries) - min(entries) < 2 * 512
