"""What error-state filters do with their covariance, against closed forms."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from crossmodal.maths import error_state
from crossmodal.maths.arrays import Array
from crossmodal.maths.gaussian import joseph_update

PART = slice(2, 5)


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(4)


def covariance(rng: np.random.Generator, n: int) -> Array:
    A = rng.normal(size=(n, n))
    return np.asarray(A @ A.T + 0.1 * np.eye(n))


def is_positive_definite(P: Array) -> bool:
    assert_allclose(P, P.T, atol=1e-12)
    return bool(np.linalg.eigvalsh(P).min() > 0.0)


def test_a_part_is_propagated_as_by_the_whole_jacobian(rng: np.random.Generator) -> None:
    P, F = covariance(rng, 7), rng.normal(size=(3, 3))
    whole = np.eye(7)
    whole[PART, PART] = F
    assert_allclose(error_state.propagate(P, PART, F), whole @ P @ whole.T, rtol=1e-12)


def test_noise_adds_to_its_part_alone(rng: np.random.Generator) -> None:
    P, Q = covariance(rng, 7), covariance(rng, 3)
    change = error_state.inflate(P, PART, Q) - P
    assert_allclose(change[PART, PART], Q)
    change[PART, PART] = 0.0
    assert_array_equal(change, 0.0)


def test_a_gauss_markov_process_keeps_its_variance_and_forgets_exponentially() -> None:
    x, P = np.ones(5), np.eye(5)
    P[0, 2] = P[2, 0] = 0.5
    for _ in range(10):
        x, P = error_state.fade(x, P, PART, np.exp(-0.1))
    assert_allclose(x, [1.0, 1.0, *np.exp([-1.0] * 3)])
    assert_allclose(np.diag(P), 1.0)
    assert_allclose(P[0, 2], 0.5 * np.exp(-1.0))


def test_without_any_share_it_is_back_at_its_prior(rng: np.random.Generator) -> None:
    x, P = error_state.fade(np.ones(7), covariance(rng, 7), PART, 0.0)
    assert_array_equal(x[PART], 0.0)
    assert_array_equal(P[PART, PART], np.eye(3))
    assert_array_equal(P[PART, :2], 0.0)
    assert is_positive_definite(P)


def test_a_reset_part_is_independent_of_the_others(rng: np.random.Generator) -> None:
    P, own = covariance(rng, 7), covariance(rng, 3)
    after = error_state.reset(P, PART, own)
    assert_array_equal(after[PART, PART], own)
    assert_array_equal(after[5:, PART], 0.0)
    assert_array_equal(after[:2, 5:], P[:2, 5:])
    assert is_positive_definite(after)


def test_new_states_that_are_a_function_of_old_ones_come_and_go(rng: np.random.Generator) -> None:
    P, J, R = covariance(rng, 7), rng.normal(size=(2, 7)), covariance(rng, 2)
    grown = error_state.augment(P, J @ P, J @ P @ J.T + R)
    whole = np.vstack([np.eye(7), J])
    noise = np.zeros((9, 9))
    noise[7:, 7:] = R
    assert_allclose(grown, whole @ P @ whole.T + noise)
    assert is_positive_definite(grown)
    assert_array_equal(error_state.remove(grown, np.arange(9) < 7), P)


def test_a_correction_agrees_with_the_joseph_form(rng: np.random.Generator) -> None:
    P, H, R = covariance(rng, 7), rng.normal(size=(3, 7)), covariance(rng, 3)
    e = rng.normal(size=3)
    correction, posterior = error_state.update(P, H @ P, H @ P @ H.T + R, e)
    expected = joseph_update(P, H, R, e)
    assert_allclose(correction, expected[0], rtol=1e-9)
    assert_allclose(posterior, expected[1], rtol=1e-9, atol=1e-12)


def test_covariances_stay_positive_definite_over_many_steps(rng: np.random.Generator) -> None:
    P, x = covariance(rng, 7), np.zeros(7)
    for k in range(500):
        P = error_state.propagate(P, PART, np.eye(3) + 0.1 * rng.normal(size=(3, 3)))
        P = error_state.inflate(P, PART, 1e-3 * np.eye(3))
        x, P = error_state.fade(x, P, slice(5, 7), 0.9)
        H, R = rng.normal(size=(2, 7)), 1e-4 * np.eye(2)
        _, P = error_state.update(P, H @ P, H @ P @ H.T + R, np.zeros(2))
        if k % 50 == 0:
            P = error_state.reset(P, slice(0, 2), np.eye(2))
        assert is_positive_definite(P)


def test_arguments_stay_as_they_are(rng: np.random.Generator) -> None:
    P = covariance(rng, 7)
    before = P.copy()
    error_state.propagate(P, PART, np.zeros((3, 3)))
    error_state.inflate(P, PART, np.eye(3))
    error_state.fade(np.ones(7), P, PART, 0.5)
    error_state.reset(P, PART, 0.0)
    error_state.augment(P, np.ones((1, 7)), np.eye(1))
    error_state.update(P, P[:1], P[:1, :1] + 1.0, np.ones(1))
    assert_array_equal(P, before)
