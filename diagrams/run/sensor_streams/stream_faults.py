"""Puts the faults of a scenario between what gives the sensor streams and who hears them."""

from collections.abc import Callable, Iterable, Sequence
from typing import Any

import numpy as np
from pydrake.systems.framework import DiagramBuilder, InputPort, OutputPort, PortDataType, System

from crossmodal.diagrams.run.yaml_input.schema import suggestion
from crossmodal.systems.sensors.stream_fault import FailingStream, StreamFault


def model_of(port: InputPort | OutputPort) -> Any:
    """A value like a port's; zeros (n,) for a vector port."""
    is_vector = port.get_data_type() == PortDataType.kVectorValued
    return np.zeros(port.size()) if is_vector else port.Allocate().get_value()


def faults_of(stream: str) -> str:
    """The name of the system through which a failing stream goes."""
    return f"{stream}_faults"


def add_stream_faults(
    builder: DiagramBuilder,
    source: System,
    faults: Sequence[StreamFault],
    period: float,
    seed: int,
    by_hand: Iterable[str] = (),
) -> Callable[[str], OutputPort]:
    """Adds a `FailingStream` for each stream that has faults.

    Args:
        source: Whose output ports are the streams: a station, or a recording.
        faults: Of the scenario.
        period: Of the ticks, [s].
        seed: Of the episode.
        by_hand: Further streams that can be silenced, by an input of their systems.

    Returns:
        From a port's name to the port that an estimator hears.

    Raises:
        ValueError: for a stream that there is not, or a fault that it cannot have.
    """
    ports = [source.get_output_port(index) for index in range(source.num_output_ports())]
    streams = {port.get_name(): port for port in ports if not port.get_name().startswith("cheat_")}
    heard = dict(streams)
    for name in dict.fromkeys([*(fault.stream for fault in faults), *by_hand]):
        if name not in streams:
            raise ValueError(
                f"disturbances.faults: no stream '{name}'; {suggestion(name, streams)}"
            )
        port = streams[name]
        own = [fault for fault in faults if fault.stream == name]
        failing = builder.AddNamedSystem(
            faults_of(name), FailingStream(model_of(port), own, period, seed)
        )
        builder.Connect(port, failing.GetInputPort("measured"))
        heard[name] = failing.get_output_port()
    return lambda name: heard[name] if name in heard else source.GetOutputPort(name)
