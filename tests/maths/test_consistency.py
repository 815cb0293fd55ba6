"""Shares of errors inside their bounds."""

import numpy as np
from numpy.testing import assert_allclose
from scipy.stats import chi2

from crossmodal.maths.consistency import (
    chi_square_bounds,
    chi_square_quantile,
    is_consistent,
    normalised_squared_error,
    share_inside,
)

P = np.array([[4.0, 1.0], [1.0, 2.0]])


def test_errors_drawn_from_their_covariance_are_inside_as_often_as_the_bounds_say() -> None:
    errors = np.random.default_rng(0).multivariate_normal(np.zeros(2), P, 4000)
    values = np.array([normalised_squared_error(e, P) for e in errors])
    assert_allclose(np.mean(values), 2.0, atol=0.1)
    assert_allclose(share_inside(values, 2), 0.95, atol=0.015)
    low, high = chi_square_bounds(2, 0.5)
    assert_allclose(np.mean((values > low) & (values < high)), 0.5, atol=0.03)
    assert np.mean([is_consistent(e, P) for e in errors]) == share_inside(values, 2)


def test_the_quantile_is_that_of_scipy_stats() -> None:
    for degrees in (1, 2, 6):
        for probability in (0.025, 0.9545, 0.975):
            assert_allclose(
                chi_square_quantile(probability, degrees), chi2.ppf(probability, degrees), 1e-14
            )


def test_a_covariance_that_is_not_positive_definite_is_never_consistent() -> None:
    assert normalised_squared_error(np.array([0.1]), np.array([[0.0]])) == np.inf
    assert share_inside(np.array([np.inf, 1.0]), 1) == 0.5
    assert np.isnan(share_inside(np.zeros(0), 1))
