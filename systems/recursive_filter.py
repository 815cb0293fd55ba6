"""The anatomy of all filters: one posterior per tick, kept in the Context."""

from collections.abc import Callable
from functools import partial
from typing import Any

from pydrake.common.value import AbstractValue, Value
from pydrake.systems.framework import (
    Context,
    DependencyTicket,
    InputPort,
    LeafSystem,
    State,
    ValueProducer,
)


class RecursiveFilter(LeafSystem):
    """A system whose state is the posterior of the last tick.

    The posterior of this tick is computed once, in a cache entry that depends on the state, the
    time and the input ports. Estimated outputs project it, latest outputs project the stored one,
    and the periodic update stores it; a forced update (`ExecuteForcedEvents`) does the same, for
    those who tick a filter by hand.

    A subclass declares in its constructor, in this order:
    - inputs, by `_declare_value_input(name, model)` for values like the model, or Drake's own;
    - `_declare_recursion(initial, update, period)`, of which `update(context, posterior)` returns
      the next posterior and reads inputs by `_read(port, context)`;
    - outputs, by `_declare_latest(name, project)` from the posterior of the last tick, and by
      `_declare_estimated(name, project)` from that of this tick.
    """

    def _declare_value_input(self, name: str, model: object) -> InputPort:
        return self.DeclareAbstractInputPort(name, AbstractValue.Make(model))

    def _declare_recursion(
        self,
        initial: object,
        calc_posterior: Callable[[Context, Any], Any],
        period: float,
    ) -> None:
        """Declares state, cache entry and update.

        Args:
            initial: The state before the first tick; never mutated.
            calc_posterior: From the context and the stored state to this tick's state.
        """
        self._initial = initial
        self._calc_posterior = calc_posterior
        self._state_index = self.DeclareAbstractState(Value[object](initial))
        inputs = [self.get_input_port(i) for i in range(self.num_input_ports())]
        self._posterior = self._declare_cache("posterior", self._calc_cache, inputs)
        self.DeclarePeriodicUnrestrictedUpdateEvent(period, 0.0, self._store)
        self.DeclareForcedUnrestrictedUpdateEvent(self._store)

    def _declare_cache(
        self,
        description: str,
        calc: Callable[[Any, Any], None],
        inputs: list[InputPort],
    ) -> Any:
        tickets: set[DependencyTicket] = {self.input_port_ticket(p.get_index()) for p in inputs}
        tickets |= {self.time_ticket(), self.abstract_state_ticket(self._state_index)}
        producer = ValueProducer(lambda: Value[object](self._initial), calc)
        return self.DeclareCacheEntry(description, producer, tickets)

    def _declare_estimated(self, name: str, project: Callable[[Any], Any]) -> None:
        """Declares an output that is a function of this tick's posterior."""
        self.DeclareAbstractOutputPort(
            name,
            lambda: Value[object](project(self._initial)),
            partial(self._write_estimated, project),
            {self._posterior.ticket()},
        )

    def _declare_latest(self, name: str, project: Callable[[Any], Any]) -> None:
        """Declares an output that is a function of the last tick's posterior alone."""
        self.DeclareAbstractOutputPort(
            name,
            lambda: Value[object](project(self._initial)),
            partial(self._write_latest, project),
            {self.abstract_state_ticket(self._state_index)},
        )

    def _stored(self, context: Context) -> Any:
        return context.get_abstract_state(int(self._state_index)).get_value()

    @staticmethod
    def _read(port: InputPort, context: Context) -> Any:
        return port.Eval(context)

    @staticmethod
    def _read_optional(port: InputPort | None, context: Context) -> Any:
        """The value of an input that may be left undeclared or unconnected; None then."""
        return port.Eval(context) if port is not None and port.HasValue(context) else None

    def _write_estimated(
        self, project: Callable[[Any], Any], context: Context, value: AbstractValue
    ) -> None:
        value.set_value(project(self._posterior.Eval(context)))

    def _write_latest(
        self, project: Callable[[Any], Any], context: Context, value: AbstractValue
    ) -> None:
        value.set_value(project(self._stored(context)))

    def _calc_cache(self, context: Context, value: AbstractValue) -> None:
        value.set_value(self._calc_posterior(context, self._stored(context)))

    def _store(self, context: Context, state: State) -> None:
        posterior = self._posterior.Eval(context)
        state.get_mutable_abstract_state(int(self._state_index)).set_value(posterior)
