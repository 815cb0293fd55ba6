"""The filters of an estimator, each of which may be replaced by one of the user's own."""

import inspect
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from pydrake.systems.framework import (
    Diagram,
    DiagramBuilder,
    InputPort,
    LeafSystem,
    OutputPort,
    System,
)

from crossmodal.diagrams.run.recorder import declare_input
from crossmodal.diagrams.run.sensor_streams.stream_faults import model_of
from crossmodal.diagrams.run.yaml_input.schema import suggestion

MakeFilter = Callable[..., System]


class Filters:
    """Makes the filters of an estimator, or those that take their places.

    Args:
        replacements: By a filter's name who makes the other one, called with the same arguments.
    """

    def __init__(self, replacements: Mapping[str, MakeFilter]) -> None:
        self._replacements = replacements
        self._names: list[str] = []

    def make(self, name: str, make: MakeFilter, *args: Any, **kwargs: Any) -> System:
        """What replaces the filter of this name; `make(*args, **kwargs)` where nothing does.

        Raises:
            ValueError: where the other one does not fit, see `fitted`.
        """
        self._names.append(name)
        ours = make(*args, **kwargs)
        if name not in self._replacements:
            return ours
        return fitted(name, self._replacements[name], ours, *args, **kwargs)

    def add(
        self, builder: DiagramBuilder, name: str, make: MakeFilter, *args: Any, **kwargs: Any
    ) -> System:
        """Makes a filter and adds it to a Diagram under its name."""
        added: System = builder.AddNamedSystem(name, self.make(name, make, *args, **kwargs))
        return added

    def check(self, estimator: str) -> None:
        """Raises ValueError for a replacement of a filter that the estimator does not have."""
        for name in self._replacements:
            if name not in self._names:
                raise ValueError(
                    f"replacements: '{estimator}' has no filter '{name}';"
                    f" {suggestion(name, self._names)}"
                )


def fitted(name: str, make: MakeFilter, ours: System, *args: Any, **kwargs: Any) -> System:
    """A filter of the user's own that is wired as ours is.

    It has all outputs of ours, with values of the same types; those that are from the state alone
    are so, too. It reads some of the inputs of ours, or all.

    Args:
        name: Of ours.
        make: Makes the other one; given the arguments that ours was made with.
        ours: In whose place it is.

    Raises:
        ValueError: naming the filter, the port and the ports that there are.
    """
    who = f"filter '{name}' ({getattr(make, '__name__', repr(make))})"
    _check_call(who, make, ours, args, kwargs)
    own = make(*args, **kwargs)
    if not isinstance(own, System):
        raise ValueError(f"{who}: must be a Drake System, not a {type(own).__name__}")
    inputs, outputs = _inputs(ours), _outputs(ours)
    own_inputs, own_outputs = _inputs(own), _outputs(own)
    for port in own_inputs:
        if port not in inputs:
            raise ValueError(
                f"{who}: reads '{port}', which a {type(ours).__name__} in its place is not given;"
                f" {suggestion(port, inputs)}"
            )
        _check_kind(who, "input", port, own_inputs[port], inputs[port])
    for port in outputs:
        if port not in own_outputs:
            near = suggestion(port, own_outputs).replace("allowed: ", "it has: ")
            raise ValueError(f"{who}: has no output '{port}', which others read; {near}")
        _check_kind(who, "output", port, own_outputs[port], outputs[port])
        index, own_index = outputs[port].get_index(), own_outputs[port].get_index()
        if own.HasDirectFeedthrough(own_index) and not ours.HasDirectFeedthrough(index):
            raise ValueError(
                f"{who}: output '{port}' must be from the state alone (`_declare_latest`), but it"
                " depends on the inputs or the time"
            )
    unread = [port for port in inputs if port not in own_inputs]
    return _with_unread(own, [inputs[port] for port in unread]) if unread else own


def _check_call(
    who: str, make: MakeFilter, ours: System, args: Sequence[Any], kwargs: Mapping[str, Any]
) -> None:
    try:
        signature = inspect.signature(make)
    except (TypeError, ValueError):  # Some callables do not say what they take.
        return
    try:
        signature.bind(*args, **kwargs)
    except TypeError as error:
        given = ", ".join([*(type(arg).__name__ for arg in args), *(f"{key}=" for key in kwargs)])
        raise ValueError(
            f"{who}: is called as {type(ours).__name__} is, with ({given}): {error}"
        ) from None


def _inputs(system: System) -> dict[str, InputPort]:
    ports = [system.get_input_port(index) for index in range(system.num_input_ports())]
    return {port.get_name(): port for port in ports}


def _outputs(system: System) -> dict[str, OutputPort]:
    ports = [system.get_output_port(index) for index in range(system.num_output_ports())]
    return {port.get_name(): port for port in ports}


def _check_kind(
    who: str, side: str, name: str, own: InputPort | OutputPort, ours: InputPort | OutputPort
) -> None:
    kind, needed = _kind(model_of(own)), _kind(model_of(ours))
    if kind != needed:
        raise ValueError(f"{who}: {side} '{name}' is {kind}, but it must be {needed}")


def _kind(value: Any) -> str:
    if isinstance(value, np.ndarray):
        return f"a vector of {len(value)}"
    return f"abstract, a {type(value).__name__}"


def _with_unread(own: System, unread: Sequence[InputPort]) -> Diagram:
    """The system with inputs that it does not read, so that it is connected as any other."""
    builder = DiagramBuilder()
    system = builder.AddNamedSystem("filter", own)
    for name, port in _inputs(system).items():
        builder.ExportInput(port, name)
    for name, port in _outputs(system).items():
        builder.ExportOutput(port, name)
    others = builder.AddNamedSystem("unread", LeafSystem())
    for port in unread:
        builder.ExportInput(declare_input(others, port.get_name(), model_of(port)), port.get_name())
    return builder.Build()
