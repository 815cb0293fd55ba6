"""What a whole track says about the joint between two bodies."""

from collections import Counter
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from crossmodal.maths import se3
from crossmodal.maths.arrays import Array, Mask
from crossmodal.maths.immutable import Immutable
from crossmodal.systems.kinematics.joint_filters import JointFilters
from crossmodal.systems.kinematics.joint_filters_config import JointFiltersConfig
from crossmodal.systems.kinematics.joint_filters_state import skip
from crossmodal.systems.kinematics.pose_checks import SkipReason, pose_fault, time_fault
from crossmodal.systems.object_models.articulated_object import screw_of
from crossmodal.systems.port_values import JointBelief, JointModelBelief, JointType
from crossmodal.systems.pose_tracks.pose_track import (
    PoseTrack,
    in_order_of_time,
    pose_track,
    relative_track,
    with_deviations,
)

_MOVING = (JointType.PRISMATIC, JointType.REVOLUTE, JointType.SCREW)
_STEPS = 10  # Of Gauss and Newton to the nearest point of a path; a screw needs two or three.

Progress = Callable[[Iterable[int]], Iterable[int]]


@dataclass(frozen=True, kw_only=True)
class JointEstimate(Immutable):
    """The joint between a body B and its parent P, as a track shows it.

    The configuration q is zero at the first pose that was used, [m] of a prismatic joint and else
    [rad]; B is most of the time on the positive side of it.

    Attributes:
        track: The poses X_PB.
        belief: Of the joint filters after the last pose, with all types, covariances and fit. Its
            axis may point the other way.
        S_P: Unit screw (6,) in P, rotation first: X_PB = exp(S_P q) X_PB_zero; NaN for a body that
            no joint moves.
        X_PB_zero: B's pose (4, 4) on the joint's path where q is zero; NaN if there is no path.
        q: Nearest configuration to each pose (N,); NaN where nothing was measured, or no joint
            moves.
        q_deviation: (N,) standard deviation of q, by the pose's noise, as large as it turned out,
            and by how well it is known where q is zero.
        distance: (N, 2) of each pose from the path, [rad] and [m]; rotations that were not measured
            have none.
    """

    track: PoseTrack
    belief: JointBelief
    S_P: Array
    X_PB_zero: Array
    q: Array
    q_deviation: Array
    distance: Array

    @property
    def type(self) -> JointType:
        """The most probable type."""
        return self.belief.type

    @property
    def probability(self) -> float:
        """Of the most probable type."""
        return self.belief.probabilities[self.type]

    @property
    def moves(self) -> bool:
        """Whether the type has a path."""
        return self.type in _MOVING

    @property
    def model(self) -> JointModelBelief:
        """Parameters and covariances of the most probable type, of the sign of `S_P`'s axis."""
        model = self.belief.model
        turned = self.moves and float(np.dot(model.axis_P, self.axis_P)) < 0.0
        return replace(model, axis_P=-model.axis_P) if turned else model

    @property
    def axis_P(self) -> Array:
        """Direction (3,) of the axis in P; NaN without one."""
        turns = self.type != JointType.PRISMATIC
        return self.S_P[:3] if turns else self.S_P[3:]

    @property
    def axis_deviation(self) -> float:
        """Standard deviation of the axis' direction, both directions together, [rad]."""
        return float(np.sqrt(np.trace(self.belief.model.axis_covariance)))

    @cached_property
    def limits(self) -> tuple[float, float]:
        """The least and the largest q that was seen; the joint may go farther.

        The outermost hundredth of the poses does not count, which may be outliers.
        """
        seen = self.q[np.isfinite(self.q)]
        if not len(seen):
            return np.nan, np.nan
        low, high = np.quantile(seen, [0.005, 0.995])
        return float(min(low, 0.0)), float(max(high, 0.0))

    @cached_property
    def limits_deviation(self) -> tuple[float, float]:
        """Standard deviations of q at the poses that are nearest to either of `limits`."""
        if not np.isfinite(self.q).any():
            return np.nan, np.nan
        low, high = (np.nanargmin(np.abs(self.q - limit)) for limit in self.limits)
        return float(self.q_deviation[low]), float(self.q_deviation[high])

    def pose(self, q: float) -> Array:
        """X_PB (4, 4) on the joint's path."""
        return np.asarray(se3.exp(self.S_P * q) @ self.X_PB_zero)


def nearest_configuration(S_P: Array, X_PB_zero: Array, X_PB: Array, W: Array, q: float) -> float:
    """The configuration on a path, from `q` on, that is nearest to a pose.

    It minimises e' W e with e = log(X(q)^-1 X_PB), of which the derivative is -Ad(X(q)^-1) S_P.

    Args:
        S_P: (6,)
        X_PB_zero: (4, 4)
        X_PB: (4, 4)
        W: Information (6, 6), in B; zero about a rotation that was not measured.
        q: First guess, on the same turn.
    """
    for _ in range(_STEPS):
        X = np.ascontiguousarray(se3.exp(S_P * q) @ X_PB_zero)
        J = se3.adjoint(se3.inverse(X)) @ S_P
        e = _difference(X, X_PB, W)
        step = float(J @ W @ e) / float(J @ W @ J)
        q += step
        if abs(step) < 1e-9:
            break
    return q


def _difference(X: Array, X_PB: Array, W: Array) -> Array:
    """The tangent vector (6,) from X to X_PB; a rotation that was not measured is that of X."""
    measured = X_PB.copy()
    if W[0, 0] == 0.0:
        measured[:3, :3] = X[:3, :3]
    return np.asarray(se3.log(se3.inverse(X) @ measured))


def estimate(
    times: Array,
    X_PB: Array,
    deviations: Array | None = None,
    *,
    X_AP: Array | None = None,
    config: JointFiltersConfig | None = None,
    progress: Progress = iter,
) -> JointEstimate:
    """The joint that moves a body B relative to P, from B's poses over time.

    Args:
        times: (N,), [s]. Where they are not sorted the poses are, also in what is returned.
        X_PB: Poses (N, 4, 4), positions with quaternions (N, 7) (x, y, z, qx, qy, qz, qw), or
            positions alone (N, 3), [m].
        deviations: Standard deviations of the measurements, (2,) for rotation [rad] and translation
            [m], (6,), or (N, 6); a prior, from which the noise is estimated. None: from the track.
        X_AP: Poses of a parent that moves, at the same times and in the same frame A as B's, which
            are then X_AB; the parent rests if None.
        config: Of the joint filters.
        progress: Wraps the loop over the poses, as `tqdm` does.

    Raises:
        ValueError: for arrays of other shapes, and for a track of less than two poses.
    """
    track = pose_track(times, X_PB, deviations)
    if X_AP is not None:
        track = relative_track(pose_track(times, X_AP, deviations), track)
    return estimate_track(track, config, progress)


def estimate_track(
    track: PoseTrack, config: JointFiltersConfig | None = None, progress: Progress = iter
) -> JointEstimate:
    """The joint of a track; see `estimate`."""
    track = with_deviations(in_order_of_time(track))
    faults = [
        pose_fault(X) or time_fault(time, time)
        for X, time in zip(track.X_AB, track.times, strict=True)
    ]
    if faults.count(None) < 2:
        reasons = Counter(fault for fault in faults if fault is not None).most_common(1)
        why = "".join(f"; of {count}: {reason}" for reason, count in reasons)
        raise ValueError(f"less than two of {len(faults)} poses can be used{why}")
    first, repeated = faults.index(None), _repeated(track.X_AB)
    filters = JointFilters(config or JointFiltersConfig())
    R = [np.diag(sigma**2) for sigma in track.deviations]
    state = filters.start(track.X_AB[first], R[first], float(track.times[first]))
    for k in progress(range(first + 1, len(track.times))):
        if repeated[k]:
            state = skip(state, SkipReason.REPEATED)
            continue
        state = filters.update(state, track.X_AB[k], R[k], float(track.times[k]))
    belief = filters.belief(state)
    none = JointEstimate(
        track=track,
        belief=belief,
        S_P=np.full(6, np.nan),
        X_PB_zero=np.full((4, 4), np.nan),
        q=np.full(len(track.times), np.nan),
        q_deviation=np.full(len(track.times), np.nan),
        distance=np.full((len(track.times), 2), np.nan),
    )
    if belief.type == JointType.DISCONNECTED:
        return none
    X_PB = filters.predict(state, belief.type, 0.0).X
    if belief.type == JointType.RIGID:
        return along_path(replace(none, X_PB_zero=X_PB))
    S_P = screw(belief)
    X_PB_zero = se3.exp(-S_P * belief.model.configuration[0]) @ X_PB
    found = along_path(replace(none, S_P=S_P, X_PB_zero=X_PB_zero))
    if np.nanmedian(found.q) < 0.0:
        found = replace(found, S_P=-S_P, q=-found.q)
    return found


def _repeated(X: Array) -> Mask:
    """Which poses (N,) are the last one, sent again; none where all are the same.

    The filters cannot tell before the first other pose, as while a tracker has not found its body.
    """
    same = np.append(False, (X[1:] == X[:-1]).all(axis=(1, 2)))
    return same & (not same[1:].all())


def screw(belief: JointBelief) -> Array:
    """The unit screw (6,) of the most probable type, in the parent's frame."""
    return screw_of(belief.type, belief.model)


def along_path(found: JointEstimate) -> JointEstimate:
    """The estimate with q, its deviation and the distance of each pose from the path."""
    track, moves = found.track, found.moves
    q, q_deviation = found.q.copy(), found.q_deviation.copy()
    distance, last = found.distance.copy(), 0.0
    of_zero = found.belief.model.configuration_covariance[0, 0]
    scale = np.repeat(found.belief.fit.noise_scale if found.belief.fit else (1.0, 1.0), 3)
    for k, X_PB in enumerate(track.X_AB):
        if not np.isfinite(X_PB).all():
            continue
        W = np.diag(1.0 / (scale * track.deviations[k]) ** 2)
        if moves:
            q[k] = last = nearest_configuration(found.S_P, found.X_PB_zero, X_PB, W, last)
        X = np.ascontiguousarray(found.pose(last) if moves else found.X_PB_zero)
        if moves:
            J = se3.adjoint(se3.inverse(X)) @ found.S_P
            q_deviation[k] = np.sqrt(1.0 / (J @ W @ J) + of_zero)
        error = _difference(X, X_PB, W)
        measured = np.isfinite(track.deviations[k, 0])
        distance[k] = np.linalg.norm(error[:3]) if measured else np.nan, np.linalg.norm(error[3:])
    return replace(found, q=q, q_deviation=q_deviation, distance=distance)
