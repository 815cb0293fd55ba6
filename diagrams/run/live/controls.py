"""Sliders of the live page that act on the simulation."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from pydrake.systems.framework import Context, DiagramBuilder, DiscreteValues, LeafSystem, System

from crossmodal.diagrams.run.sensor_streams.stream_faults import faults_of
from crossmodal.systems.sensors.stream_fault import BY_HAND


def page_name(name: str) -> str:
    """A button's or slider's name with typographic quotes.

    Meshcat puts it between straight ones into the page's code, which one within it would end.
    """
    return name.replace("\\", "/").replace("'", "\u2019")


class ControlKind(StrEnum):
    """How a value is changed, and what it is written to.

    A slider and a switch, which is off (zero) or on (one), write to an input of the station. A
    silence is a switch, too: while it is on, nothing arrives from a sensor stream.
    """

    SLIDER = "slider"
    SWITCH = "switch"
    SILENCE = "silence"


@dataclass(frozen=True, kw_only=True)
class Control:
    """A value of a station that a person may change while it runs.

    Attributes:
        name: On the page, with its unit; the page has room for 17 letters.
        kind: How it is changed, and what it is written to.
        port: Input port (1,) of the station, which does as the scenario says without one; of a
            silence the stream, an output port of the station that estimators read.
        low: Least value.
        high: Largest value.
        step: Between two values.
        value: The scenario's.
        factor: By which it is multiplied for the port, whose unit is SI.
    """

    name: str
    port: str
    kind: ControlKind = ControlKind.SLIDER
    low: float = 0.0
    high: float = 1.0
    step: float = 1.0
    value: float = 0.0
    factor: float = 1.0

    @property
    def silences(self) -> bool:
        """Whether it writes to a stream, and not to an input of the station."""
        return self.kind is ControlKind.SILENCE

    @property
    def page_name(self) -> str:
        """Its name as the page can write it."""
        return page_name(self.name)

    def written(self, value: float) -> str:
        """Its name with a value, for people."""
        if self.kind is not ControlKind.SLIDER:
            return f"{self.name} {'on' if value else 'off'}"
        name, _, unit = self.name.partition(" [")
        return f"{name} {value:.3g} {unit.removesuffix(']')}".rstrip()


def silence(name: str, stream: str) -> Control:
    """A switch that silences a stream, which people call `name`."""
    return Control(name=f"silent: {name}", port=stream, kind=ControlKind.SILENCE)


def heard_controls(controls: Iterable[Control], estimators: Iterable[System]) -> list[Control]:
    """Those that do something in a run: a silence does where an estimator reads its stream."""
    estimators = tuple(estimators)
    return [
        control
        for control in controls
        if not control.silences or any(one.HasInputPort(control.port) for one in estimators)
    ]


class ControlValues(LeafSystem):
    """Gives the values of the sliders, held from tick to tick.

    Output ports:
    - `<port>`: (1,) of each control.

    State: the values, in the order of the controls.

    Args:
        controls: What can be changed.
        read: Gives the present value of a slider by its name on the page.
        period: Of the reading, [s].
    """

    def __init__(
        self, controls: Sequence[Control], read: Callable[[str], float], period: float
    ) -> None:
        super().__init__()
        self._controls, self._read = tuple(controls), read
        state = self.DeclareDiscreteState(
            np.array([control.factor * control.value for control in controls])
        )
        on_state = {self.discrete_state_ticket(state)}
        for index, control in enumerate(controls):
            self.DeclareVectorOutputPort(
                control.port,
                1,
                lambda context, output, index=index: output.SetAtIndex(
                    0, context.get_discrete_state_vector().GetAtIndex(index)
                ),
                on_state,
            )
        self.DeclarePeriodicDiscreteUpdateEvent(period, 0.0, self._update)

    def _update(self, context: Context, next_state: DiscreteValues) -> None:
        values = [
            control.factor
            * float(np.clip(self._read(control.page_name), control.low, control.high))
            for control in self._controls
        ]
        next_state.get_mutable_vector().SetFromVector(values)


def connect_controls(
    builder: DiagramBuilder,
    station: System,
    controls: Sequence[Control],
    read: Callable[[str], float],
    period: float,
) -> None:
    """Adds the sliders' values and connects them with the station and its failing streams.

    Raises:
        ValueError: where the station has no such port.
    """
    if not controls:
        return
    values = builder.AddNamedSystem("controls", ControlValues(controls, read, period))
    for control in controls:
        if control.silences:
            target = builder.GetSubsystemByName(faults_of(control.port)).GetInputPort(BY_HAND)
        elif station.HasInputPort(control.port):
            target = station.GetInputPort(control.port)
        else:
            raise ValueError(f"a control writes to '{control.port}', which the station has not")
        builder.Connect(values.GetOutputPort(control.port), target)
