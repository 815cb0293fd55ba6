"""The arm that the controllers' tests share."""

from functools import cache

import numpy as np
from pydrake.math import RigidTransform

from crossmodal.controllers.arm.impedance import (
    DesiredMotion,
)
from crossmodal.controllers.arm.kinematics import ArmModel
from crossmodal.plants.robots.arm_with_hand import make_arm_with_load
from crossmodal.plants.robots.wam import WAM_WITH_SOFT_HAND

Q = np.array(
    [-0.6, 0.9, 0.45, 1.5, -3.65, 0.7, 0.1]
)  # A posture far from the joints' limits, [rad].
STILL = np.concatenate([Q, np.zeros(7)])  # The joints' state there.


@cache
def arm_model() -> ArmModel:
    return ArmModel(make_arm_with_load(WAM_WITH_SOFT_HAND, RigidTransform()))


def desired(X_WE: np.ndarray, V: np.ndarray | None = None) -> DesiredMotion:
    return DesiredMotion(X_WE=X_WE, V_WE_E=np.zeros(6) if V is None else V, A_WE_E=np.zeros(6))
