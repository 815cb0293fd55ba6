"""Bayesian regression of the force that a joint takes, with noise of unknown size and memory.

Measured are spatial forces F_k; the generalised force y_k = S · F_k depends on a screw S that is
itself only believed. With regressors phi_k and constant errors c ~ N(0, I) of what was measured,

    S · F_k = phi_k · theta + h_k · c + e_k,    e_k = rho e_{k-1} + sqrt(1 - rho^2) sigma white,

the second moments of z_k = (phi_k, F_k, h_k) and of neighbouring ones are sufficient: whatever S is
believed later, all forces so far count as if it had been known. Size sigma and memory rho of the
noise are averaged over, on a grid, by their evidence. The error of S is regressed too.

Source: of the regression with known noise, C. M. Bishop, Pattern Recognition and Machine Learning,
2006, section 3.3.
"""

from dataclasses import dataclass, replace

import numpy as np

from maths.arrays import Array
from maths.immutable import Immutable

MEMORIES = np.array([0.0, 0.5, 0.8, 0.9, 0.95, 0.98])  # rho


@dataclass(frozen=True, kw_only=True)
class ForceMoments(Immutable):
    """Second moments (n, n) of z and their counts.

    Attributes:
        first: Of the first z of each unbroken sequence.
        now: Of all others.
        lag: Of those with the ones before them.
        before: Of the ones before them.
        starts: Sequences.
        pairs: Other samples.
        last: The latest z (n,); None where the next one starts a sequence.
    """

    first: Array
    now: Array
    lag: Array
    before: Array
    starts: int = 0
    pairs: int = 0
    last: Array | None = None

    @property
    def samples(self) -> int:
        return self.starts + self.pairs


def no_moments(size: int) -> ForceMoments:
    zero = np.zeros((size, size))
    return ForceMoments(first=zero, now=zero, lag=zero, before=zero)


def observe(moments: ForceMoments, z: Array) -> ForceMoments:
    """The moments with one more sample z (n,)."""
    last = moments.last
    if last is None:
        first = moments.first + np.outer(z, z)
        return replace(moments, first=first, starts=moments.starts + 1, last=z)
    return replace(
        moments,
        now=moments.now + np.outer(z, z),
        lag=moments.lag + np.outer(z, last),
        before=moments.before + np.outer(last, last),
        pairs=moments.pairs + 1,
        last=z,
    )


@dataclass(frozen=True, kw_only=True)
class ForceFit:
    """theta (p,), its covariance (p, p), and the standard deviation of the noise."""

    theta: Array
    covariance: Array
    noise: float


def square_root(P: Array) -> Array:
    """L with L L^T = P (n, n), which may be singular."""
    values, vectors = np.linalg.eigh(P)
    return np.asarray(vectors * np.sqrt(np.maximum(values, 0.0)))


def fit_force(
    moments: ForceMoments, S: Array, S_covariance: Array, prior: Array, noises: Array
) -> ForceFit:
    """What the forces so far say of theta.

    Args:
        moments: Of z = (phi, F, h).
        S: The screw (6,) now.
        S_covariance: (6, 6).
        prior: Standard deviations (p,) of theta, whose prior mean is zero.
        noises: Grid (m,) of sigma.
    """
    p, size = len(prior), len(moments.first)
    target = np.zeros(size)
    target[p : p + 6] = S
    L = np.zeros((size, size))
    L[:p, :p] = np.diag(prior)
    L[p : p + 6, p : p + 6] = -square_root(S_covariance)
    L[p + 6 :, p + 6 :] = np.eye(size - p - 6)
    variances = noises**2
    weights, means, covariances = [], [], []
    for rho in MEMORIES:
        share = 1.0 - rho**2
        G = moments.now - rho * (moments.lag + moments.lag.T) + rho**2 * moments.before
        G = moments.first + G / share
        eigenvalues, V = np.linalg.eigh(L.T @ G @ L)
        eigenvalues = np.maximum(eigenvalues, 0.0)
        w = V.T @ (L.T @ (G @ target))
        total = eigenvalues + variances[:, None]
        squares = (target @ G @ target - np.sum(w**2 / total, axis=1)) / variances
        log_det = moments.samples * np.log(variances) + moments.pairs * np.log(share)
        log_det = log_det + np.sum(np.log(total / variances[:, None]), axis=1)
        weights.append(-0.5 * (squares + log_det))
        to_theta = L[:p] @ V
        means.append((w / total) @ to_theta.T)
        shrunk = variances[:, None] / total
        covariances.append(np.einsum("ij,mj,kj->mik", to_theta, shrunk, to_theta))
    log_weight = np.concatenate(weights)
    weight = np.exp(log_weight - log_weight.max())
    weight = weight / weight.sum()
    mean = np.concatenate(means)
    theta = weight @ mean
    apart = mean - theta
    covariance = np.einsum("m,mik->ik", weight, np.concatenate(covariances))
    covariance += np.einsum("m,mi,mk->ik", weight, apart, apart)
    noise = float(np.sqrt(weight @ np.tile(variances, len(MEMORIES))))
    return ForceFit(theta=theta, covariance=covariance, noise=noise)
