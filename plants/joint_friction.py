"""Coulomb friction of joints, which Drake's joints do not have."""

import numpy as np
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import Joint, ModelInstanceIndex, PdControllerGains
from pydrake.systems.framework import BasicVector, Context, DiagramBuilder, LeafSystem
from pydrake.systems.primitives import ConstantVectorSource

from crossmodal.maths.arrays import Array

_CREEP = 0.001  # Speed below which a joint that holds a load creeps, [m/s] or [rad/s].


def add_holding_friction(plant: MultibodyPlant, joint: Joint, friction: float) -> None:
    """Gives a joint of one degree of freedom friction that holds a load, before `Finalize`.

    It is a motor that wants to stand still, with a limited effort: -clip(F v / v_s, -F, F). Drake's
    solver finds it together with the velocity after the step, so that it is stable at any step;
    `JointFriction` takes the velocity before the step, and where the load is all on the joint and
    its inertia small, it rattles and lets the load down.

    Args:
        friction: F, [N] or [N m].
    """
    motor = plant.AddJointActuator(f"{joint.name()}_friction", joint, friction)
    motor.set_controller_gains(PdControllerGains(p=0.0, d=friction / _CREEP))


def connect_holding_friction(
    builder: DiagramBuilder, plant: MultibodyPlant, instance: ModelInstanceIndex
) -> None:
    """Commands a model's motors, as those of `add_holding_friction`, to stand still."""
    states = 2 * plant.num_actuated_dofs(instance)
    if states:
        still = builder.AddSystem(ConstantVectorSource(np.zeros(states)))
        builder.Connect(still.get_output_port(), plant.get_desired_state_input_port(instance))


class JointFriction(LeafSystem):
    """Generalized force -F tanh(v / v_s) on each velocity of the plant.

    Input ports:
    - `plant_state`: (nq + nv,) of the plant (true).

    Output ports:
    - `generalized_forces`: (nv,), [N] or [N m].

    Args:
        plant: The finalized plant.
        friction: Coulomb friction (nv,), [N] or [N m], not negative.
        speed: v_s, below which friction falls off smoothly, [m/s] or [rad/s].

    Raises:
        ValueError: for a friction that is negative or not a number, or a speed that is not above 0.
    """

    def __init__(self, plant: MultibodyPlant, friction: Array, speed: float = 0.01) -> None:
        super().__init__()
        if not np.all(friction >= 0):
            raise ValueError(f"JointFriction: friction = {friction!r}, need >= 0 N or N m")
        if not 0 < speed < np.inf:
            raise ValueError(f"JointFriction: speed = {speed!r}, need > 0 m/s or rad/s")
        self._friction = friction.copy()
        self._speed = speed
        self._nq = plant.num_positions()
        self._state = self.DeclareVectorInputPort("plant_state", plant.num_multibody_states())
        self.DeclareVectorOutputPort("generalized_forces", plant.num_velocities(), self._calc)

    def _calc(self, context: Context, output: BasicVector) -> None:
        v = np.asarray(self._state.Eval(context))[self._nq :]
        output.SetFromVector(-self._friction * np.tanh(v / self._speed))
