"""The held tool as an articulated object, as an estimator perceives it, without any truth."""

import numpy as np

from crossmodal.diagrams.run.record import Tick
from crossmodal.maths import se3
from crossmodal.maths.arrays import Array
from crossmodal.systems.object_models.articulated_object import (
    ArticulatedObject,
    ObjectBody,
    ObjectJoint,
)
from crossmodal.systems.port_values import UNKNOWN_TOOL, JointType, ToolBelief

HOLDER, FLAP = "holder", "flap"


def perceived_tool(before: ArticulatedObject | None, tick: Tick) -> ArticulatedObject | None:
    """The tool as an estimator perceives it at a tick, as it was before while it does not.

    Its root is the end-effector E of the arm that holds it. The flap's frame is at the contact T.

    Args:
        before: That of the last tick; None at the first.
        tick: The estimator's `tool_latest`.
    """
    tool: ToolBelief = tick.values.get("tool_latest", UNKNOWN_TOOL)
    if not np.isfinite(tool.X_EK).all() or not np.isfinite(tool.X_KT).all():
        return before
    theta, length = float(tool.angle.theta), float(np.linalg.norm(tool.L2_W))
    X_KT_zero = np.eye(4)
    X_KT_zero[0, 3] = length
    axis_E = tool.X_EK[:3, 2]
    seen = [0.0, theta]
    if before is not None:
        seen += [before.joints[0].lower, before.joints[0].upper]
    joint = ObjectJoint(
        name="hinge",
        parent=HOLDER,
        child=FLAP,
        type=str(JointType.REVOLUTE),
        S_P=np.concatenate([axis_E, np.cross(tool.X_EK[:3, 3], axis_E)]),
        X_PB_zero=tool.X_EK @ X_KT_zero,
        q=theta,
        q_deviation=float(np.sqrt(tool.angle.variance)),
        lower=min(seen),
        upper=max(seen),
        axis_deviation=float(np.sqrt(np.trace(tool.hinge.covariance[:3, :3]))),
        position_deviation=float(np.sqrt(np.trace(tool.L1_covariance))),
    )
    X_WE = holder_pose(tool)
    flap = ObjectBody(
        name=FLAP,
        frame="contact",
        X_WB=X_WE @ joint.pose(theta),
        low=np.array([-length, 0.0, 0.0]),  # All that is known of its shape is the lever.
        high=np.zeros(3),
    )
    return ArticulatedObject(root=HOLDER, X_WR=X_WE, time=tick.time, bodies=[flap], joints=[joint])


def holder_pose(tool: ToolBelief) -> Array:
    """X_WE (4, 4) that goes with the tool's hinge and lever in the world."""
    k = tool.hinge.k_W
    x_K = se3.so3_exp(-tool.angle.theta * k) @ -tool.L2_W / np.linalg.norm(tool.L2_W)
    X_WK = np.eye(4)
    X_WK[:3, :3], X_WK[:3, 3] = np.column_stack([x_K, np.cross(k, x_K), k]), tool.hinge.p_WK
    return np.asarray(X_WK @ se3.inverse(tool.X_EK))
