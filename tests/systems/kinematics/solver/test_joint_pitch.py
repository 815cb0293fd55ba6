"""The mixture of pitches against integrals over the pitch."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.stats import norm

from crossmodal.systems.kinematics.solver.joint_pitch import (
    PITCHES,
    WIDEST,
    hinge_evidence,
    pitch_evidence,
    pitch_posterior,
)

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
    found = pitch_posterior(mean, variance)
    assert_allclose(found[0], expected_mean, atol=1e-8)
    assert_allclose(found[1], np.sum(p * (PITCH - expected_mean) ** 2), rtol=1e-4)
