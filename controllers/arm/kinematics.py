"""The controllers' own model of the arm: forward kinematics, Jacobian and the load to carry."""

from dataclasses import dataclass

import numpy as np
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import JacobianWrtVariable

from maths.arrays import Array


@dataclass(kw_only=True)
class ArmState:
    """The arm at one measurement.

    Attributes:
        q: Joint positions (7,), [rad].
        v: Joint velocities (7,), [rad/s].
        X_WE: End-effector pose (4, 4).
        J_E: Jacobian (6, 7) of the spatial velocity of E in W, expressed in E.
        V_WE_E: Spatial velocity (6,), [rad/s, m/s].
        tau_bias: Coriolis minus gravity torques (7,), [N m]: what holds the arm still.
    """

    q: Array
    v: Array
    X_WE: Array
    J_E: Array
    V_WE_E: Array
    tau_bias: Array


class ArmModel:
    """Kinematics and dynamics of the arm with its hand as a rigid load.

    Args:
        plant: A finalized plant with the arm alone (the hand's inertia lumped into it); not the
            simulated plant, but what the robot knows about itself.
        frame: Name of the end-effector frame.
    """

    def __init__(self, plant: MultibodyPlant, frame: str = "end_effector") -> None:
        self._plant = plant
        self._frame = plant.GetFrameByName(frame)
        self._context = plant.CreateDefaultContext()

    def Evaluate(self, joint_state: Array) -> ArmState:
        """The arm at `joint_state` (14,): positions [rad], then velocities [rad/s]."""
        plant, context = self._plant, self._context
        plant.SetPositionsAndVelocities(context, joint_state)
        X_WE = self._frame.CalcPoseInWorld(context).GetAsMatrix4()
        J_E = plant.CalcJacobianSpatialVelocity(
            context,
            JacobianWrtVariable.kV,
            self._frame,
            np.zeros(3),
            plant.world_frame(),
            self._frame,
        )
        tau_bias = plant.CalcBiasTerm(context) - plant.CalcGravityGeneralizedForces(context)
        v = joint_state[7:]
        return ArmState(
            q=joint_state[:7], v=v, X_WE=X_WE, J_E=J_E, V_WE_E=J_E @ v, tau_bias=tau_bias
        )
