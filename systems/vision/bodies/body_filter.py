"""Extended Kalman filter of one rigid body's motion together with the landmarks of its features.

A landmark is a feature's constant position p_BF in the body. Landmarks are part of the state, so
that the errors they share with the pose, and with one another, are known: a landmark measured while
the body stood at its reference is independent of all later ones, a landmark born while it moves
inherits the pose's error of that instant, and none is counted twice.

Error state: (rotation, translation of X_WB in B; velocity V_WB_B; landmarks in B), with
X_WB = X_mean exp(xi). Measurement in B: X_WB^-1 p_WF - p_BF, whose Jacobian is constant in B.
"""

from dataclasses import dataclass, replace

import numpy as np
import scipy.linalg

from crossmodal.maths import error_state, se3
from crossmodal.maths.arrays import Array, Ids, Mask
from crossmodal.maths.gaussian import diagonal_blocks
from crossmodal.maths.immutable import Immutable
from crossmodal.maths.rigid_points import pose_jacobian
from crossmodal.systems.vision.camera_geometry import transform

_POSE = slice(0, 6)
_MOTION = 12
_EXACT = 1e-12  # Variance of a position that is known exactly, [m^2].


@dataclass(kw_only=True)
class BodyFilter(Immutable):
    """Mean and covariance; never written after it is made.

    Attributes:
        X: X_WB (4, 4).
        V: V_WB_B (6,), [rad/s, m/s].
        ids: Features with a landmark (K,).
        p_BF: Landmarks (K, 3), [m].
        late: Which landmarks (K,) were placed in B by a pose later than the reference, and are
            wrong as that pose was.
        p_BF_initial: Landmarks when they were added (K, 3), [m].
        initial_covariance: Joint covariance (3K, 3K) of the landmarks when they were added, [m^2];
            those that were added together share the pose's error.
        P: Covariance (12 + 3K, 12 + 3K).
    """

    X: Array
    V: Array
    ids: Ids
    p_BF: Array
    late: Mask
    p_BF_initial: Array
    initial_covariance: Array
    P: Array

    @property
    def landmark_blocks(self) -> Array:
        """Marginal covariances of the landmarks (K, 3, 3), [m^2]."""
        return diagonal_blocks(self.landmark_covariance)

    @property
    def landmark_covariance(self) -> Array:
        """Joint covariance of the landmarks (3K, 3K), [m^2]."""
        return self.P[_MOTION:, _MOTION:].copy()

    @property
    def of_landmarks(self) -> Array:
        """Covariance (6, 6), in B, of what the pose's error shares with those of the landmarks."""
        if not len(self.ids):
            return np.zeros((6, 6))
        of_landmarks = self.P[_MOTION:, _MOTION:] + _EXACT * np.eye(3 * len(self.ids))
        square_root = scipy.linalg.cholesky(of_landmarks, lower=True)
        shared = scipy.linalg.solve_triangular(square_root, self.P[_MOTION:, _POSE], lower=True)
        return np.asarray(shared.T @ shared)


def at_reference(X_WB: Array, sigma_V: Array) -> BodyFilter:
    """A body at its reference pose, known by definition, with velocity 0 +- `sigma_V` (6,)."""
    P = np.zeros((_MOTION, _MOTION))
    P[6:, 6:] = np.diag(sigma_V**2)
    return BodyFilter(
        X=X_WB,
        V=np.zeros(6),
        ids=np.zeros(0, np.int64),
        p_BF=np.zeros((0, 3)),
        late=np.zeros(0, bool),
        p_BF_initial=np.zeros((0, 3)),
        initial_covariance=np.zeros((0, 0)),
        P=P,
    )


def predict(
    body: BodyFilter, dt: float, acceleration: Array, landmark_walk: float, turn_walk: float
) -> BodyFilter:
    """Constant velocity for `dt` [s], driven by white acceleration.

    Args:
        body: At the last tick.
        dt: Time since the last tick, [s].
        acceleration: Spectral densities (6,), [rad^2/s^3, m^2/s^3].
        landmark_walk: Drift of the landmarks, [m/sqrt(s)].
        turn_walk: The same per turn of the body, which changes how patches look, [m/sqrt(rad)].
    """
    step = se3.exp(body.V * dt)
    F = np.eye(_MOTION)
    F[:6, :6] = se3.adjoint(se3.inverse(step))
    F[:6, 6:] = se3.right_jacobian(body.V * dt) * dt
    P = error_state.propagate(body.P, slice(0, _MOTION), F)
    Q = np.diag(acceleration)
    P[:6, :6] += Q * dt**3 / 3.0
    P[:6, 6:_MOTION] += Q * dt**2 / 2.0
    P[6:_MOTION, :6] += Q * dt**2 / 2.0
    P[6:_MOTION, 6:_MOTION] += Q * dt
    landmarks = np.arange(_MOTION, len(P))
    turn = float(np.linalg.norm(body.V[:3])) * dt
    P[landmarks, landmarks] += landmark_walk**2 * dt + turn_walk**2 * turn
    return replace(body, X=body.X @ step, P=P)


def in_body(X_WB: Array, p_WF: Array, covariance: Array) -> tuple[Array, Array]:
    """Positions (K, 3) and covariances (K, 3, 3) expressed in B."""
    R = X_WB[:3, :3]
    return (p_WF - X_WB[:3, 3]) @ R, R.T @ covariance @ R


def innovation_blocks(body: BodyFilter, index: Ids, R_B: Array) -> Array:
    """Each feature's innovation covariance (K, 3, 3), for landmarks `index` and noise `R_B`."""
    J = pose_jacobian(body.p_BF[index])
    rows = _MOTION + 3 * index[:, None] + np.arange(3)
    cross = J @ body.P[_POSE][:, rows].transpose(1, 0, 2)
    own = body.P[rows[:, :, None], rows[:, None, :]]
    S = J @ body.P[_POSE, _POSE] @ J.transpose(0, 2, 1) + cross + cross.transpose(0, 2, 1)
    return np.asarray(S + own + R_B)


def agreeing(body: BodyFilter, index: Ids, p_WF: Array, covariance: Array, gate: float) -> Mask:
    """Which features (K,) agree with one pose near the predicted one.

    A gate on the prediction lets a far outlier pass while the pose is uncertain, and that one turns
    the body. So a robust fit comes first: reweighted least squares with the prediction as prior and
    Geman-McClure weights whose width shrinks to the gate; features then have to fit its pose.

    Args:
        body: Predicted.
        index: Landmarks of the features (K,).
        p_WF: Where they were seen (K, 3).
        covariance: (K, 3, 3).
        gate: Squared Mahalanobis distance of 3 dof.
    """
    if len(index) == 0:
        return np.zeros(0, bool)
    z, R_B = in_body(body.X, p_WF, covariance)
    innovation = z - body.p_BF[index]
    J = pose_jacobian(z)
    S = R_B + body.landmark_blocks[index]
    S_inverse = np.linalg.inv(S)
    JS = J.transpose(0, 2, 1) @ S_inverse
    normals = JS @ J
    moments = np.einsum("kai,ki->ka", JS, innovation)
    prior = np.linalg.inv(body.P[_POSE, _POSE] + 1e-12 * np.eye(6))
    x = np.zeros(6)
    width = np.inf
    for _ in range(6):
        residual = innovation - J @ x
        distance = np.einsum("ki,kij,kj->k", residual, S_inverse, residual)
        width = max(gate, min(0.5 * width, 2.0 * float(np.median(distance))))
        weight = (width / (width + distance)) ** 2
        x = np.linalg.solve(prior + np.einsum("k,kab->ab", weight, normals), weight @ moments)
    posterior = np.linalg.inv(prior + np.einsum("k,kab->ab", weight, normals))
    residual = innovation - J @ x
    S = S + J @ posterior @ J.transpose(0, 2, 1)
    return np.asarray(np.einsum("ki,kij,kj->k", residual, np.linalg.inv(S), residual) < gate)


def correct(body: BodyFilter, index: Ids, p_WF: Array, covariance: Array) -> BodyFilter:
    """The filter after the features at landmarks `index` (K,) were seen at `p_WF` (K, 3)."""
    count = len(index)
    if count == 0:
        return body
    z, R_B = in_body(body.X, p_WF, covariance)
    J = pose_jacobian(body.p_BF[index])
    rows = (_MOTION + 3 * index[:, None] + np.arange(3)).ravel()
    HP = (J.reshape(-1, 6) @ body.P[_POSE]) + body.P[rows]
    S = HP[:, _POSE] @ J.reshape(-1, 6).T + HP[:, rows]
    S = 0.5 * (S + S.T)
    blocks = np.arange(3 * count).reshape(count, 3)
    S[blocks[:, :, None], blocks[:, None, :]] += R_B
    dx, P = error_state.update(body.P, HP, S, (z - body.p_BF[index]).ravel())
    return _moved(replace(body, P=P), dx[_POSE], dx[_POSE.stop :])


def _with_pose(body: BodyFilter) -> Array:
    """How velocity and late landmarks (6 + 3K, 6) in B are wrong if X_WB is, d(V, p)/dxi."""
    J = np.where(body.late[:, None, None], pose_jacobian(body.p_BF), 0.0)
    return np.concatenate([se3.bracket(body.V), -J.reshape(-1, 6)])


def _moved(body: BodyFilter, xi: Array, others: Array) -> BodyFilter:
    """The filter corrected by `xi` (6,) of its pose and `others` (6 + 3K,) of all else.

    What a camera sees are velocity and late landmarks in W. If the pose is wrong, they are wrong in
    B such that they are right in W, however far that turns them. So they are corrected in W, then
    expressed in the corrected B, and their covariance with them. If the corrections were added up
    in B, a pose that nothing determines would seem to become known.

    Source: the idea is the invariant error of A. Barrau and S. Bonnabel, An EKF-SLAM algorithm with
    consistency properties, 2015.
    """
    before = _with_pose(body)
    seen = others - before @ xi
    back = se3.exp(-xi)
    p_BF = body.p_BF + seen[6:].reshape(-1, 3)
    p_BF[body.late] = transform(back, p_BF[body.late])
    V = se3.adjoint(back) @ (body.V + seen[:6])
    moved = replace(body, X=body.X @ se3.exp(xi), V=V, p_BF=p_BF)
    P = body.P.copy()
    change = _with_pose(moved) - before
    P[_POSE.stop :] += change @ P[_POSE]
    P[:, _POSE.stop :] += P[:, _POSE] @ change.T
    return replace(moved, P=0.5 * (P + P.T))


def _shrunk_cross_covariance(C: Array, P: Array, cross: Array) -> Array:
    """The cross covariance (n, m) of some states with others that goes with a covariance C.

    Where C is smaller than P, the cross covariance shrinks in proportion to the standard deviation,
    so that C, it and the others' covariance together are a covariance.

    Args:
        C: Covariance (n, n) of the states at another time.
        P: Their present covariance (n, n).
        cross: Their present cross covariance (n, m) with the others.
    """
    P = P + _EXACT * np.eye(len(P))
    ratio, W = scipy.linalg.eigh(C, P)
    return np.asarray(P @ (W * np.sqrt(np.clip(ratio, 0.0, 1.0))) @ (W.T @ cross))


def _extended(
    body: BodyFilter, ids: Ids, p_BF: Array, rows: Array, blocks: Array, late: bool
) -> BodyFilter:
    """Appends landmarks; `rows` (3K, n) is their covariance with the state, `blocks` their own."""
    grown = replace(
        body,
        ids=np.concatenate([body.ids, ids]),
        p_BF=np.concatenate([body.p_BF, p_BF]),
        late=np.concatenate([body.late, np.full(len(ids), late)]),
        p_BF_initial=np.concatenate([body.p_BF_initial, p_BF]),
        P=error_state.augment(body.P, rows, blocks),
    )
    initial_covariance = grown.landmark_covariance
    known = 3 * len(body.ids)
    if known and len(ids):
        cross = _shrunk_cross_covariance(
            body.initial_covariance, body.landmark_covariance, initial_covariance[:known, known:]
        )
        initial_covariance[:known, known:], initial_covariance[known:, :known] = cross, cross.T
    initial_covariance[:known, :known] = body.initial_covariance
    return replace(grown, initial_covariance=initial_covariance)


def add_reference_landmarks(
    body: BodyFilter, ids: Ids, X_WB_reference: Array, p_WF: Array, covariance: Array
) -> BodyFilter:
    """Landmarks from positions (K, 3) averaged while the body stood at its reference."""
    p_BF, R_B = in_body(X_WB_reference, p_WF, covariance)
    blocks = scipy.linalg.block_diag(*R_B) if len(ids) else np.zeros((0, 0))
    return _extended(body, ids, p_BF, np.zeros((3 * len(ids), len(body.P))), blocks, False)


def add_current_landmarks(body: BodyFilter, ids: Ids, p_WF: Array, covariance: Array) -> BodyFilter:
    """Landmarks from positions (K, 3) at the present pose, whose error they inherit.

    p_BF = X_WB^-1 p_WF moves by -J xi with the pose's error.
    """
    p_BF, R_B = in_body(body.X, p_WF, covariance)
    J = -pose_jacobian(p_BF).reshape(-1, 6)
    blocks = J @ body.P[_POSE, _POSE] @ J.T
    if len(ids):
        blocks += scipy.linalg.block_diag(*R_B)
    return _extended(body, ids, p_BF, J @ body.P[_POSE], blocks, True)


def with_known_pose(body: BodyFilter) -> BodyFilter:
    """The filter whose pose is right by definition."""
    return replace(body, P=error_state.reset(body.P, _POSE, 0.0))


def remove_landmarks(body: BodyFilter, ids: Ids) -> BodyFilter:
    """The filter without the landmarks of these features."""
    keep = ~np.isin(body.ids, ids)
    if keep.all():
        return body
    rows = np.concatenate([np.ones(_MOTION, bool), np.repeat(keep, 3)])
    return replace(
        body,
        ids=body.ids[keep],
        p_BF=body.p_BF[keep],
        late=body.late[keep],
        p_BF_initial=body.p_BF_initial[keep],
        initial_covariance=error_state.remove(body.initial_covariance, rows[_MOTION:]),
        P=error_state.remove(body.P, rows),
    )


def drifted(body: BodyFilter, gate: float) -> Mask:
    """Which landmarks (K,) have moved farther since they were added than their covariance allowed.

    A patch that lies on two surfaces slides slowly, and its landmark follows.
    """
    e = body.p_BF - body.p_BF_initial
    return np.asarray(
        np.einsum("ki,kij,kj->k", e, np.linalg.inv(diagonal_blocks(body.initial_covariance)), e)
        > gate
    )


def reset_to_initial(body: BodyFilter, sigma: Array) -> BodyFilter:
    """The filter with its landmarks as they were added and a pose that is known up to `sigma` (6,).

    This undoes what a feature that turned out wrong has done to pose and landmarks.
    """
    P = np.zeros_like(body.P)
    P[_POSE, _POSE] = np.diag(sigma**2)
    P[6:_MOTION, 6:_MOTION] = body.P[6:_MOTION, 6:_MOTION]
    if len(body.ids):
        P[_MOTION:, _MOTION:] = body.initial_covariance
    return replace(body, p_BF=body.p_BF_initial, P=P)


def inflated(body: BodyFilter, sigma: Array) -> BodyFilter:
    """The filter whose pose may have jumped by `sigma` (6,), [rad, m]."""
    return replace(body, P=error_state.inflate(body.P, _POSE, np.diag(sigma**2)))


def moved_to(body: BodyFilter, X_WB: Array, dt: float, walk: Array) -> BodyFilter:
    """The filter at a pose X_WB (4, 4) from elsewhere, whose error walks by `walk` (6,).

    Args:
        body: At the last tick.
        X_WB: Pose now.
        dt: Time since the last tick, [s].
        walk: Random walk of the pose's error, [rad/sqrt(s), m/sqrt(s)].
    """
    step = se3.inverse(body.X) @ X_WB
    Ad = se3.adjoint(se3.inverse(step))
    P = error_state.propagate(body.P, _POSE, Ad)
    P = error_state.inflate(P, _POSE, np.diag(walk**2 * dt))
    return replace(body, X=X_WB, V=se3.log(step) / dt, P=0.5 * (P + P.T))
