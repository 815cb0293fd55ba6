"""An estimated joint as a model that simulators read."""

import numpy as np

from crossmodal.systems.object_models.articulated_object import (
    ArticulatedObject,
    ObjectBody,
    ObjectJoint,
)
from crossmodal.systems.object_models.sdf import sdf
from crossmodal.systems.object_models.urdf import urdf
from crossmodal.systems.port_values import JointType
from crossmodal.systems.pose_tracks.joint_estimate import JointEstimate


def as_object(found: JointEstimate) -> ArticulatedObject:
    """The bodies `parent` and `child`, and the frame `tracked` where B is.

    Raises:
        ValueError: for a disconnected body.
    """
    if found.type == JointType.DISCONNECTED:
        raise ValueError("the body is disconnected, so that there is no joint to write")
    model, (lower, upper) = found.model, found.limits
    lower_deviation, upper_deviation = found.limits_deviation
    joint = ObjectJoint(
        name="joint",
        parent="parent",
        child="child",
        type=str(found.type),
        probability=found.probability,
        hinge_probability=found.belief.hinge_probability(),
        updates=found.belief.updates,
        S_P=found.S_P,
        X_PB_zero=found.X_PB_zero,
        lower=lower,
        upper=upper,
        lower_deviation=lower_deviation,
        upper_deviation=upper_deviation,
        axis_deviation=found.axis_deviation,
        position_deviation=float(np.sqrt(np.trace(model.p_PA_covariance))),
        pitch=model.pitch,
        pitch_deviation=float(np.sqrt(model.pitch_variance)),
    )
    body = ObjectBody(name="child", frame="tracked")
    return ArticulatedObject(root="parent", bodies=[body], joints=[joint])


def to_urdf(found: JointEstimate, name: str = "object") -> str:
    """The joint as URDF: links `parent` and `child`, and `tracked` where B is.

    Raises:
        ValueError: for a disconnected body, a name that is none, and a screw, which URDF lacks.
    """
    return urdf(as_object(found), name)


def to_sdf(found: JointEstimate, name: str = "object") -> str:
    """The joint as SDF: links `parent` and `child`, and the frame `tracked` where B is.

    Raises:
        ValueError: for a disconnected body, and a name that is none.
    """
    return sdf(as_object(found), name)
