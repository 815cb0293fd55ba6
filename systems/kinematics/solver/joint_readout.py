"""Estimates of the joint models, in the parent's frame and with covariances, compiled.

Frames: P parent, B child, F the child's measured reference pose.
"""

import numpy as np

from crossmodal.maths.arrays import Array
from crossmodal.maths.compiled import assign, hot
from crossmodal.maths.se3_in_place import relative_log
from crossmodal.maths.vectors import tangent_basis
from crossmodal.systems.kinematics.solver.joint_geometry import (
    RIGID,
    child_pose,
    dimension,
    jacobian,
    screw_twists,
    turns,
)
from crossmodal.systems.kinematics.solver.joint_models import AXIS_SPREAD, Models

_STEPS = 20  # Most Newton steps to the nearest point of a path.
_NEAR = 1e-9  # Size of the last of them, [m or rad].


@hot
def _projected(T: Array, Sigma: Array, first: int, out: Array) -> None:
    """Writes T^T Sigma' T into `out`, Sigma' the block of Sigma from row and column `first` on."""
    rows, columns = T.shape
    for i in range(columns):
        for j in range(i + 1):
            s = 0.0
            for k in range(rows):
                for n in range(rows):
                    s += T[k, i] * Sigma[first + k, first + n] * T[n, j]
            out[i, j] = s
            out[j, i] = s


@hot
def nearest(kind: int, m: Models, X_FZ: Array, W: Array, k: Array) -> float:
    """q at the point of the path nearest to the pose X_FZ (4, 4), in the metric W (6, 6).

    Writes into `k` (6,) by how much more that is per twist of the pose, in the child.
    """
    G, WG, r, X, q = np.empty((6, 6)), np.empty(6), np.empty(6), np.eye(4), 0.0
    screw_twists(kind, m.Y[kind], m.a[kind], m.c[kind], m.pitch[kind], G)
    square = 0.0
    for i in range(6):
        WG[i] = 0.0
        for j in range(6):
            WG[i] += W[i, j] * G[0, j]
        square += WG[i] * G[0, i]
    for i in range(6):
        k[i] = WG[i] / square
    for _ in range(_STEPS):
        child_pose(kind, m.Y[kind], m.a[kind], m.c[kind], m.pitch[kind], q, X)
        relative_log(X, X_FZ, r)
        step = 0.0
        for i in range(6):
            step += k[i] * r[i]
        q += step
        if abs(step) < _NEAR:
            break
    return q


@hot
def read_configuration(
    kind: int, m: Models, of_theta: Array, W_zero: Array, displaced: Array, zero_variance: float
) -> tuple[Array, Array]:
    """Configuration and rate since the reference, (2,), and their covariance (2, 2).

    Args:
        kind: One of `MOVING`.
        of_theta: Covariance (N, N) of the model's theta.
        W_zero: Zero (6, 6), or the metric in which the point of the path that is nearest to the
            measured reference has q = 0.
        displaced: Covariance (6, 6), in B, of the path's displacement from the measured reference
            as far as it makes the configuration wrong; without W_zero the path's own counts.
        zero_variance: By how far the child may have moved before the reference.
    """
    size = dimension(kind)
    state, P, gain = m.state[kind].copy(), m.P[kind].copy(), m.gain[kind].copy()
    P[0, 0] += zero_variance
    if W_zero[0, 0] > 0.0:
        shift = np.empty(6)
        state[0] -= nearest(kind, m, np.eye(4), W_zero, shift)
        for i in range(6):
            gain[0, i] += shift[i]
            for j in range(6):
                P[0, 0] += shift[i] * displaced[i, j] * shift[j]
    for i in range(2):
        for j in range(2):
            for k in range(size):
                for n in range(size):
                    P[i, j] += gain[i, k] * of_theta[k, n] * gain[j, n]
    P[0, 1] = P[1, 0] = 0.5 * (P[0, 1] + P[1, 0])
    return state, P


@hot
def predicted_configuration(x: Array, P: Array, S: float, dt: float) -> tuple[Array, Array]:
    """Configuration and rate (2,), and their covariance (2, 2), a time dt [s] later.

    What is not measured goes on as it went, with the density of acceleration S, or has stopped at
    once: an equal mixture of both.
    """
    half, out = 0.5 * dt * x[1], np.empty((2, 2))
    out[0, 0] = P[0, 0] + dt * (P[0, 1] + 0.5 * dt * P[1, 1]) + S * dt**3 / 6.0 + half * half
    out[0, 1] = out[1, 0] = 0.5 * (P[0, 1] + dt * P[1, 1] + S * dt**2 / 2.0 + half * x[1])
    out[1, 1] = 0.5 * (P[1, 1] + S * dt) + 0.25 * x[1] ** 2
    return np.array([x[0] + half, 0.5 * x[1]]), out


@hot
def read_moving(
    kind: int,
    m: Models,
    of_theta: Array,
    of_q: Array,
    X_PF: Array,
    axis_distance: float,
    W_zero: Array,
    displaced: Array,
    zero_variance: float,
    S: float,
    dt: float,
) -> tuple[Array, Array, Array, Array, Array]:
    """Results of `read_axis` and `read_configuration`, the latter predicted dt [s] ahead.

    Args:
        of_q: What counts as covariance (N, N) of theta for the configuration.
        S: Density of the child's acceleration that was not measured.
    """
    vectors, axis, point = read_axis(kind, m, of_theta, X_PF, axis_distance)
    x, P = read_configuration(kind, m, of_q, W_zero, displaced, zero_variance)
    if dt > 1e-9:
        x, P = predicted_configuration(x, P, S, dt)
    return vectors, axis, point, x, P


@hot
def read_axis(
    kind: int, m: Models, of_theta: Array, X_PF: Array, axis_distance: float
) -> tuple[Array, Array, Array]:
    """A moving model's axis and axis point.

    The covariances are those of a mixture: if the rigid model is true, the axis may be any.

    Args:
        kind: One of `MOVING`.
        of_theta: Covariance (N, N) of the model's theta.
        X_PF: Measured reference pose (4, 4).

    Returns:
        (axis_P, p_PA) (2, 3), axis covariance (3, 3) and point covariance (3, 3). The point is NaN
        for a prismatic joint.
    """
    a, c = m.a[kind], m.c[kind]
    B, T = np.empty((2, 3)), np.zeros((4, 3))
    tangent_basis(a, B)
    vectors, axis, point = np.full((2, 3), np.nan), np.empty((3, 3)), np.full((3, 3), np.nan)
    for i in range(3):
        vectors[0, i] = X_PF[i, 0] * a[0] + X_PF[i, 1] * a[1] + X_PF[i, 2] * a[2]
        for k in range(2):
            T[2 + k, i] = X_PF[i, 0] * B[k, 0] + X_PF[i, 1] * B[k, 1] + X_PF[i, 2] * B[k, 2]
    _projected(T[2:], of_theta, 6, axis)
    if turns(kind):
        for i in range(3):
            vectors[1, i] = X_PF[i, 3] + (X_PF[i, 0] * c[0] + X_PF[i, 1] * c[1] + X_PF[i, 2] * c[2])
            for k in range(2):  # The point nearest to Fo slides along an axis that tilts.
                along = B[k, 0] * c[0] + B[k, 1] * c[1] + B[k, 2] * c[2]
                T[k, i] = -along * vectors[0, i]
        _projected(T, of_theta, 6, point)
    unmoved = 1.0 / (1.0 + np.exp(min(m.log_evidence[kind] - m.log_evidence[RIGID], 50.0)))
    for i in range(3):
        for j in range(3):
            normal = (1.0 if i == j else 0.0) - vectors[0, i] * vectors[0, j]
            axis[i, j] += unmoved * (AXIS_SPREAD**2 * normal - axis[i, j])
            point[i, j] += unmoved * (axis_distance**2 * normal - point[i, j])
    return vectors, axis, point


@hot
def predict_pose(kind: int, m: Models, X_PF: Array, dt: float) -> tuple[Array, Array]:
    """X_PB (4, 4) a time dt [s] after the newest keyframe, and its covariance (6, 6), in B."""
    n = dimension(kind)
    X, covariance, J = np.eye(4), np.empty((6, 6)), np.zeros((n, 6))
    for i in range(6):
        J[i, i] = 1.0
    q = m.state[kind, 0] + dt * m.state[kind, 1]
    child_pose(kind, m.Y[kind], m.a[kind], m.c[kind], m.pitch[kind], q, X)
    variance = 0.0
    G, rows = np.zeros((6, 6)), np.zeros((6, 6))
    if kind != RIGID:
        screw_twists(kind, m.Y[kind], m.a[kind], m.c[kind], m.pitch[kind], G)
        jacobian(kind, G, m.pitch[kind], q, rows)
        assign(J[6:], rows[1 : n - 5])
        for i in range(n):
            for j in range(6):
                J[i, j] += rows[0, j] * (m.gain[kind, 0, i] + dt * m.gain[kind, 1, i])
        S, P = m.process_noise[kind], m.P[kind]
        variance = P[0, 0] + dt * (2.0 * P[0, 1] + dt * P[1, 1]) + S * dt**3 / 3.0
    _projected(J, m.covariance[kind], 0, covariance)
    for i in range(6):
        for j in range(6):
            covariance[i, j] += variance * rows[0, i] * rows[0, j]
    return X_PF @ X, covariance
