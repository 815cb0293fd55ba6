"""A bounded memory of one body's relative poses: neighbours in time are averaged into keyframes.

Frame F is the measured reference pose of the child: X_PF, a constant. Keyframe k holds the mean
X_FB of one or more consecutive measurements, at their mean time, with the covariance of that mean
(right perturbation, in B). The mean of two poses lies on the geodesic between them, a screw motion,
so that the mean of two poses on a joint's path is on that path too, at any angle.

Of all neighbours, those are averaged that lose the least of the motion: what averaging loses is
that of J. H. Ward, "Hierarchical grouping to optimize an objective function", 1963, xi^T (R_i +
R_j)^-1 xi for keyframes that the motion has taken xi apart, which is estimated from their
neighbours, better than from their own noise. So a body at rest fills few keyframes however long it
rests, and motion is kept in even steps.
"""

from typing import NamedTuple

import numpy as np

from crossmodal.maths import cholesky
from crossmodal.maths.arrays import Array, Ids
from crossmodal.maths.compiled import assign, hot
from crossmodal.maths.se3 import so3_exp
from crossmodal.maths.se3_in_place import perturb, relative_log
from crossmodal.systems.kinematics.keyframes.measurement_noise import MEASURED

RECENT = 4  # Newest keyframes, which stay single measurements for the present velocity.
FIRST = 4  # Oldest keyframes, which are never marginalised: the motion started there.
MEMORY = 400.0  # Most log evidence that is kept of past measurements against a model, [nat].
_QUARTILE = 3.45  # A quarter of the losses of keyframes of the same pose are less: chi-square of 6.
_LARGEST = 8.7  # Ratio of the upper quantile to the quartile.
_EXCESS = 6.0  # Expected loss when two keyframes of the same pose are averaged: their dimension.


class Keyframes(NamedTuple):
    """Arrays of capacity K; the first `size[0]` rows are in use, oldest first.

    Attributes:
        size: (1,) keyframes in use.
        time: (K,) [s].
        Z: (K, 4, 4) X_FB.
        R: (K, 6, 6) covariance of its mean's white noise.
        floor: (6, 6) covariance of what does not average out within a keyframe: errors that depend
            on the place, and by what the child deviations from an ideal joint's path there.
        wander: (1,) variance of rotations' errors that are smooth in time, [rad^2].
        reference_deviates: (1,) one, or zero where the reference is exact, which then has no floor.
        W: (K, 6, 6) inverse of R and floor together.
        log_det: (K,) log determinant of both together.
        undecided: (K,) one while the keyframe may be an outlier, else zero. The association is
            fixed when the keyframe is averaged with another one or marginalised.
        W_out: (K, 6, 6) inverse covariance if it is an outlier; of undecided keyframes.
        log_out: (K,) log ratio of the two normalisers.
        streak: (K,) how many measurements in a row are outliers, up to this one or the last in it.
        outliers: (1,) expected number of outliers among those with a fixed association.
        free: (M,) log density ratio of each free motion (`free_motion`) over a joint in
            what has been averaged, at most zero.
        explained: (M,) log evidence of each free motion, `free` included, and what averaging has
            cost a joint since, of all keyframes but the newest ones that are pending; NaN if not
            known.
        pending: (1,) measurements since it was computed.
        spread: (1,) largest mean squared distance of a keyframe from the mean, in units of R.
    """

    size: Ids
    time: Array
    Z: Array
    R: Array
    floor: Array
    wander: Array
    reference_deviates: Array
    W: Array
    log_det: Array
    undecided: Array
    W_out: Array
    log_out: Array
    streak: Array
    outliers: Array
    free: Array
    explained: Array
    pending: Ids
    spread: Array


def empty_keyframes(capacity: int, free_motions: int) -> Keyframes:
    """A memory for `capacity` keyframes, which so many free motions explain."""
    return Keyframes(
        size=np.zeros(1, dtype=np.int64),
        time=np.zeros(capacity),
        Z=np.zeros((capacity, 4, 4)),
        R=np.zeros((capacity, 6, 6)),
        floor=np.zeros((6, 6)),
        wander=np.zeros(1),
        reference_deviates=np.zeros(1),
        W=np.zeros((capacity, 6, 6)),
        log_det=np.zeros(capacity),
        undecided=np.zeros(capacity),
        W_out=np.zeros((capacity, 6, 6)),
        log_out=np.zeros(capacity),
        streak=np.zeros(capacity),
        outliers=np.zeros(1),
        free=np.zeros(free_motions),
        explained=np.full(free_motions, np.nan),
        pending=np.zeros(1, dtype=np.int64),
        spread=np.zeros(1),
    )


def copy_keyframes(kf: Keyframes) -> Keyframes:
    """A copy that may be changed."""
    return Keyframes._make([x.copy() for x in kf])


@hot
def floor_share(kf: Keyframes, k: int) -> float:
    """One if keyframe k has the floor, else zero."""
    return kf.reference_deviates[0] if k == 0 else 1.0


@hot
def unaveraged(kf: Keyframes) -> Array:
    """Covariance (6, 6) of all errors that do not average out within a keyframe."""
    out = kf.floor.copy()
    for i in range(3):
        out[i, i] += kf.wander[0]
    return out


@hot
def measured_directions(kf: Keyframes, k: int) -> int:
    """In how many of six directions keyframe k was measured."""
    directions = 0
    for i in range(6):
        directions += 1 if kf.R[k, i, i] < MEASURED else 0
    return directions


@hot
def _fill(kf: Keyframes, k: int) -> None:
    """Completes keyframe k from its covariance."""
    L = kf.R[k] + floor_share(kf, k) * unaveraged(kf)
    six = int(np.int64(6))  # For a literal, Numba would compile all callees again.
    kf.log_det[k] = cholesky.factor(L, six)
    cholesky.inverse(L, kf.W[k], six)


@hot
def _fill_outlier(kf: Keyframes, k: int, outliers: Array) -> None:
    """Completes undecided keyframe k as an outlier; `outliers` as in `Priors`."""
    six = int(np.int64(6))
    L = kf.R[k] + floor_share(kf, k) * unaveraged(kf)
    for i in range(6):
        L[i, i] += outliers[1 + i]
    kf.log_out[k] = 0.5 * (kf.log_det[k] - cholesky.factor(L, six))
    cholesky.inverse(L, kf.W_out[k], six)


def _delete(kf: Keyframes, k: int) -> None:
    """Removes keyframe k."""
    n = kf.size[0]
    for x in (kf.time, kf.Z, kf.R, kf.W, kf.log_det, kf.undecided, kf.W_out, kf.log_out, kf.streak):
        x[k : n - 1] = x[k + 1 : n]
    kf.size[0] = n - 1


def remove(kf: Keyframes, k: int) -> None:
    """Removes keyframe k."""
    _delete(kf, k)
    kf.explained[:] = np.nan


def append(kf: Keyframes, X: Array, R: Array, time: float, outliers: Array) -> None:
    """Adds one measurement as a keyframe of its own; there must be room.

    Args:
        X: Measured X_FB (4, 4).
        R: Its covariance (6, 6).
        time: [s].
    """
    k = kf.size[0]
    kf.time[k] = time
    kf.Z[k], kf.R[k] = X, R
    _fill(kf, k)
    _fill_outlier(kf, k, outliers)
    kf.undecided[k] = 1.0 if outliers[0] > 0.0 else 0.0
    kf.size[0] = k + 1
    kf.pending[0] += 1


def rescale(
    kf: Keyframes, scale: Array, floor: Array, outliers: Array, wander: float | None = None
) -> None:
    """Multiplies the standard deviations of all keyframes by `scale` (6,), and sets their floor.

    Where `wander` is given, that of their rotations in time, too.
    """
    kf.floor[:] = floor
    if wander is not None:
        kf.wander[0] = wander
    kf.explained[:] = np.nan
    kf.R[: kf.size[0]] *= np.outer(scale, scale)
    for k in range(kf.size[0]):
        _fill(kf, k)
        if kf.undecided[k] > 0.0:
            _fill_outlier(kf, k, outliers)


@hot
def expected_noise(kf: Keyframes, k: int, inlier: float, R: Array) -> None:
    """Writes the expected covariance (6, 6) of undecided keyframe k into `R`."""
    six = int(np.int64(6))
    if inlier > 1.0 - 1e-9:
        assign(R, kf.R[k])
        return
    L = inlier * kf.W[k] + (1.0 - inlier) * kf.W_out[k]
    cholesky.factor(L, six)
    cholesky.inverse(L, R, six)
    R -= floor_share(kf, k) * unaveraged(kf)


def fix(kf: Keyframes, k: int, inlier: float) -> None:
    """Fixes the association of keyframe k: it gets the weight of an inlier of this probability."""
    if kf.undecided[k] == 0.0:
        return
    kf.undecided[k] = 0.0
    kf.outliers[0] += 1.0 - inlier
    expected_noise(kf, k, inlier, kf.R[k])
    _fill(kf, k)


def merge(kf: Keyframes, k: int, turn: Array) -> None:
    """Averages keyframes k and k + 1 with scalar weights, which keeps the mean on their screw.

    Args:
        turn: Rotation vector (3,) in F by which the child is taken to have turned from one to the
            other where its rotation was not measured: the mean of two positions is on their arc.
    """
    first, second = np.diagonal(kf.R[k]), np.diagonal(kf.R[k + 1])
    ratio, inverse = np.sqrt((first / second).sum()), np.sqrt((second / first).sum())
    weight = ratio / (ratio + inverse)
    xi, rotation = np.empty(6), kf.Z[k, :3, :3].copy()
    unmeasured = min(first[:3].min(), second[:3].min()) > MEASURED
    if unmeasured:
        kf.Z[k + 1, :3, :3] = so3_exp(turn) @ rotation
    relative_log(kf.Z[k], kf.Z[k + 1], xi)
    perturb(kf.Z[k], weight * xi, kf.Z[k])
    if unmeasured:
        kf.Z[k, :3, :3] = rotation
    kf.R[k] = (1.0 - weight) ** 2 * kf.R[k] + weight**2 * kf.R[k + 1]
    kf.time[k] = (1.0 - weight) * kf.time[k] + weight * kf.time[k + 1]
    kf.streak[k] = kf.streak[k + 1]
    _delete(kf, k + 1)
    _fill(kf, k)


@hot
def _spread(kf: Keyframes, R: Array) -> float:
    """Mean squared distance of the keyframes from their mean, in units of the newest covariance.

    R (K, 6, 6) are their covariances.
    """
    n = kf.size[0]
    newest = kf.R[n - 1]
    mean, square, total = np.zeros((3, 4)), 0.0, 0.0
    scale_r = 3.0 / (newest[0, 0] + newest[1, 1] + newest[2, 2]) / 2.0
    scale_t = 3.0 / (newest[3, 3] + newest[4, 4] + newest[5, 5])
    for k in range(n):
        m = newest[0, 0] / R[k, 0, 0]
        total += m
        for i in range(3):
            for j in range(4):
                scale = scale_t if j == 3 else scale_r
                mean[i, j] += m * np.sqrt(scale) * kf.Z[k, i, j]
                square += m * scale * kf.Z[k, i, j] ** 2
    for i in range(3):
        for j in range(4):
            square -= mean[i, j] ** 2 / total
    return square / total


@hot
def _loss(Z: Array, k: int, i: int, j: int, R: Array) -> float:
    """What averaging keyframes k and k + 1 loses if they are as far apart as i and j."""
    six, square = int(np.int64(6)), 0.0  # For a literal, Numba would compile all callees again.
    xi = np.empty(6)
    relative_log(Z[i], Z[j], xi)
    L = R[k] + R[k + 1]
    cholesky.factor(L, six)
    cholesky.forward(L, xi, six)
    for n in range(6):
        square += xi[n] * xi[n]
    return square


@hot
def _least_motion(kf: Keyframes, R: Array) -> int:
    """Which keyframe, averaged with the next, loses the least of the motion.

    Which measurements share a keyframe must not depend on their noise: if those were averaged whose
    noise happens to be alike, the others would be farther apart than noise makes them. So the step
    from one to the other is taken as a third of that between their neighbours; or as what noise
    does not explain of it, for a motion may begin or end at once. Of the
    reported and the apparent noise the smaller one counts, for either may be far too large.
    """
    first, last = 1, kf.size[0] - RECENT  # Keyframe 0 is the reference.
    losses = np.empty(last - first)
    for k in range(first, last):
        losses[k - first] = _loss(kf.Z, k, k, k + 1, R)
    noise = _LARGEST * min(np.quantile(losses, 0.25), _QUARTILE)
    best, least = first, np.inf
    for k in range(first, last):
        loss = max(_loss(kf.Z, k, k - 1, k + 2, R) / 9.0, losses[k - first] - noise)
        if loss < least:
            best, least = k, loss
    return best


@hot
def choose(kf: Keyframes, coarseness: float, inlier: Array) -> tuple[int, bool]:
    """What to do for room: (k, True) to average k and k + 1, or (k, False) to marginalise k.

    Averages that span more than `coarseness` of the whole motion's mean square, as in a body that
    goes to and fro for long, would lose what it has shown: an old keyframe is marginalised instead.

    Args:
        inlier: (K,) probability of each undecided keyframe that it is an inlier.
    """
    n = kf.size[0]
    R = kf.R.copy()
    for k in range(n):
        if kf.undecided[k] > 0.0:
            expected_noise(kf, k, inlier[k], R[k])
    best = _least_motion(kf, R)
    loss = _loss(kf.Z, best, best, best + 1, R)
    kf.spread[0] = max(kf.spread[0], _spread(kf, R))
    newest = kf.R[n - 1, 0, 0]
    m = newest / R[best, 0, 0] + newest / R[best + 1, 0, 0]
    if loss > 10.0 * _EXCESS and loss / m > coarseness * kf.spread[0]:
        return FIRST, False
    return best, True
