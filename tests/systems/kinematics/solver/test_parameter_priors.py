"""The priors of an axis' place and of a pitch against their mixtures written out."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.stats import multivariate_normal, norm

from crossmodal.systems.kinematics.solver.parameter_priors import (
    PITCHES,
    WIDEST,
    axis_prior,
    hinge_evidence,
    pitch_evidence,
    pitch_posterior,
)

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


PITCH = np.linspace(-1.0, 1.0, 2_000_001)


@pytest.mark.parametrize(("pitch", "sigma"), [(0.0, 1e-3), (2e-3, 1e-3), (-0.05, 0.004), (0, 0.2)])
def test_evidence_and_posterior_are_those_of_the_mixture(pitch: float, sigma: float) -> None:
    likelihood = norm.pdf(PITCH, pitch, sigma)
    mixture = np.average([norm.pdf(PITCH, 0.0, s) for s in PITCHES], axis=0, weights=[4, 2, 1])
    widest = norm.pdf(PITCH, 0.0, WIDEST)
    hinge = norm.pdf(PITCH, 0.0, 3e-4)
    # What the solution with the widest prior says.
    variance = 1.0 / (1.0 / sigma**2 + 1.0 / WIDEST**2)
    mean = variance * pitch / sigma**2
    expected = np.log(np.sum(likelihood * mixture) / np.sum(likelihood * widest))
    assert_allclose(pitch_evidence(mean, variance), expected, atol=1e-6)
    expected = np.log(np.sum(likelihood * hinge) / np.sum(likelihood * mixture))
    assert_allclose(hinge_evidence(mean, variance, 3e-4), expected, atol=1e-6)
    p = likelihood * mixture / np.sum(likelihood * mixture)
    expected_mean = np.sum(p * PITCH)
    weights, means, variances = pitch_posterior(mean, variance).T
    assert_allclose(weights.sum(), 1.0)
    assert_allclose(weights @ means, expected_mean, atol=1e-8)
    expected = np.sum(p * (PITCH - expected_mean) ** 2)
    assert_allclose(weights @ (variances + (means - expected_mean) ** 2), expected, rtol=1e-4)
    density = np.sum(weights * norm.pdf(PITCH[::5000, None], means, np.sqrt(variances)), axis=1)
    assert_allclose(density, p[::5000] / (PITCH[1] - PITCH[0]), atol=1e-3 * density.max())
