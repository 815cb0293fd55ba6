"""Pairs of bodies: which there are, which are scheduled, and what a pair measures.

Frames: W world, P parent, B child. A pair is (parent id, child id); the parent is `STATIC_BODY` or
the body with the higher id, the younger one.
"""

from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from crossmodal.maths import se3
from crossmodal.maths.arrays import Array
from crossmodal.systems.kinematics.joint_filters import JointFiltersState
from crossmodal.systems.kinematics.pose_checks import finite
from crossmodal.systems.port_values import STATIC_BODY, BodyMotion, PoseBelief

Pair = tuple[int, int]


def possible_pairs(measured: Iterable[int], resting: Iterable[int]) -> list[Pair]:
    """Every measured body with the static environment, and with each younger body.

    Args:
        measured: Ids of bodies.
        resting: Ids of parents that are not measured any more and taken to rest.
    """
    children = sorted(measured)
    parents = sorted({*children, *resting})
    younger = [(parent, child) for child in children for parent in parents if parent > child]
    return [(STATIC_BODY, child) for child in children] + younger


def scheduled_pairs(
    pairs: Sequence[Pair],
    bodies: Mapping[int, BodyMotion],
    filters: Mapping[Pair, JointFiltersState],
    max_pairs: int,
) -> set[Pair]:
    """The pairs to update at this tick, whose time so grows with the bodies, not with their pairs.

    A body's joint to the environment is updated at every tick, and so is a pair that is new. Of the
    other pairs those come first that have waited longest, and of these the nearest.

    Args:
        pairs: The possible ones.
        filters: Of the pairs that are followed already.
        max_pairs: Most pairs in a tick; at least one pair of moving bodies is among them.
    """
    scheduled = {pair for pair in pairs if pair[0] == STATIC_BODY or pair not in filters}
    waiting = [pair for pair in pairs if pair not in scheduled]

    def priority(pair: Pair) -> tuple[float, float, Pair]:
        p_WP, p_WB = (bodies[i].motion.X[:3, 3] for i in pair)
        return filters[pair].time, float(np.linalg.norm(p_WB - p_WP)), pair

    return scheduled.union(sorted(waiting, key=priority)[: max(1, max_pairs - len(scheduled))])


def relative_pose(parent: PoseBelief, child: PoseBelief) -> PoseBelief:
    """X_PB of two independent poses in W."""
    X_PB = se3.inverse(parent.X) @ child.X
    Ad = se3.adjoint(se3.inverse(X_PB))
    of_parent = Ad @ finite(parent.covariance) @ Ad.T
    return PoseBelief(X=X_PB, covariance=child.covariance + of_parent)


def _pose(body: BodyMotion) -> PoseBelief:
    """X_WB without the error that is constant in B."""
    covariance = body.motion.covariance[:6, :6] - body.offset_covariance
    return PoseBelief(X=body.motion.X, covariance=covariance)


def measured_pose(pair: Pair, bodies: dict[int, BodyMotion]) -> tuple[PoseBelief, Array, Array]:
    """X_PB of a pair now, the correlated part of its covariance (6, 6), X_PB at the reference."""
    child = bodies[pair[1]]
    if pair[0] == STATIC_BODY:
        return _pose(child), child.correlated_covariance, child.X_WB_reference
    parent = bodies[pair[0]]
    X_PB_reference = se3.inverse(parent.X_WB_reference) @ child.X_WB_reference
    pose = relative_pose(_pose(parent), _pose(child))
    Ad = se3.adjoint(se3.inverse(pose.X))
    correlated = child.correlated_covariance + Ad @ parent.correlated_covariance @ Ad.T
    return pose, correlated, X_PB_reference


def constant_error(pair: Pair, bodies: dict[int, BodyMotion]) -> tuple[Array, Array]:
    """Covariances (6, 6), in B, of X_PB's constant error and of its reference's."""
    child = bodies[pair[1]]
    if pair[0] == STATIC_BODY:
        return child.offset_covariance, child.reference_offset_covariance
    parent = bodies[pair[0]]
    Ad = se3.adjoint(se3.inverse(child.motion.X) @ parent.motion.X)
    return (
        child.offset_covariance + Ad @ parent.offset_covariance @ Ad.T,
        child.reference_offset_covariance + Ad @ parent.reference_offset_covariance @ Ad.T,
    )
