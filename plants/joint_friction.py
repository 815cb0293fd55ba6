"""Coulomb friction of joints and detents that hold them, which Drake's joints do not have."""

from collections.abc import Sequence

import numpy as np
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import Joint, ModelInstanceIndex, PdControllerGains, PrismaticJoint
from pydrake.systems.framework import BasicVector, Context, DiagramBuilder, LeafSystem
from pydrake.systems.primitives import ConstantVectorSource

from crossmodal.maths.arrays import Array

# Displacement of a detent's largest force, [m] for a slide, [rad] for a joint that turns.
_LENGTH, _ANGLE = 3e-4, 2e-3
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
    """Generalized force -F tanh(v / v_s) on each velocity of the plant, and that of detents.

    A detent holds a joint where it is closed, as a magnet or a ball in a spring does, by the force
    -F (x / s) exp(1 - |x| / s), x the displacement from the joint's default position. It holds
    most, by F, at x = s, 0.3 mm or 2 mrad away, and lets go within a few times that.

    Input ports:
    - `plant_state`: (nq + nv,) of the plant (true).

    Output ports:
    - `generalized_forces`: (nv,), [N] or [N m].

    Args:
        plant: The finalized plant.
        friction: Coulomb friction (nv,), [N] or [N m], not negative.
        detents: Joints of one degree of freedom with the force F of their detents, [N] or [N m].
        speed: v_s, below which friction falls off smoothly, [m/s] or [rad/s].
    """

    def __init__(
        self,
        plant: MultibodyPlant,
        friction: Array,
        detents: Sequence[tuple[Joint, float]] = (),
        speed: float = 0.01,
    ) -> None:
        super().__init__()
        self._friction, self._detents, self._speed = friction.copy(), list(detents), speed
        self._nq = plant.num_positions()
        self._state = self.DeclareVectorInputPort("plant_state", plant.num_multibody_states())
        self.DeclareVectorOutputPort("generalized_forces", plant.num_velocities(), self._calc)

    def _calc(self, context: Context, output: BasicVector) -> None:
        state = np.asarray(self._state.Eval(context))
        forces = -self._friction * np.tanh(state[self._nq :] / self._speed)
        for joint, force in self._detents:
            scale = _LENGTH if isinstance(joint, PrismaticJoint) else _ANGLE
            x = (state[joint.position_start()] - joint.default_positions()[0]) / scale
            forces[joint.velocity_start()] -= force * x * np.exp(1.0 - abs(x))
        output.SetFromVector(forces)
