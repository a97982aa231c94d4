"""What is measured does the work that it stands for."""

import numpy as np
import scipy.sparse

import measure_batches


def test_the_wide_product_is_the_product():
    rng = np.random.default_rng(0)
    matrix = scipy.sparse.random_array((30, 20), density=0.3, format="csr", dtype=np.float32, rng=rng)
    x, out = rng.random((20, 8), np.float32), np.full((30, 8), 7, np.float32)
    measure_batches.wide_product(matrix.indptr, matrix.indices, matrix.data, x, out)
    np.testing.assert_allclose(out, matrix @ x, rtol=1e-5)


def test_a_run_that_is_none_is_told(capsys, tmp_path):
    assert measure_batches.main([str(tmp_path)]) == 2
    assert "not a run folder" in capsys.readouterr().err
