"""The noise's scale against streams whose noise is known."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from crossmodal.maths import se3
from crossmodal.systems.kinematics.keyframes.noise_scale import (
    UNKNOWN,
    NoiseScale,
    initial_noise_scale,
    observe,
)

CLAIMED = np.diag(np.repeat([1e-4, 1e-6], 3))


def _scale(
    factors: tuple[float, float],
    outliers: float = 0.0,
    least: float = 0.0,
    covariance: np.ndarray = CLAIMED,
) -> NoiseScale:
    """After 10 s of a body that turns and moves evenly."""
    rng, n = np.random.default_rng(0), initial_noise_scale()
    sigma = np.repeat(factors, 3) * np.sqrt(np.diag(CLAIMED))
    twist = np.array([0.0, 0.3, 0.0, 0.1, 0.0, 0.0])
    for k in range(150):
        error = sigma * rng.normal(size=6)
        if rng.random() < outliers:
            error += np.repeat([0.2, 0.05], 3) * rng.choice([-1.0, 1.0], size=6)
        observe(n, se3.exp(twist * k / 15.0) @ se3.exp(error), covariance, k / 15.0, least)
    return n


@pytest.mark.parametrize("factors", [(1.0, 1.0), (3.0, 3.0), (0.3, 0.3), (0.5, 4.0)])
def test_rotation_and_translation_have_their_own_scale(factors: tuple[float, float]) -> None:
    assert_allclose(np.sqrt(_scale(factors).variance), factors, rtol=0.15)


def test_outliers_hardly_widen_it() -> None:
    assert_allclose(np.sqrt(_scale((1.0, 1.0), outliers=0.1).variance), 1.0, rtol=0.5)


def test_where_errors_are_correlated_it_is_never_below_the_claim() -> None:
    assert (_scale((0.1, 0.1), least=1.0).variance >= 1.0).all()


def test_what_was_not_measured_has_the_scale_that_is_claimed() -> None:
    covariance = np.diag(np.repeat([UNKNOWN, 1e-6], 3))
    found = _scale((3.0, 3.0), covariance=covariance).variance
    assert found[0] == 1.0
    assert_allclose(np.sqrt(found[1]), 3.0, rtol=0.3)


def test_before_anything_is_known_the_claim_holds() -> None:
    assert_allclose(initial_noise_scale().variance, 1.0)


@pytest.mark.parametrize(("factor", "outliers"), [(1.0, 4), (1.0, 0), (6.0, 0)])
def test_a_bad_start_is_told_from_a_noise_that_is_larger(factor: float, outliers: int) -> None:
    """Of 17 poses every fourth is an outlier, so that most differences are with one."""
    rng, n = np.random.default_rng(3), initial_noise_scale()
    for k in range(17):
        error = factor * np.sqrt(np.diag(CLAIMED)) * rng.normal(size=6)
        if k % 4 == 2 and k // 4 < outliers:
            error += np.repeat([0.2, 0.05], 3) * rng.choice([-1.0, 1.0], size=6)
        observe(n, se3.exp(error), CLAIMED, k / 15.0, 0.0)
    assert_allclose(np.sqrt(n.variance), factor, rtol=0.4)
