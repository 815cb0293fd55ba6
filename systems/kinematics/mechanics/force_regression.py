"""Bayesian regression of the force that a joint takes, with noise of unknown size and correlation.

Measured are spatial forces F_k; the force on the joint, y_k = S · F_k, depends on a screw S that is
itself only believed. With regressors phi_k,

    S · F_k = phi_k · theta + e_k,    e_k = rho e_{k-1} + sqrt(1 - rho^2) sigma white.

Second moments of z_k = (phi_k, F_k) and of neighbouring ones are sufficient: whatever S is believed
later, all forces so far count as if it had been known. Size sigma and memory rho of the noise are
averaged over, on a grid, by their evidence. For given ones theta is linear in S, so that an error
of S, which no number of samples averages away, is carried over as it is.

Friction is not the same everywhere, and may happen to vary as the speed does. So theta + delta is
measured, where delta has the covariance that one sample in every direction of phi would leave whose
force is off by a share u of what was measured. No number of samples averages that away.

Source: of the regression with known noise, C. M. Bishop, Pattern Recognition and Machine Learning,
2006, section 3.3.
"""

from dataclasses import dataclass, replace

import numpy as np

from crossmodal.maths.arrays import Array
from crossmodal.maths.immutable import Immutable

# rho between samples; at 15 Hz from none to some 7 s.
MEMORIES = np.array([0.0, 0.5, 0.8, 0.9, 0.95, 0.98, 0.99])


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


def rms_force(moments: ForceMoments, S: Array) -> float:
    """Root mean square of S · F over all samples; there must be one."""
    total = moments.first + moments.now
    return float(np.sqrt(S @ total[-6:, -6:] @ S / moments.samples))


@dataclass(frozen=True, kw_only=True)
class ForceFit:
    """The posterior by the forces so far.

    Attributes:
        theta: Mean (p,).
        spread: Its covariance (p, p) if S were known.
        by_screw: Change of theta per change of S (p, 6).
        noise: Standard deviation of what is not explained.
    """

    theta: Array
    spread: Array
    by_screw: Array
    noise: float

    def covariance(self, S_covariance: Array) -> Array:
        """Of theta (p, p), with that of the screw (6, 6)."""
        return np.asarray(self.spread + self.by_screw @ S_covariance @ self.by_screw.T)


def fit_force(
    moments: ForceMoments, S: Array, prior: Array, noises: Array, unevenness: float
) -> ForceFit:
    """The posterior of theta.

    Args:
        moments: Of z = (phi, F).
        S: The screw (6,) as it is believed now.
        prior: Standard deviations (p,) of theta, whose prior mean is zero.
        noises: Grid (m,) of sigma.
    """
    p, rho = len(prior), MEMORIES[:, None, None]
    share, lag = 1.0 - rho**2, moments.lag + moments.lag.T
    G = moments.first + (moments.now - rho * lag + rho**2 * moments.before) / share
    P = np.diag(prior**2)
    precision = np.linalg.inv(P + _delta(moments, S, prior, unevenness))
    gain = P @ precision
    # By memory and size of the noise, (r, m, ...): of theta + delta.
    variance = noises**2
    information = G[:, None, :p, :] / variance[:, None, None]
    A = information[..., :p] + precision
    inverse = np.linalg.inv(A)
    to_mean = inverse @ information[..., p:]
    mean = to_mean @ S
    squares = (S @ G[:, p:, p:] @ S)[:, None] / variance
    squares = squares - np.sum((information[..., p:] @ S) * mean, axis=-1)
    log_size = moments.samples * np.log(variance) + moments.pairs * np.log(share[:, :, 0])
    log_weight = -0.5 * (squares + log_size + np.linalg.slogdet(A)[1])
    weight = np.exp(log_weight - log_weight.max())
    weight = weight / weight.sum()
    total = np.einsum("rm,rmp->p", weight, mean)
    apart = mean - total
    spread = np.einsum("rm,rmpq->pq", weight, inverse)
    spread += np.einsum("rm,rmp,rmq->pq", weight, apart, apart)
    return ForceFit(
        theta=gain @ total,
        spread=P - gain @ P + gain @ spread @ gain.T,
        by_screw=gain @ np.einsum("rm,rmpj->pj", weight, to_mean),
        noise=float(np.sqrt(np.sum(weight * variance))),
    )


def _delta(moments: ForceMoments, S: Array, prior: Array, unevenness: float) -> Array:
    """Covariance (p, p) of delta; zero in directions that no motion has shown."""
    p, total = len(prior), moments.first + moments.now
    squares = unevenness**2 * float(S @ total[p:, p:] @ S)
    values, vectors = np.linalg.eigh(prior[:, None] * total[:p, :p] * prior)
    shown = values > 1e-9 * values[-1]
    root = prior[:, None] * vectors[:, shown] / np.sqrt(values[shown])
    return squares * (root @ root.T)
