"""A rigid body's pose from point features on it, robust against a minority that left it."""

import numpy as np

from crossmodal.maths import se3
from crossmodal.maths.arrays import Array
from crossmodal.maths.compiled import hot
from crossmodal.maths.gaussian import diagonal_blocks, outlier_gate
from crossmodal.maths.rigid_points import pose_jacobian

GATE = outlier_gate(3)  # Squared distance beyond which a feature is an outlier.
_ITERATIONS = 10
_SETTLED = 1e-5  # Step below which the iteration ends, [rad, m].
_WIDTH = 9.0  # Least width of the weighting function, squared standard deviations.
_WEAK = 1e-2  # Information about the start, so that few features stay solvable, [1/rad^2, 1/m^2].


def register(
    X_start: Array, p_BF: Array, P_BF: Array, p_WF: Array, R_WF: Array
) -> tuple[Array, Array, Array, Array]:
    """Pose of a body from features seen in the world, by reweighted least squares.

    Each feature's residual X^-1 p_WF - p_BF is weighed by both its covariances and by the
    Geman-McClure function, whose width starts at the median residual and halves with each
    iteration down to three standard deviations.

    Args:
        X_start: X_WB (4, 4) whose rotation is started from, and which decides where features are
            too few; the position starts at what the features say in the median.
        p_BF: Positions in the body (K, 3), with their covariance P_BF (3K, 3K): features that were
            placed in the body at the same time share the error that its pose had then.
        p_WF: Positions seen (K, 3), with one frame's covariances R_WF (K, 3, 3).

    Returns:
        X_WB (4, 4); its covariance from one frame's noise (6, 6), in B; its covariance from the
        positions in the body (6, 6); and the distance squared of each feature (K,), at most
        `GATE` for those that count as on the body.
    """
    X_start = X_start.copy()  # Its position may lie between two bodies.
    X_start[:3, 3] = np.median(p_WF - p_BF @ X_start[:3, :3].T, axis=0)
    R = X_start[:3, :3]
    R_BF = R.T @ R_WF @ R
    W = np.asarray(np.linalg.inv(R_BF + diagonal_blocks(P_BF)), dtype=float)
    J = pose_jacobian(p_BF)
    JtW = J.transpose(0, 2, 1) @ W
    X, distance = _iterate(np.ascontiguousarray(X_start), p_BF, p_WF, W, JtW, JtW @ J)
    inside = distance <= GATE
    gain = JtW[inside]
    information = (gain @ J[inside]).sum(axis=0) + _WEAK * np.eye(6)
    covariance = np.linalg.inv(information)
    gain = covariance @ gain
    noise = (gain @ R_BF[inside] @ gain.transpose(0, 2, 1)).sum(axis=0)
    A = gain.transpose(1, 0, 2).reshape(6, -1)
    rows = np.repeat(inside, 3)
    landmarks = A @ P_BF[np.ix_(rows, rows)] @ A.T
    return X, noise + _WEAK * covariance @ covariance, landmarks, distance


@hot
def _iterate(
    X: Array, p_BF: Array, p_WF: Array, W: Array, JtW: Array, JtWJ: Array
) -> tuple[Array, Array]:
    """Pose (4, 4) where the iteration ends, and the features' squared distances (K,) there."""
    count = p_BF.shape[0]
    distance = np.zeros(count)
    residual = np.zeros((count, 3))
    step = np.ones(6)
    for iteration in range(_ITERATIONS + 1):
        for i in range(count):
            for row in range(3):
                residual[i, row] = -p_BF[i, row]
                for k in range(3):
                    residual[i, row] += X[k, row] * (p_WF[i, k] - X[k, 3])
            distance[i] = 0.0
            for row in range(3):
                for k in range(3):
                    distance[i] += residual[i, row] * W[i, row, k] * residual[i, k]
        if np.max(np.abs(step)) < _SETTLED:
            break
        width = max(_WIDTH, np.median(distance) / 2.0**iteration)
        information = _WEAK * np.eye(6)
        vector = np.zeros(6)
        for i in range(count):
            weight = (width / (width + distance[i])) ** 2
            for row in range(6):
                for k in range(3):
                    vector[row] += weight * JtW[i, row, k] * residual[i, k]
                for k in range(6):
                    information[row, k] += weight * JtWJ[i, row, k]
        step[:] = np.linalg.solve(information, vector)
        X = X @ se3.exp(step)
    return X, distance
