"""Small factors against NumPy."""

import numpy as np
from numpy.testing import assert_allclose

from crossmodal.maths import cholesky


def _spd(n: int) -> np.ndarray:
    A = np.random.default_rng(n).normal(size=(n, n))
    return A @ A.T + np.eye(n)


def test_factor_and_log_determinant_agree_with_numpy_and_read_the_lower_triangle_only() -> None:
    for n in (1, 6, 10):
        A = _spd(n)
        L = np.full((12, 12), np.nan)
        L[:n, :n] = np.tril(A) + np.triu(np.full((n, n), np.nan), 1)
        log_determinant = cholesky.factor(L, n)
        assert_allclose(np.tril(L[:n, :n]), np.linalg.cholesky(A))
        assert_allclose(log_determinant, np.linalg.slogdet(A)[1])


def test_forward_and_backward_solve_the_system_and_inverse_is_symmetric() -> None:
    A, b = _spd(10), np.arange(10.0)
    L, x, inverse = A.copy(), b.copy(), np.empty((10, 10))
    cholesky.factor(L, 10)
    cholesky.forward(L, x, 10)
    cholesky.backward(L, x, 10)
    assert_allclose(A @ x, b, atol=1e-12)
    cholesky.inverse(L, inverse, 10)
    assert_allclose(inverse @ A, np.eye(10), atol=1e-12)
    assert_allclose(inverse, inverse.T, atol=0.0)


def test_an_indefinite_matrix_gives_nan() -> None:
    assert np.isnan(cholesky.factor(np.array([[1.0, 0.0], [2.0, 1.0]]), 2))
