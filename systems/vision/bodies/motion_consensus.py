"""Rigid motions that many features share, by seeded RANSAC with the features' own covariances."""

from dataclasses import dataclass

import numpy as np

from crossmodal.maths import se3
from crossmodal.maths.arrays import Array, Ids, Mask
from crossmodal.maths.rigid_points import pose_jacobian
from crossmodal.systems.vision.bodies.feature_displacements import Displacements, squared_distances


@dataclass(kw_only=True)
class Consensus:
    """A motion p_new = X p_old (world axes) and the features that follow it.

    Attributes:
        X: (4, 4).
        support: Features (N,) that fit it, and fit it better than standing still.
        gain: Sum over these of how much lower their squared Mahalanobis distance is.
    """

    X: Array
    support: Mask
    gain: float


def rigid_motions(p: Array, q: Array) -> Array:
    """Least squares motions X (K, 4, 4) with q = X p, of K sets of points (K, M, 3).

    Source: W. Kabsch, A solution for the best rotation to relate two sets of vectors, 1976.
    """
    p_mean, q_mean = p.mean(axis=1), q.mean(axis=1)
    H = (p - p_mean[:, None]).transpose(0, 2, 1) @ (q - q_mean[:, None])
    U, _, Vt = np.linalg.svd(H)
    reflection = np.tile(np.eye(3), (len(p), 1, 1))
    reflection[:, 2, 2] = np.sign(np.linalg.det(U) * np.linalg.det(Vt))
    R = Vt.transpose(0, 2, 1) @ reflection @ U.transpose(0, 2, 1)
    X = np.tile(np.eye(4), (len(p), 1, 1))
    X[:, :3, :3] = R
    X[:, :3, 3] = q_mean - np.einsum("kij,kj->ki", R, p_mean)
    return X


def _hypotheses(d: Displacements, movers: Ids, rng: np.random.Generator) -> Array:
    """Translations of single features and rigid motions of triples, (K, 4, 4)."""
    count = 40
    single = movers if len(movers) <= count else rng.choice(movers, count, replace=False)
    translations = np.tile(np.eye(4), (len(single), 1, 1))
    translations[:, :3, 3] = d.p_new[single] - d.p_old[single]
    if len(movers) < 3:
        return translations
    order = np.argsort(rng.random((count, len(movers))), axis=1)[:, :3]
    triples = movers[order]
    return np.concatenate([translations, rigid_motions(d.p_old[triples], d.p_new[triples])])


def refine_motion(X: Array, d: Displacements, support: Mask, rotation_sigma: float) -> Array:
    """Gauss-Newton on the supporting features, with a weak prior of no rotation about their mean.

    The prior keeps a rotation that a few noisy features cannot tell from zero.
    """
    p, q = d.p_old[support], d.p_new[support]
    S_inverse = np.linalg.inv(d.C_old[support] + d.C_new[support])
    centre = p.mean(axis=0)
    Y = np.eye(4)  # The motion about the centre: q - centre = Y (p - centre).
    Y[:3, :3] = X[:3, :3]
    Y[:3, 3] = X[:3, :3] @ centre + X[:3, 3] - centre
    for _ in range(3):
        J = Y[:3, :3] @ pose_jacobian(p - centre)
        residual = q - centre - (p - centre) @ Y[:3, :3].T - Y[:3, 3]
        normal = np.einsum("nia,nij,njb->ab", J, S_inverse, J)
        moment = np.einsum("nia,nij,nj->a", J, S_inverse, residual)
        normal[:3, :3] += np.eye(3) / rotation_sigma**2
        moment[:3] -= se3.so3_log(np.ascontiguousarray(Y[:3, :3])) / rotation_sigma**2
        Y = Y @ se3.exp(np.linalg.solve(normal, moment))
    refined = Y.copy()
    refined[:3, 3] = Y[:3, 3] + centre - Y[:3, :3] @ centre
    return refined


def find_consensus(
    d: Displacements,
    still: Array,
    movers: Ids,
    rng: np.random.Generator,
    *,
    gate: float,
    support_gate: float,
    rotation_sigma: float,
) -> Consensus | None:
    """The motion that explains best what standing still does not.

    Args:
        d: Earlier and newest positions of N features.
        still: Squared Mahalanobis distances (N,) of standing still.
        movers: Features from which hypotheses are drawn.
        rng: For the draws, seeded.
        gate: Largest squared distance at which a feature fits a motion.
        support_gate: Least squared distance by which standing still fits a supporter worse.
        rotation_sigma: Prior standard deviation of the rotation, [rad].
    """
    if len(movers) == 0:
        return None
    S = d.C_old + d.C_new
    S_inverse = np.linalg.inv(S)
    X = _hypotheses(d, movers, rng)
    e = d.p_new - np.einsum("kij,nj->kni", X[:, :3, :3], d.p_old) - X[:, None, :3, 3]
    moved = np.einsum("kni,nij,knj->kn", e, S_inverse, e)
    gains = np.where(moved < gate, np.clip(np.minimum(still, 10.0 * gate) - moved, 0.0, None), 0.0)
    best = X[np.argmax(gains.sum(axis=1))]
    support = np.zeros(len(still), bool)
    for _ in range(2):
        e = d.p_new - d.p_old @ best[:3, :3].T - best[:3, 3]
        distance, _ = squared_distances(e, S)
        support = (distance < gate) & (still - distance > support_gate)
        if not support.any():
            return None
        best = refine_motion(best, d, support, rotation_sigma)
    e = d.p_new - d.p_old @ best[:3, :3].T - best[:3, 3]
    distance, _ = squared_distances(e, S)
    support = (distance < gate) & (still - distance > support_gate)
    return Consensus(X=best, support=support, gain=float(np.sum((still - distance)[support])))


def stillness(
    p_W: Array, information: Array, p_rest: Array, displacement: Array
) -> tuple[Array, Array]:
    """How much of a displacement features had made at each tick, and its standard deviation.

    s_k minimises sum_n |p_nk - p_rest_n - s_k displacement_n|^2, weighted with the information.

    Args:
        p_W: Positions (N, H, 3).
        information: (N, H, 3, 3), zero where not seen.
        p_rest: Positions before the motion (N, 3).
        displacement: Of each feature by the whole motion (N, 3).

    Returns:
        Shares (H,), NaN at ticks when none was seen, and standard deviations (H,).
    """
    weighted = np.einsum("nhij,nj->nhi", information, displacement)
    moment = np.einsum("nhi,nhi->h", weighted, p_W - p_rest[:, None])
    total = np.einsum("nhi,ni->h", weighted, displacement)
    seen = total > 0.0
    share = np.where(seen, moment / np.where(seen, total, 1.0), np.nan)
    return share, 1.0 / np.sqrt(np.where(seen, total, np.nan))
