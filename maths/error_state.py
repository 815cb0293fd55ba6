"""Error-state Kalman filters: covariances of a pose on its manifold beside other states.

The mean lives where it belongs (a pose in SE(3), a position in R^3, ...); its error is a vector in
the tangent space there, X = X_mean exp(xi), whose parts are slices. After a correction the filter
moves the mean by the error's estimate, and the error starts from zero again. These functions do
what every such filter does with its covariance; none changes its arguments.

Source: J. Sola, Quaternion kinematics for the error-state Kalman filter, 2017, chapter 6.
"""

import numpy as np
import scipy.linalg

from crossmodal.maths.arrays import Array, Mask


def propagate(P: Array, part: slice, F: Array) -> Array:
    """The covariance (n, n) after the error of one part was mapped by `F` (k, k)."""
    P = P.copy()
    P[part] = F @ P[part]
    P[:, part] = P[:, part] @ F.T
    return P


def inflate(P: Array, part: slice, Q: Array) -> Array:
    """The covariance (n, n) after noise with covariance `Q` (k, k) was added to one part."""
    P = P.copy()
    P[part, part] += Q
    return P


def fade(x: Array, P: Array, part: slice, rho: float) -> tuple[Array, Array]:
    """Mean (n,) and covariance (n, n) after one step of a Gauss-Markov process of unit variance.

    The part keeps the share `rho` of its value, exp(-dt / tau), and gets new noise for the rest;
    without any share it is back at its prior, and independent of all others.
    """
    x, P = x.copy(), P.copy()
    x[part] *= rho
    P[part] *= rho
    P[:, part] *= rho
    index = np.arange(part.start, part.stop)
    P[index, index] += 1.0 - rho**2
    return x, P


def reset(P: Array, part: slice, own: Array | float) -> Array:
    """The covariance (n, n) after one part was found anew, with covariance `own` (k, k).

    Its new error has nothing in common with the other states'.
    """
    P = P.copy()
    P[part] = 0.0
    P[:, part] = 0.0
    P[part, part] = own
    return P


def augment(P: Array, cross: Array, own: Array) -> Array:
    """The covariance (n + k, n + k) with new states at its end.

    Args:
        P: Of the old states (n, n).
        cross: Of the new states with the old ones (k, n).
        own: Of the new states (k, k).
    """
    old, new = len(P), len(own)
    grown = np.zeros((old + new, old + new))
    grown[:old, :old] = P
    grown[old:, :old] = cross
    grown[:old, old:] = cross.T
    grown[old:, old:] = own
    return grown


def remove(P: Array, keep: Mask) -> Array:
    """The covariance of the states to keep (n,), the others marginalised."""
    return P[np.ix_(keep, keep)]


def update(P: Array, HP: Array, S: Array, e: Array) -> tuple[Array, Array]:
    """One Kalman correction for a measurement whose Jacobian H has few columns that count.

    The covariance shrinks by W^T W with W = L^-1 H P and L L^T = S: symmetric by construction.

    Args:
        P: Prior covariance (n, n).
        HP: Covariance (m, n) of the predicted measurement with the state.
        S: Covariance (m, m) of the innovation.
        e: Innovation (m,), measured minus predicted.

    Returns:
        The error's estimate (n,) and the posterior covariance (n, n).
    """
    L = scipy.linalg.cholesky(S, lower=True, check_finite=False)
    W = scipy.linalg.solve_triangular(L, HP, lower=True, check_finite=False)
    whitened = scipy.linalg.solve_triangular(L, e, lower=True, check_finite=False)
    posterior = P - W.T @ W
    return W.T @ whitened, 0.5 * (posterior + posterior.T)
