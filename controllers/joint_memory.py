"""Remembers the joint that was perceived, also while nothing is held."""

import numpy as np
import numpy.typing as npt
from pydrake.systems.framework import Context, DiscreteValues, LeafSystem

from controllers.phases import is_held

Array = npt.NDArray[np.float64]


def remember(memory: Array, seen: Array, held: bool) -> Array:
    """The next memory (15,): the joint's S_W, q and its rate, S_WE, and q at the last grasp.

    Perception counts q from the grasp and may turn an axis around together with its q: both are
    undone here, so that q goes on after another grasp and keeps its sign.

    Args:
        memory: As returned; NaN but for the last entry before any joint was seen.
        seen: (14,) S_W, q, rate and S_WE, NaN where no joint is perceived.
        held: Whether the hand is closed around the body.
    """
    memory = memory.copy()
    if not held:
        memory[14] = 0.0 if np.isnan(memory[6]) else memory[6]
        memory[7] = 0.0 * memory[6]
    elif not np.isnan(seen[6]):
        sign = -1.0 if memory[:6] @ seen[:6] < 0.0 else 1.0
        memory[:14] = sign * seen
        memory[6] += memory[14]
    return memory


class JointMemory(LeafSystem):
    """Keeps the joint that perception gives, through its gaps and from one grasp to the next.

    .. pydrake_system::

        name: JointMemory
        input_ports:
        - joint_latest
        - end_effector_screw_latest
        - phase
        output_ports:
        - joint_remembered
        - end_effector_screw_remembered

    - joint_latest: (8,) unit screw of the body in W at Wo, its configuration q since the grasp,
      [m or rad], and the rate of q; NaN while unknown. Unconnected, nothing is ever known.
    - end_effector_screw_latest: (6,) of E in W at Wo, per unit of q.
    - phase: (1,) `Phase`.
    - joint_remembered: (8,) the same, q since the first grasp; NaN until a joint was perceived.
    - end_effector_screw_remembered: (6,) likewise.
    """

    def __init__(self, period: float) -> None:
        super().__init__()
        if not period > 0:
            raise ValueError(f"JointMemory: need period > 0 s, got {period!r}")
        self._joint = self.DeclareVectorInputPort("joint_latest", 8)
        self._screw = self.DeclareVectorInputPort("end_effector_screw_latest", 6)
        self._phase = self.DeclareVectorInputPort("phase", 1)
        state = self.DeclareDiscreteState(np.append(np.full(14, np.nan), 0.0))
        on_state = {self.discrete_state_ticket(state)}
        for name, part in (
            ("joint_remembered", slice(0, 8)),
            ("end_effector_screw_remembered", slice(8, 14)),
        ):
            self.DeclareVectorOutputPort(
                name,
                part.stop - part.start,
                lambda context, output, part=part: output.SetFromVector(
                    context.get_discrete_state_vector().value()[part]
                ),
                on_state,
            )
        self.DeclarePeriodicDiscreteUpdateEvent(period, 0.0, self._update)

    def _update(self, context: Context, next_state: DiscreteValues) -> None:
        if not self._joint.HasValue(context):
            return
        seen = np.concatenate([self._joint.Eval(context), self._screw.Eval(context)])
        memory = np.asarray(context.get_discrete_state_vector().value())
        held = is_held(self._phase.Eval(context)[0])
        next_state.get_mutable_vector().SetFromVector(remember(memory, seen, held))
