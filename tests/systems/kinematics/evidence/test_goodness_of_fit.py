"""The goodness of fit: inside its bounds where the type is right, beyond where it is not."""

import numpy as np
import pytest
from synthetic_motion import RATE, Scene, filter_states, simulate, to_and_fro

from crossmodal.maths import se3
from crossmodal.systems.kinematics.evidence.goodness_of_fit import (
    largest_probability,
    reduced_chi_square,
    reported_probabilities,
)
from crossmodal.systems.kinematics.joint_filters import JointFilters, JointFiltersConfig
from crossmodal.systems.kinematics.solver.joint_geometry import PRISMATIC, RIGID
from crossmodal.systems.port_values import JointType


@pytest.mark.parametrize("joint", [JointType.PRISMATIC, JointType.REVOLUTE, JointType.RIGID])
def test_the_right_type_fits(joint: JointType) -> None:
    motion = {"motion": lambda t: 0.0 * t} if joint == JointType.RIGID else {}
    scene = Scene(joint=joint, seconds=8.0, **motion)
    inside = []
    for seed in range(2):
        filters, states = filter_states(scene, simulate(scene, seed))
        for state in states[60::20]:
            fit = filters.belief(state).fit
            assert fit is not None
            low, high = fit.bounds
            assert low < 1.0 < high
            inside.append(0.8 * low < fit.reduced_chi_square < 1.2 * high)
            assert fit.outlier_share < 0.05
    assert np.mean(inside) > 0.8


def test_a_wrong_type_does_not_fit() -> None:
    """What a slide or rest makes of a hinge is far off the measured poses."""
    scene = Scene(joint=JointType.REVOLUTE, motion=to_and_fro, seconds=5.0)
    _, states = filter_states(scene, simulate(scene, 0))
    s = states[-1]
    for kind in (PRISMATIC, RIGID):
        value, (_, high), _ = reduced_chi_square(kind, s.models, s.keyframes, s.noise)
        assert value > 3.0 * high
        assert largest_probability(kind, s.models, s.keyframes, s.noise, s.reported) < 0.05


@pytest.mark.parametrize("joint", [JointType.PRISMATIC, JointType.REVOLUTE, JointType.RIGID])
def test_the_right_type_may_be_reported_with_certainty(joint: JointType) -> None:
    motion = {"motion": lambda t: 0.0 * t} if joint == JointType.RIGID else {}
    scene = Scene(joint=joint, seconds=8.0, **motion)
    _, states = filter_states(scene, simulate(scene, 0))
    for s in states[30::10]:
        kind = int(np.argmax(s.models.log_evidence))
        assert largest_probability(kind, s.models, s.keyframes, s.noise, s.reported) > 0.99


@pytest.mark.parametrize(("deviations", "connected"), [(2.0, True), (30.0, False)])
def test_a_path_that_is_far_from_any_joint_is_none(deviations: float, connected: bool) -> None:
    """A slide that snakes, by a multiple of the reported noise in two waves."""
    rng, sigma, filters = np.random.default_rng(4), 1e-3, JointFilters(JointFiltersConfig())
    R = np.diag(np.repeat([np.deg2rad(0.3) ** 2, sigma**2], 3))
    state = filters.start(np.eye(4), R, 0.0)
    for k in range(1, 121):
        X, t = np.eye(4), k / RATE
        X[:3, 3] = [0.03 * t, deviations * sigma * np.sin(2.0 * np.pi * t / 4.0), 0.0]
        X = X @ se3.exp(np.sqrt(np.diag(R)) * rng.normal(size=6))
        state = filters.update(state, X, R, t)
    belief = filters.belief(state)
    assert (belief.type != JointType.DISCONNECTED) == connected
    assert sum(belief.probabilities.values()) == pytest.approx(1.0)
    if not connected:
        assert belief.probabilities[JointType.DISCONNECTED] > 0.9


def test_chi_square_of_a_body_at_rest_is_that_of_its_mean_pose() -> None:
    """Closed form of small errors without outliers: residuals from the weighted mean."""
    rng, sigma = np.random.default_rng(1), 1e-3
    filters = JointFilters(JointFiltersConfig(outliers=0.0))
    state = filters.start(np.eye(4), sigma**2 * np.eye(6), 0.0)
    for k in range(1, 12):
        X = se3.exp(sigma * rng.normal(size=6))
        state = filters.update(state, X, sigma**2 * np.eye(6), k / RATE)
    kf = state.keyframes
    n = int(kf.size[0])
    xi, W = np.array([se3.log(X) for X in kf.Z[:n]]), kf.W[:n]
    mean = np.linalg.solve(W.sum(axis=0), np.einsum("kij,kj->i", W, xi))
    square = np.einsum("ki,kij,kj->", xi - mean, W, xi - mean)
    value, _, degrees = reduced_chi_square(RIGID, state.models, kf, state.noise)
    assert degrees == 6 * (n - 1)
    np.testing.assert_allclose(value * degrees, square, rtol=1e-2)


def test_outliers_are_counted() -> None:
    scene = Scene(joint=JointType.PRISMATIC, seconds=6.0)
    run = simulate(scene, 3)
    bad = range(20, 80, 12)
    for k in bad:
        run.measured[k] = run.measured[k] @ se3.exp(np.array([0.3, 0, 0, 0, 0.05, 0]))
    filters, states = filter_states(scene, run)
    fit = filters.belief(states[-1]).fit
    assert fit is not None
    np.testing.assert_allclose(fit.outlier_share * states[-1].updates, len(bad), atol=1.0)


def test_averages_of_unmeasured_rotations_are_no_measured_ones() -> None:
    """Of long tracks of positions only the positions count."""
    filters, rng = JointFilters(JointFiltersConfig()), np.random.default_rng(0)
    covariance = np.diag(np.repeat([np.inf, 0.003**2], 3))
    X = np.eye(4)
    state = filters.start(X, covariance, 0.0)
    for k in range(1, 600):
        X[:3, 3] = [1e-3 * k, 0.0, 0.0] + 0.003 * rng.normal(size=3)
        state = filters.update(state, X, covariance, k / RATE)
    fit, n = filters.belief(state).fit, int(state.keyframes.size[0])
    # A slide's direction and place, and where along it each keyframe but the reference is.
    assert fit.degrees == 3 * n - (n - 1) - 2 - 3
    assert 0.4 < fit.reduced_chi_square < 2.0


def test_a_report_is_that_of_one_who_expects_no_type() -> None:
    ranked, p = np.array([0.9, 0.06, 0.04]), np.array([0.7, 0.2, 0.1])
    reported, likeliest = reported_probabilities(np.log(p), np.log(ranked))
    np.testing.assert_allclose(reported, p)
    assert likeliest == 0


def test_a_report_holds_for_one_who_expects_common_types_too() -> None:
    ranked, p = np.array([0.6, 0.3, 0.1]), np.array([0.9, 0.06, 0.04])
    reported, likeliest = reported_probabilities(np.log(p), np.log(ranked))
    np.testing.assert_allclose(reported, ranked)
    assert likeliest == 0


@pytest.mark.parametrize("p", [[0.2, 0.5, 0.3], [0.4, 0.4, 0.2], [1e-300, 1.0, 1e-300]])
def test_the_likeliest_type_leads_if_only_just(p: list[float]) -> None:
    ranked = np.array([0.5, 0.3, 0.2])
    reported, likeliest = reported_probabilities(np.log(p), np.log(ranked) - 7.0)
    assert likeliest == 0
    assert np.argmax(reported) == 0
    np.testing.assert_allclose(reported.sum(), 1.0)
    np.testing.assert_allclose(reported[0], reported[1], atol=1e-5)


def test_types_that_are_alike_may_be_reported_alike() -> None:
    np.testing.assert_allclose(
        reported_probabilities(np.zeros(3), np.zeros(3))[0], np.full(3, 1 / 3)
    )
