"""The body in the hand as vision knew it before the hand held it.

A hand that closes nudges what it will hold, so that vision has often found that body, K, before.
What it has seen of K's joints is not lost: from the closing of the hand on, the held body B counts
as K, for as long as the two move alike. Once vision follows no K any more, since it has been told
that K is B or has lost it, the hand's motion of B says where K is.

Frames: W world, B the held body, K the seen one; X_KB is constant.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from crossmodal.maths import se3
from crossmodal.maths.arrays import Array
from crossmodal.maths.gaussian import nees, outlier_gate
from crossmodal.maths.immutable import Immutable
from crossmodal.systems.port_values import (
    HELD_BODY,
    STATIC_BODY,
    BodyMotion,
    MotionBelief,
    PoseBelief,
)

_UNLIKELY = outlier_gate(6)  # Squared distance of two poses that are not the same one.


@dataclass(frozen=True, kw_only=True)
class SeenBody(Immutable):
    """Which body of vision's the hand has got hold of.

    Attributes:
        body_id: Of K; `STATIC_BODY` where the held body is none that vision knew.
        X_KB: (4, 4).
        is_followed: Whether vision still has it under that number.
    """

    body_id: int
    X_KB: Array
    is_followed: bool = True


UNSEEN = SeenBody(body_id=STATIC_BODY, X_KB=np.eye(4), is_followed=False)


def find_seen(
    held: BodyMotion, bodies: Mapping[int, BodyMotion], known: Iterable[int], window: float
) -> SeenBody:
    """Which body the hand holds that has just closed: the nearest of those that it has nudged.

    Args:
        held: The body in the hand, at its reference.
        bodies: All that are measured at this tick, by id.
        known: Ids of those whose joints are known.
        window: How long ago a nudged body may have stood still last, [s].
    """
    nudged = [
        bodies[i]
        for i in known
        if i in bodies and i != HELD_BODY and bodies[i].reference_age <= window
    ]

    def distance(body: BodyMotion) -> float:
        X_WK = body.motion.X
        p_WF = body.p_BF @ X_WK[:3, :3].T + X_WK[:3, 3]
        return float(np.linalg.norm(p_WF - held.motion.X[:3, 3], axis=1).min())

    nearest = min((body for body in nudged if len(body.p_BF)), key=distance, default=None)
    if nearest is None:
        return UNSEEN
    return SeenBody(body_id=nearest.body_id, X_KB=se3.inverse(nearest.motion.X) @ held.motion.X)


def moves_alike(seen: SeenBody, held: BodyMotion, body: BodyMotion) -> bool:
    """Whether the seen body is where the hand has taken the held one."""
    error = se3.log(se3.inverse(body.motion.X @ seen.X_KB) @ held.motion.X)
    Ad = se3.adjoint(se3.inverse(seen.X_KB))
    of_seen = Ad @ body.motion.covariance[:6, :6] @ Ad.T
    of_held = held.motion.covariance[:6, :6] + held.correlated_covariance
    return nees(error, of_held + of_seen) <= _UNLIKELY


def in_frame(body: BodyMotion, X_BK: Array) -> BodyMotion:
    """The same motion of another frame K that is fixed in the body."""
    Ad = se3.adjoint(se3.inverse(X_BK))
    both = np.kron(np.eye(2), Ad)
    motion = MotionBelief(
        X=body.motion.X @ X_BK,
        V=Ad @ body.motion.V,
        covariance=both @ body.motion.covariance @ both.T,
    )
    return replace(
        body,
        motion=motion,
        X_WB_reference=body.X_WB_reference @ X_BK,
        correlated_covariance=Ad @ body.correlated_covariance @ Ad.T,
        offset_covariance=Ad @ body.offset_covariance @ Ad.T,
        reference_offset_covariance=Ad @ body.reference_offset_covariance @ Ad.T,
    )


def as_seen(seen: SeenBody, bodies: Mapping[int, BodyMotion]) -> dict[int, BodyMotion]:
    """The bodies that are measured, the held one described as the seen one.

    While that one is followed and not seen, there is none.
    """
    described = dict(bodies)
    if seen.body_id == STATIC_BODY or HELD_BODY not in bodies:
        return described
    if seen.is_followed:
        del described[HELD_BODY]
        if seen.body_id in bodies:
            described[HELD_BODY] = replace(bodies[seen.body_id], body_id=HELD_BODY)
    else:
        described[HELD_BODY] = in_frame(bodies[HELD_BODY], se3.inverse(seen.X_KB))
    return described


def of_held(seen: SeenBody, pose: PoseBelief) -> PoseBelief:
    """X_WB of the held body from X_WK, or from the poses of both in a parent."""
    Ad = se3.adjoint(se3.inverse(seen.X_KB))
    return PoseBelief(X=pose.X @ seen.X_KB, covariance=Ad @ pose.covariance @ Ad.T)
