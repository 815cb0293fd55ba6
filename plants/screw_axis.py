"""The axis of a screw joint, which pydrake does not bind."""

import numpy as np
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import ScrewJoint

from crossmodal.maths.arrays import Array


def screw_axis(plant: MultibodyPlant, joint: ScrewJoint) -> Array:
    """The unit axis (3,) in the joint's frame on its parent, from how its child turns."""
    context = plant.CreateDefaultContext()
    joint.set_angular_velocity(context, 1.0)
    w = joint.child_body().EvalSpatialVelocityInWorld(context).rotational()
    X_WF = joint.frame_on_parent().CalcPoseInWorld(context)
    return np.asarray(X_WF.rotation().inverse() @ w, dtype=float)
