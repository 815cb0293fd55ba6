"""Coulomb friction of joints and detents that hold them, which Drake's joints do not have."""

from collections.abc import Sequence

import numpy as np
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import Joint, ModelInstanceIndex, PdControllerGains, PrismaticJoint
from pydrake.systems.framework import BasicVector, Context, DiagramBuilder, LeafSystem
from pydrake.systems.primitives import ConstantVectorSource

# Displacement of a detent's largest force, [m] for a slide, [rad] for a joint that turns.
_LENGTH, _ANGLE = 3e-4, 2e-3
_CREEP = 1e-4  # v_s: a joint that holds a load creeps more slowly than this, [m/s] or [rad/s].


def add_friction(plant: MultibodyPlant, joint: Joint, friction: float) -> None:
    """Gives a joint of one degree of freedom Coulomb friction, before `Finalize`.

    It is a motor that wants to stand still, with a limited effort: -clip(F v / v_s, -F, F). Drake's
    solver finds it together with the velocity after the step. A force that is applied depends on
    the velocity before the step; where F is larger than 2 m v_s / dt, the mass m of the joint
    rattles at each step dt and feels a part of it only.

    Args:
        plant: Not yet finalized.
        joint: Of the object.
        friction: F, [N] or [N m].
    """
    motor = plant.AddJointActuator(f"{joint.name()}_friction", joint, friction)
    motor.set_controller_gains(PdControllerGains(p=0.0, d=friction / _CREEP))


def connect_friction(
    builder: DiagramBuilder, plant: MultibodyPlant, instance: ModelInstanceIndex
) -> None:
    """Commands a model's motors, as those of `add_friction`, to stand still."""
    states = 2 * plant.num_actuated_dofs(instance)
    if states:
        still = builder.AddSystem(ConstantVectorSource(np.zeros(states)))
        builder.Connect(still.get_output_port(), plant.get_desired_state_input_port(instance))


class Detents(LeafSystem):
    """Detents that hold joints where they are closed, as a magnet or a ball in a spring does.

    The generalized force is -F (x / s) exp(1 - |x| / s), x the displacement from the joint's
    default position. It holds most, by F, at x = s, 0.3 mm or 2 mrad away, and lets go within a few
    times that. The force depends on where the joint is before each step dt, so that a light joint
    would rattle in a strong detent: s is at least 2 e F dt^2 / m, m the joint's inertia.

    Input ports:
    - `plant_state`: (nq + nv,) of the plant (true).

    Output ports:
    - `generalized_forces`: (nv,), [N] or [N m].

    Args:
        plant: The finalized plant.
        detents: Joints of one degree of freedom with F, [N] or [N m].
    """

    def __init__(self, plant: MultibodyPlant, detents: Sequence[tuple[Joint, float]]) -> None:
        super().__init__()
        self._nv = plant.num_velocities()
        inertias = plant.CalcMassMatrix(plant.CreateDefaultContext()).diagonal()
        steady = 2.0 * np.e * plant.time_step() ** 2
        self._detents = []
        for joint, force in detents:
            least = _LENGTH if isinstance(joint, PrismaticJoint) else _ANGLE
            scale = max(least, steady * force / float(inertias[joint.velocity_start()]))
            self._detents.append((joint, force, scale))
        self._state = self.DeclareVectorInputPort("plant_state", plant.num_multibody_states())
        self.DeclareVectorOutputPort("generalized_forces", self._nv, self._calc)

    def _calc(self, context: Context, output: BasicVector) -> None:
        state, forces = np.asarray(self._state.Eval(context)), np.zeros(self._nv)
        for joint, force, scale in self._detents:
            x = (state[joint.position_start()] - joint.default_positions()[0]) / scale
            forces[joint.velocity_start()] -= force * x * np.exp(1.0 - abs(x))
        output.SetFromVector(forces)
