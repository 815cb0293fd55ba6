"""Starts of the moving models: the circle through positions, and an axis that is reversed."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from benchmarks.robustness_streams import all_cases, simulate_case
from crossmodal.systems.kinematics.joint_filters import JointFilters, JointFiltersConfig
from crossmodal.systems.kinematics.keyframes.pose_keyframes import (
    Keyframes,
    append,
    empty_keyframes,
)
from crossmodal.systems.kinematics.solver.joint_geometry import PRISMATIC, REVOLUTE
from crossmodal.systems.kinematics.solver.joint_models import Models, initial_models
from crossmodal.systems.kinematics.solver.joint_solver import solve_moving
from crossmodal.systems.kinematics.solver.joint_start import (
    circle_start,
    fresh_start,
    reverse_axis,
)

DISTANCE = 0.6  # Prior of an axis' place, [m].
CASES = {case.name: case for case in all_cases()}


def _arc(angle: float, noise: float, seed: int) -> Keyframes:
    """Positions on an arc of radius 0.4 m about (0, 0.4, 0), along z."""
    rng, kf = np.random.default_rng(seed), empty_keyframes(24, 6)
    for k, q in enumerate(np.linspace(0.0, angle, 20)):
        X = np.eye(4)
        X[:3, 3] = 0.4 * np.array([np.sin(q), 1.0 - np.cos(q), 0.0]) + noise * rng.normal(size=3)
        append(kf, X, np.diag([1e4] * 3 + [max(noise, 1e-6) ** 2] * 3), 0.1 * k, np.zeros(7))
    return kf


@pytest.mark.parametrize("angle", [0.3, 1.5, 3.0, 6.0])
def test_the_circle_through_exact_positions_is_found(angle: float) -> None:
    m, kf = initial_models(24), _arc(angle, 0.0, 0)
    circle_start(m, kf, DISTANCE)
    sign = np.sign(m.a[REVOLUTE, 2])
    assert_allclose(sign * m.a[REVOLUTE], [0.0, 0.0, 1.0], atol=1e-6)
    assert_allclose(m.c[REVOLUTE], [0.0, 0.4, 0.0], atol=1e-4)
    assert_allclose(sign * m.q[REVOLUTE, :20], np.linspace(0.0, angle, 20), atol=1e-3)


def test_noise_on_a_nearly_straight_path_is_no_small_circle() -> None:
    for seed in range(20):
        m, kf = initial_models(24), _arc(0.05, 2e-3, seed)
        circle_start(m, kf, DISTANCE)
        assert 0.2 < np.linalg.norm(m.c[REVOLUTE]) < 1.6 * DISTANCE


@pytest.mark.parametrize(("name", "kind"), [("door", REVOLUTE), ("drawer", PRISMATIC)])
def test_a_model_whose_axis_is_reversed_explains_as_much(name: str, kind: int) -> None:
    """With what marginalised keyframes and a rebase have left."""
    case, filters = CASES[name], JointFilters(JointFiltersConfig(memory=13))
    filters._priors = filters._priors._replace(coarseness=1e-6)
    stream = simulate_case(case, 0)
    state = filters.start(stream.X_PB_measured[0], case.covariance, 0.0)
    for k, X in enumerate(stream.X_PB_measured[1:], 1):
        state = filters.update(state, X, case.covariance, float(stream.times[k]))
    assert state.models.prior_information[kind, 0, 0] > 0.0
    m, kf, priors = state.models, state.keyframes, filters._priors
    evidence = []
    for reverse in (False, True):
        other = Models(*[x.copy() for x in m])
        if reverse:
            reverse_axis(kind, other)
        solve_moving(kind, other, kf, priors, 6, 1.0)
        evidence.append(other.log_evidence[kind])
    assert_allclose(evidence[0], evidence[1], atol=1e-6)


def test_a_fresh_start_after_a_constant_error_points_as_the_axis_did() -> None:
    case, filters, pointed = CASES["door"], JointFilters(JointFiltersConfig()), []
    for seed in range(6):
        stream = simulate_case(case, seed)
        state = filters.start(stream.X_PB_measured[0], case.covariance, 0.0)
        for k, X in enumerate(stream.X_PB_measured[1:100], 1):
            if k == 60:
                state = filters.rebase(state, state.time, case.covariance, np.zeros((6, 6)))
            state = filters.update(state, X, case.covariance, float(stream.times[k]))
        other = Models(*[x.copy() for x in state.models])
        fresh_start(other, state.keyframes, DISTANCE, 0.02)
        pointed.append(other.a[REVOLUTE] @ state.models.prior_a[REVOLUTE])
    assert min(pointed) > 0.0
