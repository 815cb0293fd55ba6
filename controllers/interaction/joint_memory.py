"""Remembers the joint that was perceived, also while nothing is held."""

import numpy as np
from pydrake.systems.framework import Context, DiscreteValues, LeafSystem

from crossmodal.controllers.interaction.phases import is_held
from crossmodal.maths.arrays import Array

_UNKNOWN = np.concatenate([np.full(14, np.nan), np.zeros(2)])


def is_revolute(S: Array) -> bool:
    """Whether a screw (6,) is that of a revolute joint, its q an angle."""
    return bool(np.linalg.norm(S[:3]) > 0.5)


def remember(memory: Array, seen: Array, held: bool, period: float, patience: float) -> Array:
    """The next memory (16,).

    It holds S_W, q and its rate, S_WE, q at the last grasp, and how long another type of joint has
    been perceived, [s].

    Perception counts q from the grasp and may turn an axis around together with its q: both are
    undone here, so that q goes on after another grasp and keeps its sign. A joint of another type,
    whose q has another unit, is believed once it has been perceived for long enough.

    Args:
        memory: As returned; NaN but for the last two before any joint was seen.
        seen: (14,) S_W, q, rate and S_WE, NaN where no joint is perceived.
        held: Whether the hand is closed around the body.
        period: Between two updates, [s].
        patience: Until another type of joint is believed, [s].
    """
    memory = memory.copy()
    memory[7] = np.nan
    if not held:
        memory[14] = 0.0 if np.isnan(memory[6]) else memory[6]
        memory[15] = 0.0
    elif not np.isnan(seen[6]):
        other = not np.isnan(memory[6]) and is_revolute(seen) != is_revolute(memory)
        memory[15] = (memory[15] + period) if other else 0.0
        if other and memory[15] < patience:
            return memory
        sign = -1.0 if memory[:6] @ seen[:6] < 0.0 else 1.0
        memory[:14] = sign * seen
        memory[6] += memory[14]
    return memory


class JointMemory(LeafSystem):
    """Keeps the joint that perception gives, through its gaps and from one grasp to the next.

    Input ports:
    - `joint_latest`: (8,) unit screw of the body in W at Wo, its configuration q since the grasp,
      [m or rad], and the rate of q; NaN while unknown. Unconnected, nothing is ever known.
    - `end_effector_screw_latest`: (6,) of E in W at Wo, per unit of q.
    - `phase`: (1,) `Phase`.

    Output ports:
    - `joint_remembered`: (8,) the same, q since the first grasp; NaN until a joint was perceived.
      The rate is NaN whenever the joint is only remembered.
    - `end_effector_screw_remembered`: (6,) likewise.

    Args:
        period: Of the updates, [s].
        patience: Until a joint of another type is believed, [s].
    """

    def __init__(self, period: float, patience: float = 0.5) -> None:
        super().__init__()
        self._period, self._patience = period, patience
        self._joint = self.DeclareVectorInputPort("joint_latest", 8)
        self._screw = self.DeclareVectorInputPort("end_effector_screw_latest", 6)
        self._phase = self.DeclareVectorInputPort("phase", 1)
        state = self.DeclareDiscreteState(_UNKNOWN)
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
        memory = remember(memory, seen, held, self._period, self._patience)
        next_state.get_mutable_vector().SetFromVector(memory)
