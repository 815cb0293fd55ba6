"""The measurement model with outliers: a mixture of two normal distributions, compiled.

A measured pose has the reported error, or with a small probability a far larger one on top. Which
of the two is undecided until the measurement is averaged with another one; until then each model
estimates it by the residuals of its own solution (expectation maximisation). Then the association
is fixed: the keyframe gets a weight by all models together.
"""

import numpy as np

from crossmodal.maths.arrays import Array
from crossmodal.maths.compiled import hot


@hot
def inlier_share(inlier: float, outlier: float, share: float) -> tuple[float, float]:
    """Of two log densities: the first one's posterior probability, and the mixture's log density.

    Args:
        inlier: Log density without the larger error.
        outlier: Log density with it.
        share: Prior probability of an outlier.
    """
    if share <= 0.0:
        return 1.0, inlier
    a, b = np.log(1.0 - share) + inlier, np.log(share) + outlier
    top = max(a, b)
    mixture = top + np.log(np.exp(a - top) + np.exp(b - top))
    return np.exp(a - mixture), mixture


@hot
def blend(W: Array, W_out: Array, k: int, inlier: float, out: Array) -> None:
    """Writes the expected information (6, 6) of keyframe k into `out`."""
    for i in range(6):
        for j in range(6):
            out[i, j] = inlier * W[k, i, j] + (1.0 - inlier) * W_out[k, i, j]


@hot
def weigh_residual(
    W: Array,
    W_out: Array,
    log_out: Array,
    k: int,
    r: Array,
    spared: Array,
    share: float,
    temper: float,
) -> tuple[float, float]:
    """Probability that keyframe k is an inlier, and the log density of its residual.

    Arrays are passed one by one for speed.

    Args:
        r: (6,) residual.
        spared: (6,) direction in which the residual does not count, or zero.
        share: Prior probability of an outlier.
        temper: Factor on the covariances; above one where the solution is far off.
    """
    inside, outside = squared_residual(W, k, r, spared), squared_residual(W_out, k, r, spared)
    return inlier_share(-0.5 * inside / temper, log_out[k] - 0.5 * outside / temper, share)


@hot
def squared_residual(W: Array, k: int, r: Array, spared: Array) -> float:
    """r^T W_k r without its part along `spared`."""
    rr, rs, ss = 0.0, 0.0, 0.0
    for i in range(6):
        a, b = 0.0, 0.0
        for j in range(6):
            a += W[k, i, j] * r[j]
            b += W[k, i, j] * spared[j]
        rr += r[i] * a
        rs += r[i] * b
        ss += spared[i] * b
    return rr - rs * rs / ss if ss > 0.0 else rr
