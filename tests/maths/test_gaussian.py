"""Corrections and likelihoods against closed forms."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.stats import chi2, multivariate_normal

from crossmodal.maths.gaussian import (
    chi_square_gate,
    joseph_update,
    log_likelihood,
    nees,
    schmidt_update,
)


def _spd(rng: np.random.Generator, n: int) -> np.ndarray:
    A = rng.normal(size=(n, n))
    return A @ A.T + 0.1 * np.eye(n)


@pytest.mark.parametrize(("n", "m"), [(1, 1), (6, 3), (12, 6)])
def test_joseph_update_agrees_with_the_information_form(n: int, m: int) -> None:
    rng = np.random.default_rng(n)
    P, R, H, e = _spd(rng, n), _spd(rng, m), rng.normal(size=(m, n)), rng.normal(size=m)
    dx, posterior = joseph_update(P, H, R, e)
    expected = np.linalg.inv(np.linalg.inv(P) + H.T @ np.linalg.inv(R) @ H)
    assert_allclose(posterior, expected, atol=1e-9)
    assert_allclose(dx, expected @ H.T @ np.linalg.solve(R, e), atol=1e-9)


def test_a_considered_state_is_not_corrected_and_its_error_is_accounted_for() -> None:
    rng = np.random.default_rng(2)
    P, R, H = _spd(rng, 5), _spd(rng, 2), rng.normal(size=(2, 5))
    considered = np.array([False, False, True, False, True])
    _, posterior = schmidt_update(P, H, R, np.zeros(2), considered)
    assert_allclose(posterior[np.ix_(considered, considered)], P[np.ix_(considered, considered)])
    draws = 200_000
    x = rng.multivariate_normal(np.zeros(5), P, draws)
    z = x @ H.T + rng.multivariate_normal(np.zeros(2), R, draws)
    gain = np.array([schmidt_update(P, H, R, e, considered)[0] for e in np.eye(2)])
    assert_allclose(gain[:, considered], 0.0)
    assert_allclose(np.cov((x - z @ gain).T), posterior, atol=0.02 * np.abs(P).max())


def test_posterior_stays_symmetric_positive_definite_over_many_exact_measurements() -> None:
    rng = np.random.default_rng(0)
    P = np.eye(6) * 1e4
    for _ in range(1000):
        _, P = joseph_update(P, rng.normal(size=(2, 6)), 1e-8 * np.eye(2), np.zeros(2))
    assert_allclose(P, P.T, atol=0.0)
    assert np.linalg.eigvalsh(P).min() > 0.0


def test_log_likelihood_is_the_normal_density() -> None:
    rng = np.random.default_rng(1)
    S, e = _spd(rng, 6), rng.normal(size=6)
    assert_allclose(log_likelihood(e, S), multivariate_normal(cov=S).logpdf(e))
    assert_allclose(nees(e, S), e @ np.linalg.inv(S) @ e)


@pytest.mark.parametrize(("exceeded", "dof"), [(0.001, 3), (0.001, 6), (0.05, 3)])
def test_a_gate_is_a_quantile_of_the_chi_square_distribution(exceeded: float, dof: int) -> None:
    assert_allclose(chi_square_gate(exceeded, dof), chi2.isf(exceeded, dof), atol=5e-3)
