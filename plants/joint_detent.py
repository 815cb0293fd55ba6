"""A detent that holds a joint where it is closed, as a magnet or a ball in a spring does."""

import numpy as np
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import Joint, PrismaticJoint
from pydrake.systems.framework import BasicVector, Context, LeafSystem

_LENGTH, _ANGLE = (
    3e-4,
    2e-3,
)  # Displacement of the largest force, [m] for a slide, [rad] for a joint that turns.


class JointDetent(LeafSystem):
    """Generalized force -F (x / s) exp(1 - |x| / s), x the displacement from where it is held.

    The joint is held at its default position. The detent holds most, by F, at x = s, 0.3 mm or
    2 mrad away, and lets go within a few times that.

    Input ports:
    - `plant_state`: (nq + nv,) of the plant (true).

    Output ports:
    - `generalized_forces`: (nv,), [N] or [N m].

    Args:
        plant: The finalized plant.
        joint: Of one degree of freedom.
        force: F, [N] or [N m].

    Raises:
        ValueError: for a force that is negative or not a number.
    """

    def __init__(self, plant: MultibodyPlant, joint: Joint, force: float) -> None:
        super().__init__()
        if not 0.0 <= force < np.inf:
            raise ValueError(f"JointDetent: force = {force!r}, need >= 0 N or N m")
        self._q, self._v = joint.position_start(), joint.velocity_start()
        self._position, self._force = float(joint.default_positions()[0]), force
        self._scale = _LENGTH if isinstance(joint, PrismaticJoint) else _ANGLE
        self._state = self.DeclareVectorInputPort("plant_state", plant.num_multibody_states())
        self.DeclareVectorOutputPort("generalized_forces", plant.num_velocities(), self._calc)

    def _calc(self, context: Context, output: BasicVector) -> None:
        x = (np.asarray(self._state.Eval(context))[self._q] - self._position) / self._scale
        output.SetZero()
        output.SetAtIndex(self._v, -self._force * x * np.exp(1.0 - abs(x)))
