"""Gaussian corrections, likelihoods and consistency, compiled.

A measurement z of a state x with prior covariance P and Jacobian H has the innovation e, whose
covariance is S = H P H^T + R.
"""

import numpy as np
import scipy.special

from crossmodal.maths.arrays import Array, Mask
from crossmodal.maths.compiled import hot

FALSE_ALARM = 1e-3  # Probability with which a measurement without a fault is taken for an outlier.

# Standard deviation of a normal distribution over the median of its absolute values.
MEDIAN_TO_SIGMA = 1.4826


@hot
def symmetric(P: Array) -> Array:
    """The symmetric part (n, n) of `P`."""
    return 0.5 * (P + P.T)


@hot
def schmidt_update(P: Array, H: Array, R: Array, e: Array, considered: Mask) -> tuple[Array, Array]:
    """One Kalman correction that leaves some states as they are, but knows that they may be wrong.

    In Joseph form, symmetric and positive semidefinite at any gain.

    Args:
        P: Prior covariance (n, n).
        H: Jacobian (m, n) of the predicted measurement.
        R: Measurement covariance (m, m).
        e: Innovation (m,), measured minus predicted.
        considered: Which states (n,) are not corrected.

    Returns:
        The correction K e (n,) and the posterior covariance (n, n).

    Source: S. F. Schmidt, "Application of state-space methods to navigation problems", 1966.
    """
    PHt = P @ np.ascontiguousarray(H.T)
    S = symmetric(H @ PHt + R)
    K = np.ascontiguousarray(np.linalg.solve(S, np.ascontiguousarray(PHt.T)).T)
    K[considered] = 0.0
    A = np.eye(P.shape[0]) - K @ H
    posterior = A @ P @ np.ascontiguousarray(A.T) + K @ R @ np.ascontiguousarray(K.T)
    return K @ e, symmetric(posterior)


@hot
def joseph_update(P: Array, H: Array, R: Array, e: Array) -> tuple[Array, Array]:
    """The correction of every state, see `schmidt_update`."""
    return schmidt_update(P, H, R, e, np.zeros(P.shape[0], dtype=np.bool_))


@hot
def nees(e: Array, P: Array) -> float:
    """Normalised error squared e^T P^-1 e of the error `e` (n,) under its covariance (n, n)."""
    return float(e @ np.linalg.solve(P, e))


@hot
def log_likelihood(e: Array, S: Array) -> float:
    """Log density of the innovation `e` (m,) under N(0, S), with S (m, m) positive definite."""
    L = np.linalg.cholesky(S)
    log_determinant = 2.0 * np.sum(np.log(np.diag(L)))
    return -0.5 * (nees(e, S) + log_determinant + e.size * np.log(2.0 * np.pi))


def chi_square_gate(exceeded: float, dof: int) -> float:
    """The squared Mahalanobis distance that is exceeded with a probability, to two decimals."""
    return round(float(scipy.special.chdtri(dof, exceeded)), 2)


def outlier_gate(dof: int) -> float:
    """The squared Mahalanobis distance from which on a measurement is taken for an outlier."""
    return chi_square_gate(FALSE_ALARM, dof)


def diagonal_blocks(P: Array) -> Array:
    """The (K, 3, 3) blocks on the diagonal of a covariance (3K, 3K)."""
    k = np.arange(len(P) // 3)
    return np.asarray(P.reshape(len(k), 3, len(k), 3)[k, :, k, :])
