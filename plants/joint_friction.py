"""Coulomb friction of the objects' joints, which Drake's joints do not have."""

import numpy as np
from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.framework import BasicVector, Context, LeafSystem

from maths.arrays import Array


class JointFriction(LeafSystem):
    """Generalized force -F tanh(v / v_s) on each velocity of the plant.

    .. pydrake_system::

        name: JointFriction
        input_ports:
        - plant_state
        output_ports:
        - generalized_forces

    - plant_state: (nq + nv,) of the plant (true).
    - generalized_forces: (nv,), [N] or [N m].

    Args:
        plant: The finalized plant.
        friction: Coulomb friction (nv,), [N] or [N m], not negative.
        speed: Below it friction falls off smoothly, [m/s] or [rad/s].
    """

    def __init__(self, plant: MultibodyPlant, friction: Array, speed: float = 0.01) -> None:
        super().__init__()
        if np.any(friction < 0):
            raise ValueError(f"JointFriction: need friction >= 0 N, got {friction!r}")
        self._friction = friction.copy()
        self._speed = speed
        self._nq = plant.num_positions()
        self._state = self.DeclareVectorInputPort("plant_state", plant.num_multibody_states())
        self.DeclareVectorOutputPort("generalized_forces", plant.num_velocities(), self._calc)

    def _calc(self, context: Context, output: BasicVector) -> None:
        v = np.asarray(self._state.Eval(context))[self._nq :]
        output.SetFromVector(-self._friction * np.tanh(v / self._speed))
