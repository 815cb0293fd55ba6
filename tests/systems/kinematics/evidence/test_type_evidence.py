"""Smooth deviations: their marginal density against that of all keyframes, and on streams."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from benchmarks.robustness_streams import all_cases, simulate_case
from crossmodal.maths import se3
from crossmodal.maths.arrays import Array
from crossmodal.maths.se3_in_place import pose_difference
from crossmodal.systems.kinematics.evidence.deviation_series import (
    add_keyframes,
    marginalise,
    new_series,
)
from crossmodal.systems.kinematics.evidence.type_evidence import smooth_evidence
from crossmodal.systems.kinematics.joint_filters import JointFilters, JointFiltersConfig
from crossmodal.systems.kinematics.joint_filters_state import JointFiltersState
from crossmodal.systems.kinematics.solver.joint_geometry import (
    MOVING,
    PRISMATIC,
    REVOLUTE,
    RIGID,
    child_pose,
    dimension,
    retract,
)
from crossmodal.systems.kinematics.solver.joint_linearisation import new_linear

CASES = {case.name: case for case in all_cases()}
DEVIATIONS = np.diag(np.repeat([5e-3**2, 1.5e-3**2], 3))


def _state(name: str, seconds: float, seed: int = 0) -> JointFiltersState:
    case, filters = CASES[name], JointFilters(JointFiltersConfig(outliers=0.0))
    stream = simulate_case(case, seed)
    state = filters.start(stream.X_PB_measured[0], case.covariance, 0.0)
    for t, X in zip(stream.times[1:], stream.X_PB_measured[1:], strict=True):
        if t > seconds:
            break
        state = filters.update(state, X, case.covariance, float(t))
    return state


def _pose(kind: int, state: JointFiltersState, q: float, step: Array) -> Array:
    """X_FB of a model moved by `step` (11,) at a configuration q."""
    m, X = state.models, np.empty((4, 4))
    Y, a, c = m.Y[kind].copy(), m.a[kind].copy(), m.c[kind].copy()
    pitch = retract(kind, Y, a, c, m.pitch[kind], step)
    child_pose(kind, Y, a, c, pitch, q, X)
    return X


def _derivatives(kind: int, state: JointFiltersState, k: int, n: int) -> tuple[Array, Array]:
    """Of the pose of keyframe k, right perturbation: by theta (6, n) and by q (6,)."""
    eps, q = 1e-6, state.models.q[kind, k]
    X = se3.inverse(_pose(kind, state, q, np.zeros(11)))
    columns = [se3.log(X @ _pose(kind, state, q, eps * e)) / eps for e in np.eye(11)[:n]]
    along = se3.log(X @ _pose(kind, state, q + eps, np.zeros(11))) / eps
    return np.array(columns).T, along


@pytest.mark.parametrize("kind", MOVING)
def test_the_series_is_marginalised_as_one_large_normal_distribution(kind: int) -> None:
    """With each keyframe's q free but for the first one's, which is zero."""
    state = _state("door", 4.0)
    m, kf = state.models, state.keyframes
    K, n = int(kf.size[0]), dimension(kind)
    lin, series, rough = new_linear(kf.time.size), new_series(), DEVIATIONS / 16.0
    add_keyframes(kind, m, kf, rough, True, lin, series)
    marginalise(n, DEVIATIONS, series, lin)

    q = m.q[kind, :K]
    place = np.pi * (q - q.min()) / np.ptp(q)
    # Columns: theta, every q but the first, the coefficients of four waves.
    A, r = np.zeros((6 * K, n + K - 1)), np.empty(6 * K)
    waves, V = np.zeros((6 * K, 24)), np.zeros((6 * K, 6 * K))
    for k in range(K):
        rows, (by_theta, by_q) = slice(6 * k, 6 * k + 6), _derivatives(kind, state, k, n)
        pose_difference(_pose(kind, state, q[k], np.zeros(11)), kf.Z[k], r[rows])
        A[rows, :n] = by_theta
        V[rows, rows] = kf.R[k] + rough
        L = np.linalg.inv(np.linalg.cholesky(V[rows, rows]))
        free = np.eye(6)
        if k > 0:
            A[rows, n + k - 1] = by_q
            u = L @ by_q / np.linalg.norm(L @ by_q)
            free -= np.linalg.inv(L) @ np.outer(u, u) @ L  # There is no deviation along the path.
        for i in range(4):
            waves[rows, 6 * i : 6 * i + 6] = free * np.cos((i + 1) * place[k])
    prior = np.kron(np.diag(np.arange(1.0, 5.0) ** -4), DEVIATIONS)
    S = np.linalg.inv(V + waves @ prior @ waves.T)
    H, h = A.T @ S @ A, A.T @ S @ r
    of_q = np.linalg.inv(H[n:, n:])
    information = H[:n, :n] - H[:n, n:] @ of_q @ H[n:, :n]
    lower = np.tril(lin.information[:n, :n])
    assert_allclose(lower + np.tril(lower, -1).T, information, rtol=1e-3, atol=1e-3 * H.max() / 1e3)
    vector = h[:n] - H[:n, n:] @ of_q @ h[n:]
    assert_allclose(lin.vector[:n], vector, rtol=1e-3, atol=1e-3 * np.abs(vector).max())
    of_deviations = np.linalg.slogdet(V + waves @ prior @ waves.T)[1]
    value = -0.5 * (r @ S @ r - h[n:] @ of_q @ h[n:]) - 0.5 * of_deviations
    assert_allclose(lin.value[0], value, atol=1e-2)


@pytest.mark.parametrize(("name", "kind"), [("drawer", PRISMATIC), ("door", REVOLUTE)])
def test_smooth_deviations_explain_bends_better_than_independent_ones(name: str, kind: int) -> None:
    priors, smooth = JointFilters(JointFiltersConfig())._priors, np.empty(5)
    covariance = np.empty((4, 11, 11))
    for seed in range(3):
        state = _state(f"{name}, bent by 2 mm, 1 mm", 20.0, seed)
        smooth_evidence(state.models, state.keyframes, priors, DEVIATIONS, smooth, covariance)
        assert smooth[kind] > state.models.log_evidence[kind] + 5.0
        assert state.deviations_index > 0


def test_in_white_noise_there_are_no_bends() -> None:
    priors = JointFilters(JointFiltersConfig())._priors
    smooth, covariance = np.empty(5), np.empty((4, 11, 11))
    for name, kind in (("door", REVOLUTE), ("drawer", PRISMATIC), ("rigid", RIGID)):
        state = _state(name, 10.0)
        smooth_evidence(state.models, state.keyframes, priors, DEVIATIONS, smooth, covariance)
        assert smooth[kind] < state.models.log_evidence[kind] + 3.0
        assert state.deviations_index == 0
