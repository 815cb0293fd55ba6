"""The chain of configurations against one dense Gaussian of everything."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.stats import multivariate_normal

from crossmodal.maths import se3
from crossmodal.maths.se3_in_place import pose_difference
from crossmodal.maths.vectors import tangent_basis
from crossmodal.systems.kinematics.keyframes import pose_keyframes
from crossmodal.systems.kinematics.keyframes.pose_keyframes import Keyframes
from crossmodal.systems.kinematics.solver.joint_chain import (
    new_chain,
    run_chain,
    smooth,
    solve,
)
from crossmodal.systems.kinematics.solver.joint_geometry import (
    PARAMETERS,
    PRISMATIC,
    REVOLUTE,
    SCREW,
    child_pose,
    dimension,
    retract,
    turns,
)
from crossmodal.systems.kinematics.solver.joint_linearisation import linearise, new_linear
from crossmodal.systems.kinematics.solver.joint_models import (
    AXIS_SPREAD,
    Models,
    initial_models,
)
from crossmodal.systems.kinematics.solver.parameter_priors import WIDEST

K = 7
S, SIGMA_V, SIGMA_C = 2e-3, 0.2, 0.6
TIMES = np.array([0.0, 0.1, 0.3, 0.4, 0.9, 1.0, 1.1])


def _problem(kind: int) -> tuple[Models, Keyframes]:
    rng = np.random.default_rng(kind)
    m, kf = initial_models(K), pose_keyframes.empty_keyframes(K, 6)
    a = rng.normal(size=3)
    m.a[kind] = a / np.linalg.norm(a)
    if turns(kind):
        c = rng.normal(size=3)
        m.c[kind] = c - m.a[kind] * (m.a[kind] @ c)
    if kind == SCREW:
        m.pitch[kind] = 0.03
    m.Y[kind] = se3.exp(1e-3 * rng.normal(size=6))
    m.q[kind, 1:] = np.cumsum(0.1 * rng.uniform(size=K - 1))
    for k in range(K):
        A = rng.normal(size=(6, 6))
        X = np.empty((4, 4))
        child_pose(kind, m.Y[kind], m.a[kind], m.c[kind], m.pitch[kind], m.q[kind, k], X)
        X = X @ se3.exp(0.01 * rng.normal(size=6))
        pose_keyframes.append(kf, X, 1e-4 * (A @ A.T + np.eye(6)), TIMES[k], np.zeros(7))
    return m, kf


def _prior_of_q(density: float = S) -> np.ndarray:
    """Covariance (K, K) of the white-acceleration process from q = 0."""
    s, t = np.minimum.outer(TIMES, TIMES), np.maximum.outer(TIMES, TIMES)
    return density * (s**2 * t / 2.0 - s**3 / 6.0) + SIGMA_V**2 * s * t


def _jacobian(kind: int, m: Models) -> tuple[np.ndarray, np.ndarray]:
    """Columns per parameter (6K, n) and per q (6K, K), by finite differences of the poses."""

    def poses(
        Y: np.ndarray, a: np.ndarray, c: np.ndarray, pitch: float, q: np.ndarray
    ) -> list[np.ndarray]:
        result = [np.empty((4, 4)) for _ in range(K)]
        for k in range(K):
            child_pose(kind, Y, a, c, pitch, q[k], result[k])
        return result

    base = poses(m.Y[kind], m.a[kind], m.c[kind], m.pitch[kind], m.q[kind])
    h, n = 1e-6, dimension(kind)
    J, Jq = np.zeros((6 * K, n)), np.zeros((6 * K, K))
    for i in range(n):
        step = np.zeros(PARAMETERS)
        step[i] = h
        Y, a, c = m.Y[kind].copy(), m.a[kind].copy(), m.c[kind].copy()
        pitch = retract(kind, Y, a, c, m.pitch[kind], step)
        for k, X in enumerate(poses(Y, a, c, pitch, m.q[kind])):
            J[6 * k : 6 * k + 6, i] = se3.log(se3.inverse(base[k]) @ X) / h
    moved = poses(m.Y[kind], m.a[kind], m.c[kind], m.pitch[kind], m.q[kind] + h)
    for k, X in enumerate(moved):
        Jq[6 * k : 6 * k + 6, k] = se3.log(se3.inverse(base[k]) @ X) / h
    Jq[:, 0] = 0.0  # At the reference q is zero by definition.
    return J, Jq


def _dense(
    kind: int, m: Models, kf: Keyframes
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """J (6K, n), Jq (6K, K), the data relative to q = 0 (6K,) and the keyframes' covariance."""
    J, Jq = _jacobian(kind, m)
    R, z, X = np.zeros((6 * K, 6 * K)), np.zeros(6 * K), np.empty((4, 4))
    for k in range(K):
        child_pose(kind, m.Y[kind], m.a[kind], m.c[kind], m.pitch[kind], m.q[kind, k], X)
        pose_difference(X, kf.Z[k], z[6 * k : 6 * k + 6])
        R[6 * k : 6 * k + 6, 6 * k : 6 * k + 6] = kf.R[k]
    return J, Jq, z + Jq @ m.q[kind], R


def _normaliser(kf: Keyframes) -> float:
    """What the likelihood leaves out: every keyframe's own density at its mean."""
    return float(-0.5 * np.sum(kf.log_det) - 3.0 * K * np.log(2.0 * np.pi))


@pytest.mark.parametrize("kind", [PRISMATIC, REVOLUTE, SCREW])
def test_normal_equations_and_likelihood_are_those_of_the_dense_problem(kind: int) -> None:
    m, kf = _problem(kind)
    J, Jq, z, R = _dense(kind, m, kf)
    C = R + Jq @ _prior_of_q() @ Jq.T
    n = dimension(kind)
    H, h = J.T @ np.linalg.solve(C, J), J.T @ np.linalg.solve(C, z)
    value = multivariate_normal(cov=C).logpdf(z) - _normaliser(kf)
    H[6:8, 6:8] += np.eye(2) / AXIS_SPREAD**2
    lin, chain = new_linear(K), new_chain(K)
    linearise(kind, m, kf, SIGMA_C, False, 0.0, 1.0, lin)
    if turns(kind):
        H[8:10, 8:10] += np.eye(2) / SIGMA_C**2
        B = np.empty((2, 3))
        tangent_basis(m.a[kind], B)
        h[8:10] -= B @ m.c[kind] / SIGMA_C**2
        value -= 0.5 * m.c[kind] @ m.c[kind] / SIGMA_C**2 + 2.0 * np.log(SIGMA_C)
    if kind == SCREW:
        H[10, 10] += 1.0 / WIDEST**2
        h[10] -= m.pitch[kind] / WIDEST**2
        value -= 0.5 * m.pitch[kind] ** 2 / WIDEST**2 + np.log(WIDEST)
    found = run_chain(
        n, S, 0.0, 0.0, SIGMA_V, 1.0, m.q[kind], kf, lin, np.zeros(PARAMETERS), 0, chain
    )
    assert_allclose(found, value, rtol=1e-5)
    assert_allclose(chain.h[:n], h, rtol=1e-4, atol=1e-4 * np.abs(h).max())
    assert_allclose(np.tril(chain.H[:n, :n]), np.tril(H), rtol=1e-4, atol=1e-5 * np.abs(H).max())


@pytest.mark.parametrize("kind", [PRISMATIC, REVOLUTE, SCREW])
def test_the_last_configuration_and_its_variance_are_those_of_the_dense_problem(kind: int) -> None:
    m, kf = _problem(kind)
    n = dimension(kind)
    J, Jq, z, R = _dense(kind, m, kf)
    lin, chain = new_linear(K), new_chain(K)
    linearise(kind, m, kf, SIGMA_C, False, 0.0, 1.0, lin)
    run_chain(n, S, 0.0, 0.0, SIGMA_V, 1.0, m.q[kind], kf, lin, np.zeros(PARAMETERS), 0, chain)
    prior = _prior_of_q()
    C = R + Jq @ prior @ Jq.T
    gain = prior @ Jq.T @ np.linalg.inv(C)
    posterior = prior - gain @ Jq @ prior
    assert_allclose(chain.m[0], (gain @ z)[-1], rtol=1e-5)
    assert_allclose(chain.P[0], posterior[-1, -1], rtol=1e-5)
    assert_allclose(chain.M[0, :n], -(gain @ J)[-1], atol=1e-5)
    q, step = np.empty(K), 1e-3 * np.arange(float(PARAMETERS))
    smooth(n, np.full(K, S), SIGMA_V, m.q[kind], kf, lin, step, q)
    assert_allclose(q, gain @ (z - J @ step[:n]), atol=1e-6)


def test_densities_are_compared_by_the_newest_keyframes_at_the_moved_joint() -> None:
    """The likelihood of the last three given all before, but for what does not depend on S."""
    m, kf = _problem(REVOLUTE)
    J, Jq, z, R = _dense(REVOLUTE, m, kf)
    lin, chain = new_linear(K), new_chain(K)
    linearise(REVOLUTE, m, kf, SIGMA_C, False, 0.0, 1.0, lin)
    step, since = 2e-3 * np.arange(float(PARAMETERS)), K - 3
    found, expected = [], []
    for scale in (1.0, 30.0):
        found.append(
            run_chain(
                10, scale * S, 0.0, 0.0, SIGMA_V, 1.0, m.q[REVOLUTE], kf, lin, step, since, chain
            )
        )
        C = R + Jq @ _prior_of_q(scale * S) @ Jq.T
        before, e = 6 * since, z - J @ step[:10]
        whole = multivariate_normal(cov=C).logpdf(e)
        expected.append(whole - multivariate_normal(cov=C[:before, :before]).logpdf(e[:before]))
    assert_allclose(found[1] - found[0], expected[1] - expected[0], rtol=1e-3)


def test_the_evidence_is_the_integral_over_theta() -> None:
    """Laplace's approximation is exact here: theta enters linearly, with a Gaussian prior."""
    m, kf = _problem(PRISMATIC)
    J, Jq, z, R = _dense(PRISMATIC, m, kf)
    lin, chain = new_linear(K), new_chain(K)
    linearise(PRISMATIC, m, kf, SIGMA_C, False, 0.0, 1.0, lin)
    value = run_chain(
        8, S, 0.0, 0.0, SIGMA_V, 1.0, m.q[PRISMATIC], kf, lin, np.zeros(PARAMETERS), 0, chain
    )
    evidence, _ = solve(8, value, chain)
    spread = 30.0  # All but flat in the pose, as the evidence has it.
    prior = np.diag([spread**2] * 6 + [AXIS_SPREAD**2] * 2)
    C = R + Jq @ _prior_of_q() @ Jq.T + J @ prior @ J.T
    expected = multivariate_normal(cov=C).logpdf(z) - _normaliser(kf)
    expected += 6.0 * np.log(spread) + 2.0 * np.log(AXIS_SPREAD)
    assert_allclose(evidence, expected, atol=1e-2)


def _prior_of_steps(densities: np.ndarray) -> np.ndarray:
    """Covariance (K, K) as of `_prior_of_q`, with a density for the step before each keyframe."""
    A, P = np.zeros((K, 2 * K)), np.diag([0.0, SIGMA_V**2] + [0.0] * (2 * K - 2))
    x = np.eye(2, 2 * K)  # q and its rate, by the first ones and what comes in with each step.
    for k in range(1, K):
        dt = TIMES[k] - TIMES[k - 1]
        x = np.array([[1.0, dt], [0.0, 1.0]]) @ x
        x[:, 2 * k : 2 * k + 2] = np.eye(2)
        Q = np.array([[dt**3 / 3.0, dt**2 / 2.0], [dt**2 / 2.0, dt]])
        P[2 * k : 2 * k + 2, 2 * k : 2 * k + 2] = densities[k] * Q
        A[k] = x[0]
    return A @ P @ A.T


def test_a_step_with_a_jump_counts_as_one() -> None:
    """The dense problem with another density in the step before the keyframe that is far off."""
    m, kf = _problem(PRISMATIC)
    at, jump, jumps = 4, 50.0, 1e-3
    for k in range(at, K):
        displacement = 8.0 * (TIMES[k] - TIMES[at - 1])
        m.q[PRISMATIC, k] += displacement
        kf.Z[k, :3, 3] += displacement * m.a[PRISMATIC]
    _, Jq, z, R = _dense(PRISMATIC, m, kf)
    lin, chain, still = new_linear(K), new_chain(K), np.zeros(PARAMETERS)
    linearise(PRISMATIC, m, kf, SIGMA_C, False, 0.0, 1.0, lin)
    value = run_chain(8, S, jump, jumps, SIGMA_V, 1.0, m.q[PRISMATIC], kf, lin, still, 0, chain)
    densities = np.where(np.arange(K) == at, jump, S)
    assert_allclose(chain.S[1:], densities[1:], rtol=1e-9)
    prior = _prior_of_steps(densities)
    C = R + Jq @ prior @ Jq.T
    gain = prior @ Jq.T @ np.linalg.inv(C)
    assert_allclose(chain.m[0], (gain @ z)[-1], rtol=1e-5)
    q = np.empty(K)
    smooth(8, chain.S, SIGMA_V, m.q[PRISMATIC], kf, lin, still, q)
    assert_allclose(q, gain @ z, atol=1e-6)
    expected = multivariate_normal(cov=C).logpdf(z) - _normaliser(kf) + np.log(jumps)
    assert_allclose(value, expected, rtol=1e-4)


def test_what_is_hardly_a_jump_changes_hardly_anything() -> None:
    """The evidence has no step where a keyframe is so far off that a jump is considered."""
    values = []
    for shift in np.linspace(0.0, 0.5, 251):
        m, kf = _problem(PRISMATIC)
        kf.Z[3, :3, 3] += shift * kf.Z[3, :3, :3] @ m.Y[PRISMATIC, :3, :3].T @ m.a[PRISMATIC]
        lin, chain, still = new_linear(K), new_chain(K), np.zeros(PARAMETERS)
        linearise(PRISMATIC, m, kf, SIGMA_C, False, 0.0, 1.0, lin)
        q = m.q[PRISMATIC]
        values.append(run_chain(8, 1e-6, 50.0, 1e-3, SIGMA_V, 1.0, q, kf, lin, still, 0, chain))
    steps = np.diff(values)
    assert np.abs(np.diff(steps)).max() < 2.0
