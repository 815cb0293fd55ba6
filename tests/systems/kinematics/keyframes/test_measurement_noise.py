"""Scale and correlation of the noise against streams of which they are known."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from crossmodal.maths import se3
from crossmodal.systems.kinematics.keyframes.measurement_noise import (
    UNKNOWN,
    MeasurementNoise,
    correlations,
    inflation,
    initial_noise,
    mean_covariance,
    observe,
)

REPORTED = np.diag(np.repeat([1e-4, 1e-6], 3))
SCALE = np.repeat([0.01, 0.003], 3)


def _scale(
    factors: tuple[float, float],
    outliers: float = 0.0,
    is_specified: bool = False,
    covariance: np.ndarray = REPORTED,
) -> MeasurementNoise:
    """After 10 s of a body that turns and moves evenly."""
    rng, n = np.random.default_rng(0), initial_noise()
    sigma = np.repeat(factors, 3) * np.sqrt(np.diag(REPORTED))
    twist = np.array([0.0, 0.3, 0.0, 0.1, 0.0, 0.0])
    for k in range(150):
        error = sigma * rng.normal(size=6)
        if rng.random() < outliers:
            error += np.repeat([0.2, 0.05], 3) * rng.choice([-1.0, 1.0], size=6)
        observe(n, se3.exp(twist * k / 15.0) @ se3.exp(error), covariance, k / 15.0, is_specified)
    return n


@pytest.mark.parametrize("factors", [(1.0, 1.0), (3.0, 3.0), (0.3, 0.3), (0.5, 4.0)])
def test_rotation_and_translation_have_their_own_scale(factors: tuple[float, float]) -> None:
    assert_allclose(np.sqrt(_scale(factors).variance), factors, rtol=0.15)


def test_outliers_hardly_widen_it() -> None:
    assert_allclose(np.sqrt(_scale((1.0, 1.0), outliers=0.1).variance), 1.0, rtol=0.5)


def test_where_errors_are_correlated_it_is_never_below_what_is_reported() -> None:
    assert (_scale((0.1, 0.1), is_specified=True).variance >= 1.0).all()


def test_what_was_not_measured_has_the_scale_that_is_reported() -> None:
    covariance = np.diag(np.repeat([UNKNOWN, 1e-6], 3))
    found = _scale((3.0, 3.0), covariance=covariance).variance
    assert found[0] == 1.0
    assert_allclose(np.sqrt(found[1]), 3.0, rtol=0.3)


def test_before_anything_is_known_what_is_reported_holds() -> None:
    assert_allclose(initial_noise().variance, 1.0)


@pytest.mark.parametrize(("factor", "outliers"), [(1.0, 4), (1.0, 0), (6.0, 0)])
def test_a_bad_start_is_told_from_a_noise_that_is_larger(factor: float, outliers: int) -> None:
    """Of 17 poses every fourth is an outlier, so that most differences are with one."""
    rng, n = np.random.default_rng(3), initial_noise()
    for k in range(17):
        error = factor * np.sqrt(np.diag(REPORTED)) * rng.normal(size=6)
        if k % 4 == 2 and k // 4 < outliers:
            error += np.repeat([0.2, 0.05], 3) * rng.choice([-1.0, 1.0], size=6)
        observe(n, se3.exp(error), REPORTED, k / 15.0, False)
    assert_allclose(np.sqrt(n.variance), factor, rtol=0.4)


def _correlated(r: float, size: float, seed: int, frames: int = 200) -> tuple[np.ndarray, float]:
    """Estimated correlations (2,) of a hinge's poses and the true scale's square of neighbours.

    The hinge turns ever faster; errors are `size` times what is reported.
    """
    rng, n = np.random.default_rng(seed), initial_noise()
    error = rng.normal(size=6)
    radius = np.eye(4)
    radius[:3, 3] = (0.4, 0.0, 0.1)
    for k in range(frames):
        error = r * error + np.sqrt(1.0 - r * r) * rng.normal(size=6)
        turn = se3.exp(np.array([0.0, 0.0, 2e-5 * k**2, 0.0, 0.0, 0.0]))
        X = turn @ radius @ se3.exp(size * SCALE * error)
        observe(n, X, np.diag(SCALE**2), k / 15.0, False)
    neighbours = size**2 * (1.5 - 2.0 * r + 0.5 * r**2) / 1.5
    n.variance[:] = neighbours
    return correlations(n), neighbours


@pytest.mark.parametrize("r", [0.6, 0.8, 0.9])
def test_the_correlation_is_found_sideways_to_the_motion(r: float) -> None:
    found = np.array([_correlated(r, 1.0, seed)[0] for seed in range(20)])
    assert abs(np.median(found) - r) < 0.12
    assert found.max() <= r + 1e-6  # No larger than the reported errors allow.


@pytest.mark.parametrize("size", [0.2, 1.0, 2.0])
def test_white_noise_has_none(size: float) -> None:
    assert_allclose([_correlated(0.0, size, seed)[0] for seed in range(20)], 0.0)


def test_the_inflation_makes_the_neighbours_scale_that_of_a_long_average() -> None:
    for r in (0.0, 0.5, 0.9):
        neighbours = _correlated(r, 1.0, 0)[1]
        assert_allclose(neighbours * inflation(np.array([r])), (1.0 + r) / (1.0 - r))


def test_no_correlation_is_looked_for_beside_a_specified_one() -> None:
    rng, n = np.random.default_rng(0), initial_noise()
    for k in range(50):
        observe(n, se3.exp(SCALE * rng.normal(size=6)), np.diag(SCALE**2), k / 15.0, True)
    assert n.compared[0] == 0.0


def test_covariances_are_averaged_by_their_information() -> None:
    exact, vague = np.diag(np.full(6, 1e-6)), np.diag(np.full(6, 1e4))
    mean = mean_covariance(np.zeros((6, 6)), 0, exact)
    assert_allclose(mean, exact)
    mean = mean_covariance(mean, 1, vague)
    assert_allclose(mean, 2.0 * exact, rtol=1e-6)
    assert_allclose(mean_covariance(mean, 2, 2.0 * exact), 2.0 * exact, rtol=1e-6)
