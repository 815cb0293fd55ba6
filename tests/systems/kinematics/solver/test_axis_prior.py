"""The prior of an axis' place against the mixture written out."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.stats import multivariate_normal

from crossmodal.systems.kinematics.solver.axis_prior import axis_prior

SIGMA = 0.6


@pytest.mark.parametrize("distance", [0.0, 0.3, 3.0, 30.0, 300.0])
def test_it_is_a_mixture_of_normal_distributions(distance: float) -> None:
    scales = SIGMA * np.array([1.0, 4.0, 16.0])
    place = [distance, 0.0]
    log_p = np.array([multivariate_normal(cov=s**2 * np.eye(2)).logpdf(place) for s in scales])
    value, information = axis_prior(distance**2, SIGMA, True)
    p = np.exp(log_p - log_p.max())
    assert_allclose(value, log_p.max() + np.log(p.mean()) + np.log(2.0 * np.pi))
    assert_allclose(information, p @ scales**-2 / p.sum())


def test_the_information_is_that_of_its_gradient() -> None:
    """So that a step along it goes to where the prior is larger."""
    d, e = 2.0, 1e-5
    slope = axis_prior((d + e) ** 2, SIGMA, True)[0] - axis_prior((d - e) ** 2, SIGMA, True)[0]
    assert_allclose(-slope / (2.0 * e), d * axis_prior(d**2, SIGMA, True)[1], rtol=1e-6)


def test_a_near_one_is_a_single_normal_distribution() -> None:
    value, information = axis_prior(4.0, SIGMA, False)
    expected = multivariate_normal(cov=SIGMA**2 * np.eye(2)).logpdf([2.0, 0.0])
    assert_allclose(value, expected + np.log(2.0 * np.pi))
    assert_allclose(information, SIGMA**-2)
