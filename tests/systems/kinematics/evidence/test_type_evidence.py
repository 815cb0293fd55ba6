"""Smooth deviations: their marginal density against that of all keyframes, and on streams."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from benchmarks.robustness_streams import all_cases, simulate_case
from crossmodal.maths import se3
from crossmodal.maths.arrays import Array
from crossmodal.maths.se3_in_place import pose_difference
from crossmodal.systems.kinematics.evidence.deviation_series import (
    add_coefficients,
    add_keyframes,
    marginalise,
    no_waves,
    with_path_waves,
)
from crossmodal.systems.kinematics.evidence.smooth_solution import smooth_evidence, store_posterior
from crossmodal.systems.kinematics.evidence.wander import Wander, wander_waves
from crossmodal.systems.kinematics.joint_filters import JointFilters, JointFiltersConfig
from crossmodal.systems.kinematics.joint_filters_state import JointFiltersState
from crossmodal.systems.kinematics.measurement_errors import MeasurementErrorsConfig
from crossmodal.systems.kinematics.solver.joint_chain import new_chain, run_chain, solve
from crossmodal.systems.kinematics.solver.joint_geometry import (
    MOVING,
    PARAMETERS,
    PRISMATIC,
    REVOLUTE,
    RIGID,
    child_pose,
    dimension,
    retract,
)
from crossmodal.systems.kinematics.solver.joint_linearisation import new_linear
from crossmodal.systems.kinematics.solver.joint_models import copy_models

CASES = {case.name: case for case in all_cases()}
DEVIATIONS = np.diag(np.repeat([5e-3**2, 1.5e-3**2], 3))
ROUGH = DEVIATIONS / 16.0


def _state(name: str, seconds: float, seed: int = 0) -> JointFiltersState:
    """With deviations from the path alone; rotations do not err by themselves."""
    errors = MeasurementErrorsConfig(wander=0.0)
    case, filters = CASES[name], JointFilters(JointFiltersConfig(outliers=0.0, errors=errors))
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
def test_smooth_errors_are_marginalised_as_one_large_normal_distribution(kind: int) -> None:
    """Of deviations from the path and of rotations in time, with q a chain from zero."""
    state = _state("door", 4.0)
    m, kf = state.models, state.keyframes
    K, n = int(kf.size[0]), dimension(kind)
    q, t, density, speed = m.q[kind, :K], kf.time[:K], 1e-3, 0.2
    in_time = wander_waves(Wander(3, 2), kf)
    waves, rough = with_path_waves(m.q[kind], K, DEVIATIONS, in_time), DEVIATIONS / 16.0
    more = waves.variance.size
    lin, chain = new_linear(kf.time.size, more), new_chain(kf.time.size, more)
    add_keyframes(kind, m, kf, rough, waves, lin)
    still = np.zeros(PARAMETERS + more)
    value = run_chain(n + more, density, 0.0, 0.0, speed, 1.0, m.q[kind], kf, lin, still, 0, chain)
    value += marginalise(n, waves, chain)

    theta, of_q, r = np.zeros((6 * K, n)), np.zeros((6 * K, K)), np.empty(6 * K)
    errors, C = np.zeros((6 * K, more)), np.zeros((6 * K, 6 * K))
    place, first = np.pi * (q - q.min()) / np.ptp(q), in_time.variance.size
    alphas = []
    for k in range(K):
        rows, (by_theta, by_q) = slice(6 * k, 6 * k + 6), _derivatives(kind, state, k, n)
        pose_difference(_pose(kind, state, q[k], np.zeros(11)), kf.Z[k], r[rows])
        theta[rows], V = by_theta, kf.R[k] + rough
        C[rows, rows] = V
        across = np.eye(6)
        if k > 0:
            of_q[rows, k] = by_q
            across -= np.outer(by_q, by_q @ np.linalg.inv(V)) / (by_q @ np.linalg.solve(V, by_q))
            alphas.append(by_q @ np.linalg.solve(V, by_q))
        for i in range(first):
            errors[6 * k + in_time.direction[i], i] = in_time.value[k, i]
        for i in range(4):  # There is no deviation along the path.
            columns = slice(first + 6 * i, first + 6 * i + 6)
            errors[rows, columns] = across * np.cos((i + 1) * place[k])
    prior = np.concatenate(
        [in_time.variance, np.kron(np.arange(1.0, 5.0) ** -4, np.diag(DEVIATIONS))]
    )
    early, late = np.minimum.outer(t - t[0], t - t[0]), np.maximum.outer(t - t[0], t - t[0])
    of_chain = density * (early**2 * late / 2.0 - early**3 / 6.0) + speed**2 * early * late
    C += of_q @ of_chain @ of_q.T + errors @ np.diag(prior) @ errors.T
    z, S = r + of_q @ q, np.linalg.inv(C)
    H, h = theta.T @ S @ theta, theta.T @ S @ z
    lower = np.tril(chain.H[:n, :n])
    assert_allclose(lower + np.tril(lower, -1).T, H, rtol=1e-3, atol=1e-6 * H.max())
    assert_allclose(chain.h[:n], h, rtol=1e-3, atol=1e-3 * np.abs(h).max())
    assert_allclose(value, -0.5 * (z @ S @ z + np.linalg.slogdet(C)[1]), atol=2e-2)

    solve(n, value, chain)
    step, at = chain.step[:n].copy(), copy_models(m)
    assert_allclose(step, np.linalg.solve(H, h), rtol=1e-2, atol=1e-3 * np.abs(step).max())
    add_coefficients(n, waves, chain)
    mean = prior * (errors.T @ S @ (z - theta @ step))
    assert_allclose(chain.step[n:][:more], mean, atol=1e-2 * np.abs(mean).max())
    chain.step[:n] = 0.0
    add_coefficients(n, waves, chain)
    store_posterior(kind, at, waves, chain)
    of_last = of_chain[K - 1] @ of_q.T
    P = of_chain[K - 1, K - 1] - of_last @ S @ of_last
    assert_allclose(at.state[kind, 0], of_last @ S @ z, rtol=1e-4)
    assert_allclose(at.gain[kind, 0, :n], -of_last @ S @ theta, atol=1e-2)
    assert_allclose(at.P[kind, 0, 0], P, rtol=1e-2)
    covariance = np.linalg.inv(H)
    assert_allclose(at.covariance[kind, :n, :n], covariance, atol=1e-2 * covariance.max())


@pytest.mark.parametrize(("name", "kind"), [("drawer", PRISMATIC), ("door", REVOLUTE)])
def test_smooth_deviations_explain_bends_better_than_independent_ones(name: str, kind: int) -> None:
    priors, smooth = JointFilters(JointFiltersConfig())._priors, np.empty(5)
    for seed in range(3):
        state = _state(f"{name}, bent by 2 mm, 1 mm", 20.0, seed)
        m, kf = state.models, state.keyframes
        waves = no_waves(kf.time.size)
        smooth_evidence(m, kf, priors, DEVIATIONS, ROUGH, waves, smooth, copy_models(m))
        assert smooth[kind] > state.models.log_evidence[kind] + 5.0
        assert state.deviations_index > 0


def test_in_white_noise_there_are_no_bends() -> None:
    priors = JointFilters(JointFiltersConfig())._priors
    smooth = np.empty(5)
    for name, kind in (("door", REVOLUTE), ("drawer", PRISMATIC), ("rigid", RIGID)):
        state = _state(name, 10.0)
        m, kf = state.models, state.keyframes
        waves = no_waves(kf.time.size)
        smooth_evidence(m, kf, priors, DEVIATIONS, ROUGH, waves, smooth, copy_models(m))
        assert smooth[kind] < state.models.log_evidence[kind] + 3.0
        assert state.deviations_index == 0
