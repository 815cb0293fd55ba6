"""Coulomb friction of joints, which Drake's joints do not have."""

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
