"""What machines of phases have in common: a state that follows from what is sensed, and outputs."""

from abc import abstractmethod
from collections.abc import Callable
from typing import Any

import numpy as np
from pydrake.common.value import AbstractValue, Value
from pydrake.systems.framework import BasicVector, Context, InputPort, LeafSystem, State

from crossmodal.controllers.arm.kinematics import ArmModel, ArmState
from crossmodal.maths.arrays import Array


class Sequence(LeafSystem):
    """A system whose state is replaced at a fixed period by the one that follows from it.

    A subclass declares its inputs, calls `_declare_state`, then declares its outputs, which are
    functions of the state, and of the time unless they say otherwise; `_next` says what follows.

    Args:
        arm: The robot's own model of the arm that the sequence moves.
    """

    def __init__(self, arm: ArmModel) -> None:
        super().__init__()
        self._arm = arm
        self._joint_state = self.DeclareVectorInputPort("joint_state_measured", 2 * arm.num_joints)

    @abstractmethod
    def _next(self, context: Context) -> object:
        """The state that follows."""

    def _declare_state(self, first: object, period: float) -> None:
        """Declares the state, which is never mutated, and the update every `period` [s]."""
        state = self.DeclareAbstractState(Value[object](first))
        self._on_state = {self.abstract_state_ticket(state)}
        self._on_time = self._on_state | {self.time_ticket()}
        self.DeclarePeriodicUnrestrictedUpdateEvent(period, 0.0, self._update)

    def _declare_vector(
        self, name: str, size: int, calc: Callable[[Context], Any], needs: Any = None
    ) -> None:
        """Declares an output (size,) that is what `calc` makes of the context."""

        def write(context: Context, output: BasicVector) -> None:
            output.SetFromVector(np.atleast_1d(calc(context)))

        self.DeclareVectorOutputPort(name, size, write, needs or self._on_time)

    def _declare_value(
        self, name: str, model: object, calc: Callable[[Context], Any], needs: Any = None
    ) -> None:
        """Declares an output for values like the model."""

        def write(context: Context, output: AbstractValue) -> None:
            output.set_value(calc(context))

        kind = AbstractValue.Make if isinstance(model, str) else Value[object]
        self.DeclareAbstractOutputPort(name, lambda: kind(model), write, needs or self._on_time)

    def _state(self, context: Context) -> Any:
        return context.get_abstract_state(0).get_value()

    def _arm_state(self, context: Context) -> ArmState:
        return self._arm.Evaluate(np.asarray(self._joint_state.Eval(context)))

    def _update(self, context: Context, state: State) -> None:
        state.get_mutable_abstract_state(0).set_value(self._next(context))


def read(port: InputPort, context: Context, unknown: float) -> Array:
    """The vector at a port (n,); `unknown` in each place where the port is not connected."""
    if port.HasValue(context):
        return np.asarray(port.Eval(context))
    return np.full(port.size(), unknown)


def known_belief(port: InputPort, context: Context) -> Any:
    """The belief at a port; None where nothing is believed or the port is not connected."""
    belief: Any = port.Eval(context) if port.HasValue(context) else None
    return belief if belief is not None and belief.known else None
