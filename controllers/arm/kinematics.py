"""The controllers' own model of an arm: forward kinematics, Jacobian and the load to carry."""

from dataclasses import dataclass

import numpy as np
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import JacobianWrtVariable

from crossmodal.maths.arrays import Array


@dataclass(kw_only=True)
class ArmState:
    """An arm of n joints at one measurement.

    Attributes:
        q: Joint positions (n,), [rad].
        v: Joint velocities (n,), [rad/s].
        X_WE: End-effector pose (4, 4).
        J_E: Jacobian (6, n) of the spatial velocity of E in W, expressed in E.
        V_WE_E: Spatial velocity (6,), [rad/s, m/s].
        M: Inertia of the joints (n, n), [kg m^2].
        tau_bias: Coriolis minus gravity torques (n,), [N m]: what holds the arm still.
    """

    q: Array
    v: Array
    X_WE: Array
    J_E: Array
    V_WE_E: Array
    M: Array
    tau_bias: Array


class ArmModel:
    """Kinematics and dynamics of an arm with its hand as a rigid load.

    Attributes:
        plant: As given.

    Args:
        plant: A finalized plant with the arm alone, of one-axis joints on a fixed base (the hand's
            inertia lumped into it), and its frame `end_effector`; not the simulated plant, but what
            the robot knows about itself.
    """

    def __init__(self, plant: MultibodyPlant) -> None:
        self.plant = plant
        self._frame = plant.GetFrameByName("end_effector")
        self._context = plant.CreateDefaultContext()

    @property
    def num_joints(self) -> int:
        """The number n of joints."""
        return int(self.plant.num_positions())

    def Evaluate(self, joint_state: Array) -> ArmState:
        """The arm at `joint_state` (2 n,): positions [rad], then velocities [rad/s]."""
        plant, context = self.plant, self._context
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
        q, v = joint_state[: self.num_joints], joint_state[self.num_joints :]
        M = plant.CalcMassMatrix(context)
        return ArmState(q=q, v=v, X_WE=X_WE, J_E=J_E, V_WE_E=J_E @ v, M=M, tau_bias=tau_bias)

    def CalcHoldingTorque(self, q: Array) -> Array:
        """What carries the arm's weight at the joint positions `q` (n,): torques (n,), [N m]."""
        self.plant.SetPositions(self._context, q)
        return -np.asarray(self.plant.CalcGravityGeneralizedForces(self._context))
