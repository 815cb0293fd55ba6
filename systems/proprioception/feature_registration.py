"""A rigid body's pose from point features on it, robust against a minority that left it."""

import numba
import numpy as np
import numpy.typing as npt

from maths import se3

Array = npt.NDArray[np.float64]

_ITERATIONS = 8
_SETTLED = 1e-6  # Step below which the iteration ends, [rad, m].
GATE = 16.27  # 99.9 % of chi-square with three degrees of freedom.
_WEAK = 1e-2  # Information about the start, so that few features stay solvable, [1/rad^2, 1/m^2].


@numba.njit(cache=True)
def _jacobian(R: Array, p: Array) -> Array:
    """d (X exp(xi) p) / d xi, (3, 6)."""
    J = np.zeros((3, 6))
    J[:, :3] = -(R @ se3.skew(p))
    J[:, 3:] = R
    return J


@numba.njit(cache=True)
def register(
    X_start: Array, p_BF: Array, P_BF: Array, p_WF: Array, R_WF: Array
) -> tuple[Array, Array, Array, Array]:
    """Pose of a body from features seen in the world, by reweighted least squares.

    Each feature's residual p_WF - X p_BF is weighed by both its covariances and by the
    Geman-McClure function, whose width starts at the median residual and halves with each
    iteration down to three standard deviations.

    Args:
        X_start: X_WB (4, 4) to start from; it decides nothing else, unless features are too few.
        p_BF: Positions in the body (K, 3), with covariances P_BF (K, 3, 3).
        p_WF: Positions seen (K, 3), with one frame's covariances R_WF (K, 3, 3).

    Returns:
        X_WB (4, 4); its covariance from one frame's noise (6, 6), in B; its covariance from the
        positions in the body (6, 6); and the distance squared of each feature (K,), at most
        16.27 for those that count as on the body.
    """
    count = p_BF.shape[0]
    X = X_start.copy()
    distance = np.zeros(count)
    W = np.zeros((count, 3, 3))
    for iteration in range(_ITERATIONS):
        R = np.ascontiguousarray(X[:3, :3])
        residual = np.zeros((count, 3))
        for i in range(count):
            residual[i] = p_WF[i] - R @ p_BF[i] - X[:3, 3]
            W[i] = np.linalg.inv(R_WF[i] + R @ P_BF[i] @ R.T)
            distance[i] = residual[i] @ W[i] @ residual[i]
        width = max(9.0, np.median(distance) / 2.0**iteration)
        information = _WEAK * np.eye(6)
        vector = np.zeros(6)
        for i in range(count):
            weight = (width / (width + distance[i])) ** 2
            J = _jacobian(R, p_BF[i])
            JtW = weight * (J.T @ W[i])
            information += JtW @ J
            vector += JtW @ residual[i]
        step = np.linalg.solve(information, vector)
        X = X @ se3.exp(step)
        if np.max(np.abs(step)) < _SETTLED:
            break
    return _with_covariance(X, p_BF, P_BF, p_WF, R_WF)


@numba.njit(cache=True)
def _with_covariance(
    X: Array, p_BF: Array, P_BF: Array, p_WF: Array, R_WF: Array
) -> tuple[Array, Array, Array, Array]:
    """The results of `register` at the pose where it ended, from the features within the gate."""
    count = p_BF.shape[0]
    R = np.ascontiguousarray(X[:3, :3])
    distance = np.zeros(count)
    information = _WEAK * np.eye(6)
    noise = np.zeros((6, 6))
    anchors = np.zeros((6, 6))
    for i in range(count):
        residual = p_WF[i] - R @ p_BF[i] - X[:3, 3]
        anchor = R @ P_BF[i] @ R.T
        W = np.linalg.inv(R_WF[i] + anchor)
        distance[i] = residual @ W @ residual
        if distance[i] > GATE:
            continue
        J = _jacobian(R, p_BF[i])
        JtW = J.T @ W
        information += JtW @ J
        noise += JtW @ R_WF[i] @ JtW.T
        anchors += JtW @ anchor @ JtW.T
    covariance = np.linalg.inv(information)
    weak = _WEAK * covariance @ covariance
    return X, covariance @ noise @ covariance + weak, covariance @ anchors @ covariance, distance
