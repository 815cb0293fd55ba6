"""How estimators, recorders and viewers are connected with the station, and what is refused."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pydrake.systems.framework import Diagram, DiagramBuilder, OutputPort, PortDataType, System

from crossmodal.diagrams.run.application import Application
from crossmodal.diagrams.run.calibration import Calibration
from crossmodal.diagrams.run.folder.fingerprint import contents
from crossmodal.diagrams.run.record import Quantity, TaskStatus
from crossmodal.diagrams.run.recorder import STATUS_PORT, TickStopwatch
from crossmodal.diagrams.run.scenario import Scenario
from crossmodal.diagrams.run.sensor_streams.log import SensorLogWriter, SensorRecorder, make_streams
from crossmodal.diagrams.run.sensor_streams.stream_faults import model_of
from crossmodal.diagrams.run.yaml_input.schema import ScenarioError, suggestion

if TYPE_CHECKING:
    from crossmodal.diagrams.run.stream.sinks import Sink


def output_ports(system: System) -> list[OutputPort]:
    """All of a system's."""
    return [system.get_output_port(index) for index in range(system.num_output_ports())]


def recorded_quantities(
    application: Application, scenario: Scenario, estimators: Mapping[str, System]
) -> list[Quantity]:
    """The quantities that are recorded, each with the estimators of which it is.

    One that some estimators have is also recorded of those under other names that have its port.

    Raises:
        ScenarioError: where an estimator lacks a port, with those that it has.
    """
    quantities = application.quantities(scenario)
    known = {name for quantity in quantities for name in quantity.estimators}
    found = []
    for quantity in quantities:
        having = []
        for name, estimator in estimators.items():
            must = not quantity.estimators or name in quantity.estimators
            if must or (name not in known and estimator.HasOutputPort(quantity.port)):
                having.append(name)
            if must and not estimator.HasOutputPort(quantity.port):
                there = [port.get_name() for port in output_ports(estimator)]
                raise ScenarioError(
                    f"estimator '{name}': has no output '{quantity.port}', which `quantities` of"
                    f" the application '{application.name}' names;"
                    f" {suggestion(quantity.port, there)}"
                )
        if having:
            found.append(replace(quantity, estimators=having))
    return found


def check_station(
    application: Application,
    station: System,
    quantities: Sequence[Quantity],
    pictures: Sequence[str],
) -> None:
    """Refuses a port that is to be recorded and that the station does not have.

    Raises:
        ScenarioError: naming the port, and the one that may be meant.
    """
    asked = [(quantity.port, "station_quantities") for quantity in quantities]
    for name, field in [*asked, *((port, "pictures") for port in pictures)]:
        if not station.HasOutputPort(name):
            there = [port.get_name() for port in output_ports(station)]
            raise ScenarioError(
                f"the station has no output '{name}', which `{field}` of the application"
                f" '{application.name}' names; {suggestion(name, there)}"
            )


def refuse_truth(name: str, estimator: System) -> None:
    """Refuses an estimator that reads the truth.

    Raises:
        ScenarioError: naming estimator and port.
    """
    for index in range(estimator.num_input_ports()):
        port = estimator.get_input_port(index).get_name()
        if port.startswith("cheat_"):
            raise ScenarioError(f"estimator '{name}' reads '{port}': the truth is not for it")


def check_inputs(name: str, estimator: System, source: System, what: str) -> None:
    """Refuses an estimator that reads the truth, or what nobody gives.

    Args:
        what: The source in words.

    Raises:
        ScenarioError: naming estimator, port, and the ports that there are.
    """
    refuse_truth(name, estimator)
    there = [port.get_name() for port in output_ports(source)]
    there = [port for port in there if not port.startswith("cheat_")]
    for index in range(estimator.num_input_ports()):
        port = estimator.get_input_port(index).get_name()
        if port not in there:
            raise ScenarioError(
                f"estimator '{name}' reads '{port}', which {what} does not have;"
                f" {suggestion(port, there)}"
            )


def add_estimator(
    builder: DiagramBuilder,
    station: System,
    heard: Callable[[str], OutputPort],
    name: str,
    estimator: System,
    period: float,
) -> tuple[TickStopwatch, TickStopwatch]:
    """Adds an estimator between two stopwatches, for Drake updates in the order of adding."""
    check_inputs(name, estimator, station, "the station")
    inputs = [estimator.get_input_port(index) for index in range(estimator.num_input_ports())]
    images = [port for port in inputs if port.get_data_type() == PortDataType.kAbstractValued]
    start, stop = TickStopwatch(period, [port.Allocate() for port in images]), TickStopwatch(period)
    builder.AddNamedSystem(f"{name}_start", start)
    builder.AddNamedSystem(name, estimator)
    builder.AddNamedSystem(f"{name}_stop", stop)
    for index, port in enumerate(images):
        builder.Connect(heard(port.get_name()), start.get_input_port(index))
    for port in inputs:
        builder.Connect(heard(port.get_name()), port)
    return start, stop


def connect_recorder(
    builder: DiagramBuilder,
    station: System,
    estimators: Mapping[str, System],
    recorder: System,
) -> None:
    """Connects what station and estimators have of the recorder's ports."""
    for index in range(recorder.num_input_ports()):
        port = recorder.get_input_port(index)
        name = port.get_name()
        if station.HasOutputPort(name):
            builder.Connect(station.GetOutputPort(name), port)
    connect_latest(builder, estimators, recorder)


def add_stream(
    builder: DiagramBuilder,
    sink: "Sink",
    application: Application,
    scenario: Scenario,
    calibration: Calibration,
    station: System,
    estimators: Mapping[str, System],
    models: Mapping[str, Any],
    start: int = 0,
) -> None:
    """Adds what sends images and estimates to a viewer.

    Args:
        sink: Takes the messages.
        station: What gives the images: the station, or a recording.
        models: Values like those of its ports.
        start: What is added to the time since the start in all stamps, [ns].
    """
    from crossmodal.diagrams.run.stream.estimate_stream import EstimateStream

    quantities = recorded_quantities(application, scenario, estimators)
    system = EstimateStream(
        sink, application, scenario, calibration, quantities, list(estimators), models, start
    )
    builder.AddNamedSystem("stream", system)
    connect_recorder(builder, station, estimators, system)


def connect_latest(
    builder: DiagramBuilder, estimators: Mapping[str, System], reader: System
) -> None:
    """Connects a reader's ports `<estimator>_<port>` with the estimators that have that port.

    Raises:
        ScenarioError: for a port that is not from the state alone.
    """
    for name, estimator in estimators.items():
        for index in range(estimator.num_output_ports()):
            port = estimator.get_output_port(index)
            if reader.HasInputPort(f"{name}_{port.get_name()}"):
                if estimator.HasDirectFeedthrough(index):
                    raise ScenarioError(
                        f"estimator '{name}': its port '{port.get_name()}' depends on what the"
                        " sensors give at the instant at which it is read, which is between two"
                        " ticks; record one that is from the state alone (`_declare_latest`)"
                    )
                builder.Connect(port, reader.GetInputPort(f"{name}_{port.get_name()}"))


def stream_models(
    estimators: Mapping[str, System], station_quantities: Sequence[Quantity]
) -> dict[str, Any]:
    """Values like those of all ports that a recording holds: what the estimators read, what the
    robot says it does, and the truth."""
    models: dict[str, Any] = {}
    for estimator in estimators.values():
        for index in range(estimator.num_input_ports()):
            port = estimator.get_input_port(index)
            models[port.get_name()] = model_of(port)
    models |= {quantity.port: quantity.model for quantity in station_quantities}
    return models | {STATUS_PORT: TaskStatus()}


def add_sensor_recorder(
    builder: DiagramBuilder,
    application: Application,
    scenario: Scenario,
    calibration: Calibration,
    station: Diagram,
    estimators: Mapping[str, System],
    path: Path,
) -> SensorLogWriter:
    """Adds what writes the estimators' streams, the truth and the pictures to a file."""
    models = stream_models(estimators, application.station_quantities(scenario))
    models |= {
        port: station.GetOutputPort(port).Allocate().get_value()
        for port in application.pictures(scenario)
    }
    known = {port: model for port, model in models.items() if station.HasOutputPort(port)}
    streams = make_streams(known, application.topics(scenario), calibration)
    said = contents(application, scenario)
    recorder = builder.AddNamedSystem(
        "sensors", SensorRecorder(path, streams, scenario.network_period, said)
    )
    for stream in streams:
        builder.Connect(station.GetOutputPort(stream.port), recorder.GetInputPort(stream.port))
    return recorder.log
