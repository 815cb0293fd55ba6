"""What control needs to know of the joint that the hand moves, as plain vectors."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from pydrake.common.value import Value
from pydrake.systems.framework import BasicVector, Context, LeafSystem

from crossmodal.maths import se3
from crossmodal.maths.arrays import Array
from crossmodal.maths.validation import check, number
from crossmodal.systems.kinematics.joint_screws import screw
from crossmodal.systems.port_values import (
    HELD_BODY,
    MOVING_TYPES,
    STATIC_BODY,
    GraspType,
    JointBelief,
    JointBeliefs,
    JointType,
)


@dataclass(kw_only=True)
class HeldJointConfig:
    """How likely a joint has to be before anyone acts on it."""

    # Least probability of the joint's type.
    least_probability: float = number(0.5, at_least=0.0, at_most=1.0)
    # Largest standard deviation of the joint's axis.
    largest_axis_angle: float = number(0.5, above=0.0, at_most=10.0, unit="rad")


def is_likely(joint: JointBelief, config: HeldJointConfig) -> bool:
    """Whether it is likely that a joint moves, and about or along which axis."""
    if joint.type not in MOVING_TYPES:
        return False
    variance = float(np.trace(joint.model.axis_covariance))
    return (
        joint.probabilities[joint.type] >= config.least_probability
        and variance <= config.largest_axis_angle**2
    )


def explained(joint: JointBelief) -> float:
    """By how much the joint explains its child's motion better than none would, [nat]."""
    return joint.model.log_evidence - joint.models[JointType.DISCONNECTED].log_evidence


def fits(joint: JointBelief) -> bool:
    """Whether the child's motion is no farther off the joint than it is in 97.5 % of all cases.

    So it is where too little was measured to tell.
    """
    return joint.fit is None or not joint.fit.reduced_chi_square > joint.fit.bounds[1]


def choose_joint(
    joints: JointBeliefs, config: HeldJointConfig, body_is_known: bool
) -> JointBelief | None:
    """The joint to act on: of the body in the hand, to the environment or to what it hangs on.

    A lid turns about its box: once the box slides, no joint with the environment fits the lid's
    motion, and the one with the box does. As long as one with the environment fits, none other is
    needed. By how much a joint to another body explains the motion better than none is then no
    reason for it: that counts how the other body wanders, too.

    Args:
        joints: The kinematic model.
        body_is_known: Whether there is a body in the hand; vision alone does not know it and takes
            the joint that has been observed for longest.
    """
    candidates = [
        joint
        for joint in joints.joints
        if is_likely(joint, config) and not (body_is_known and joint.child_id != HELD_BODY)
    ]

    def preference(joint: JointBelief) -> tuple[float, ...]:
        is_static = joint.parent_id == STATIC_BODY
        if not body_is_known:
            return is_static, joint.updates
        return is_static and fits(joint), explained(joint), joint.updates

    return max(candidates, key=preference, default=None)


def end_effector_screw(S_W: Array, X_WE: Array, X_EH: Array, free_motion_H: Array) -> Array:
    """The twist (6,) of E, in W at Wo, with which the hand moves the body along S_W.

    The hand follows the body but for what the grasp leaves free: a hand that turns on a bar need
    not turn with a door.

    Args:
        S_W: Twist of the body (6,) in W at Wo.
        X_WE: Of the end-effector.
        X_EH: How the hand is bent.
        free_motion_H: (6, 6) projection of `GraspBelief`, in H at Ho.
    """
    X_WH = X_WE @ X_EH
    S_H = se3.adjoint(se3.inverse(X_WH)) @ S_W
    return np.asarray(se3.adjoint(X_WH) @ (S_H - free_motion_H @ S_H))


class HeldJoint(LeafSystem):
    """Reads the latest beliefs of a network out for the controllers.

    Those inputs that the modality lacks stay unconnected.

    Input ports:
    - `joints_latest`: `JointBeliefs`.
    - `body_motions_latest`: `BodyMotions`.
    - `grasp_latest`: `GraspBelief`.
    - `hand_bending_latest`: `PoseBelief` X_EH.
    - `end_effector_latest`: `EndEffectorBelief`.

    Output ports:
    - `joint_latest`: (8,) the body's unit screw S_W in W at Wo, rotation before translation, and
      the configuration q, [m or rad], zero where the body was grasped, and its rate. NaN while no
      joint is known.
    - `end_effector_screw_latest`: (6,) of E in W at Wo per unit of q; NaN likewise.
    - `grasp_failure_latest`: (1,) probability that the hand has lost the body; NaN without
      proprioception.

    Frames: W world, E nominal end-effector, H bent end-effector, P the joint's parent.
    """

    def __init__(self, config: HeldJointConfig) -> None:
        super().__init__()
        check(config, "HeldJoint")
        self._config = config
        self._ports = {
            name: self.DeclareAbstractInputPort(f"{name}_latest", Value[object]())
            for name in ("joints", "body_motions", "grasp", "hand_bending", "end_effector")
        }
        self.DeclareVectorOutputPort(
            "joint_latest", 8, lambda context, output: output.SetFromVector(self._joint(context))
        )
        self.DeclareVectorOutputPort("end_effector_screw_latest", 6, self._calc_end_effector)
        self.DeclareVectorOutputPort("grasp_failure_latest", 1, self._calc_failure)

    def _read(self, context: Context, name: str) -> Any:
        port = self._ports[name]
        return port.Eval(context) if port.HasValue(context) else None

    def _joint(self, context: Context) -> Array:
        by_touch = self._ports["grasp"].HasValue(context)
        joints = self._read(context, "joints")
        joint = choose_joint(joints, self._config, body_is_known=by_touch)
        if joint is None:
            return np.full(8, np.nan)
        S_W = screw(joint.type, joint.model)
        if joint.parent_id != STATIC_BODY:
            parent = self._read(context, "body_motions").find(joint.parent_id)
            if parent is None:
                return np.full(8, np.nan)
            S_W = se3.adjoint(parent.motion.X) @ S_W
        q, rate = joint.model.configuration
        return np.array([*S_W, q - joint.model.grasp_configuration, rate])

    def _calc_end_effector(self, context: Context, output: BasicVector) -> None:
        S_W = self._joint(context)[:6]
        grasp = self._read(context, "grasp")
        if grasp is not None and grasp.type != GraspType.FAILED:
            hand = self._read(context, "end_effector")
            bending = self._read(context, "hand_bending")
            S_W = end_effector_screw(S_W, hand.X, bending.X, grasp.free_motion)
        output.SetFromVector(S_W)

    def _calc_failure(self, context: Context, output: BasicVector) -> None:
        grasp = self._read(context, "grasp")
        failed = np.nan if grasp is None else grasp.probabilities[GraspType.FAILED]
        output.SetAtIndex(0, failed)
