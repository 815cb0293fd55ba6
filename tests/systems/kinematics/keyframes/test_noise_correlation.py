"""The correlation of a stream's errors, against streams of which it is known."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from crossmodal.maths import se3
from crossmodal.systems.kinematics.keyframes.noise_correlation import (
    correlations,
    inflation,
    initial_noise_correlation,
    observe_correlation,
)
from crossmodal.systems.kinematics.keyframes.noise_scale import mean_claim

SCALE = np.repeat([0.01, 0.003], 3)


def _seen(r: float, size: float, seed: int, frames: int = 200) -> tuple[np.ndarray, float]:
    """Estimated correlations (2,) of a hinge's poses and the true scale's square of neighbours.

    The hinge turns ever faster; errors are `size` times what is claimed.
    """
    rng, n = np.random.default_rng(seed), initial_noise_correlation()
    error = rng.normal(size=6)
    radius = np.eye(4)
    radius[:3, 3] = (0.4, 0.0, 0.1)
    for k in range(frames):
        error = r * error + np.sqrt(1.0 - r * r) * rng.normal(size=6)
        turn = se3.exp(np.array([0.0, 0.0, 2e-5 * k**2, 0.0, 0.0, 0.0]))
        X = turn @ radius @ se3.exp(size * SCALE * error)
        observe_correlation(n, X, np.diag(SCALE**2), k / 15.0)
    neighbours = size**2 * (1.5 - 2.0 * r + 0.5 * r**2) / 1.5
    return correlations(n, np.full(2, neighbours)), neighbours


@pytest.mark.parametrize("r", [0.6, 0.8, 0.9])
def test_the_correlation_is_found_sideways_to_the_motion(r: float) -> None:
    found = np.array([_seen(r, 1.0, seed)[0] for seed in range(20)])
    assert abs(np.median(found) - r) < 0.12
    assert found.max() <= r + 1e-6  # No larger than the claimed errors allow.


@pytest.mark.parametrize("size", [0.2, 1.0, 2.0])
def test_white_noise_has_none(size: float) -> None:
    assert_allclose([_seen(0.0, size, seed)[0] for seed in range(20)], 0.0)


def test_the_inflation_makes_the_neighbours_scale_that_of_a_long_average() -> None:
    for r in (0.0, 0.5, 0.9):
        neighbours = _seen(r, 1.0, 0)[1]
        assert_allclose(neighbours * inflation(np.array([r])), (1.0 + r) / (1.0 - r))


def test_claims_are_averaged_by_their_information() -> None:
    exact, vague = np.diag(np.full(6, 1e-6)), np.diag(np.full(6, 1e4))
    claim = mean_claim(np.zeros((6, 6)), 0, exact)
    assert_allclose(claim, exact)
    claim = mean_claim(claim, 1, vague)
    assert_allclose(claim, 2.0 * exact, rtol=1e-6)
    assert_allclose(mean_claim(claim, 2, 2.0 * exact), 2.0 * exact, rtol=1e-6)
