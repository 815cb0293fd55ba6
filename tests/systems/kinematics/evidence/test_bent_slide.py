"""Hinges far away: their mean likelihood against samples of the prior, and on streams."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from benchmarks.robustness_streams import all_cases, simulate_case
from crossmodal.systems.kinematics.evidence.bent_slide import log_mean_likelihood
from crossmodal.systems.kinematics.evidence.type_evidence import type_evidence
from crossmodal.systems.kinematics.joint_filters import JointFilters, JointFiltersConfig
from crossmodal.systems.kinematics.solver.joint_geometry import PRISMATIC, REVOLUTE
from crossmodal.systems.port_values import JointType

CASES = {case.name: case for case in all_cases()}


@pytest.mark.parametrize("known", [1.0, 10.0, 100.0])
def test_the_mean_likelihood_is_that_over_the_prior_of_places(known: float) -> None:
    rng = np.random.default_rng(0)
    sigma = 0.6 * np.repeat([1.0, 4.0, 16.0], 1_000_000)
    place = sigma[:, None] * rng.normal(size=(sigma.size, 2))
    curvature = place / (place**2).sum(axis=1)[:, None]
    L, b = known * np.array([[1.0, 0.0], [0.3, 1.2]]), np.array([2.0, 1.0])
    off = curvature @ L - b
    likelihood = np.exp(0.5 * (b @ b - (off**2).sum(axis=1)))
    assert_allclose(log_mean_likelihood(L, b, 0.6), np.log(likelihood.mean()), atol=0.05)


def test_no_hinge_explains_a_curvature_that_none_has() -> None:
    assert log_mean_likelihood(1e4 * np.eye(2), np.array([1e6, 0.0]), 0.6) == -np.inf


def test_a_path_that_has_hardly_moved_says_nothing_about_its_curvature() -> None:
    assert_allclose(log_mean_likelihood(1e-3 * np.eye(2), np.zeros(2), 0.6), 0.0, atol=0.02)


def _evidence(name: str, seconds: float, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """That of the types and that of the models' own solutions."""
    case, filters = CASES[name], JointFilters(JointFiltersConfig())
    stream = simulate_case(case, seed)
    state = filters.start(stream.X_PB_measured[0], case.covariance, 0.0)
    for t, X in zip(stream.times[1:], stream.X_PB_measured[1:], strict=True):
        if t > seconds:
            break
        state = filters.update(state, X, case.covariance, float(t))
    m, deviations = state.models, np.zeros((6, 6))
    return type_evidence(m, state.keyframes, filters._priors, deviations)[0], m.log_evidence


def test_a_near_hinge_s_own_solution_counts() -> None:
    types, models = _evidence("door", 5.0)
    assert models[REVOLUTE] > models[PRISMATIC] + 10.0
    assert_allclose(types[REVOLUTE], models[REVOLUTE], atol=0.1)


@pytest.mark.parametrize("name", ["hinge at 3 m", "hinge at 10 m"])
def test_a_far_hinge_is_not_behind_while_its_path_is_nearly_straight(name: str) -> None:
    each = [_evidence(name, 1.5, seed) for seed in range(6)]
    types, own = np.array([[e[REVOLUTE] - e[PRISMATIC] for e in pair] for pair in each]).T
    assert own.mean() < -1.0
    assert types.min() > -1.5


@pytest.mark.parametrize("name", ["hinge at 3 m", "hinge at 10 m", "screw, 1 cm a turn"])
def test_what_is_hardly_told_from_its_limit_is_not_reported_to_be_that(name: str) -> None:
    case, filters = CASES[name], JointFilters(JointFiltersConfig())
    limit = JointType.PRISMATIC if "hinge" in name else JointType.REVOLUTE
    for seed in range(3):
        stream = simulate_case(case, seed)
        state = filters.start(stream.X_PB_measured[0], case.covariance, 0.0)
        reported = []
        for t, X in zip(stream.times[1:], stream.X_PB_measured[1:], strict=True):
            state = filters.update(state, X, case.covariance, float(t))
            reported.append(filters.probabilities(state)[limit] if t > 2.0 else 0.0)
        assert max(reported) < 0.95
        assert filters.belief(state).type.value in case.accepted
