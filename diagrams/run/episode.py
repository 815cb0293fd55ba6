"""One episode: a scenario with its seed, simulated to the end."""

import time
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pydrake.geometry import Meshcat, MeshcatVisualizer, MeshcatVisualizerParams
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Diagram, DiagramBuilder, OutputPort, PortDataType, System

from crossmodal.diagrams.drawing.layers import Layers
from crossmodal.diagrams.run.application import SCENE_PORT, Application, Station
from crossmodal.diagrams.run.calibration import Calibration
from crossmodal.diagrams.run.folder.fingerprint import contents
from crossmodal.diagrams.run.own_code import place_of, told, traceback_of
from crossmodal.diagrams.run.process import peak_memory
from crossmodal.diagrams.run.record import EpisodeRecord, Event, Quantity, TaskStatus
from crossmodal.diagrams.run.recorder import (
    STATUS_PORT,
    EpisodeRecorder,
    TickStopwatch,
)
from crossmodal.diagrams.run.scenario import Scenario
from crossmodal.diagrams.run.sensor_streams.log import SensorLogWriter, SensorRecorder, make_streams
from crossmodal.diagrams.run.sensor_streams.stream_faults import add_stream_faults, model_of
from crossmodal.diagrams.run.ticks import advance_by_ticks
from crossmodal.diagrams.run.variants import check_variants, with_variants
from crossmodal.diagrams.run.yaml_input.schema import ScenarioError, one_line, suggestion
from crossmodal.maths.compiled import compilation_timed
from crossmodal.systems.compile_ahead import compile_ahead

if TYPE_CHECKING:
    from crossmodal.diagrams.run.live.controls import Control
    from crossmodal.diagrams.run.live.events import EventText
    from crossmodal.diagrams.run.live.session import LiveSession
    from crossmodal.diagrams.run.stream.sinks import Sink
    from crossmodal.diagrams.run.video import VideoWriter


class StationWarning(UserWarning):
    """What a user should know of a station before it runs."""


@contextmanager
def building(source: str) -> Iterator[None]:
    """Turns what systems and models refuse while a Diagram is built into a ScenarioError.

    Args:
        source: The scenario's name or file.
    """
    try:
        yield
    except (ValueError, RuntimeError, OSError, SystemExit) as error:
        # By a SystemExit with words Drake's demands fail, which values from files should not meet.
        if isinstance(error, SystemExit) and not isinstance(error.code, str):
            raise
        place = f"{place_of(error)}: " if place_of(error) else ""
        raise ScenarioError(f"{source}: {place}{one_line(error)}") from error


def build_estimators(
    application: Application, scenario: Scenario, calibration: Calibration | None = None
) -> Mapping[str, System]:
    """The estimators of a scenario, by name.

    Raises:
        ScenarioError: where a value of the scenario is impossible.
    """
    with building(scenario.name):
        calibration = calibration or application.make_calibration(scenario)
        estimators = application.make_estimators(scenario, calibration)
    originals = [name for name in estimators if name not in scenario.variants]
    check_variants(scenario.variants, originals, scenario.name)
    names = with_variants(scenario.modalities or list(estimators), scenario.variants)
    for name in names:
        if name in scenario.variants and name not in estimators:
            raise ScenarioError(
                f"{scenario.name}: variants.{name}: the application '{application.name}' has no"
                " filters that can be replaced: its make_estimators makes no such estimator"
            )
        if name not in estimators:
            raise ScenarioError(
                f"{scenario.name}: modalities: unknown modality '{name}';"
                f" {suggestion(name, estimators)}"
            )
    return {name: estimators[name] for name in names}


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


def build_station(
    application: Application, scenario: Scenario, calibration: Calibration | None = None
) -> Station:
    """The plant, sensors and controllers of one episode.

    Raises:
        ScenarioError: where a value of the scenario is impossible.
    """
    with building(scenario.name):
        calibration = calibration or application.make_calibration(scenario)
        station = application.make_station(scenario, calibration)
    for line in station.warnings:
        warnings.warn(f"{scenario.name}: {line}", StationWarning, stacklevel=2)
    return station


class Episode:
    """The whole diagram of an episode: station, estimators, recorder and view.

    Attributes:
        diagram: All of it.
        station: Plant, sensors and controllers.
        estimators: By name, subsystems of the diagram.
        recorder: Holds what was believed and what was true.
        session: What a person at the live page asks for; None without one.
    """

    def __init__(
        self,
        application: Application,
        scenario: Scenario,
        meshcat: Meshcat | None = None,
        sensors_file: Path | None = None,
        is_live: bool = False,
        begins_paused: bool = False,
        video_file: Path | None = None,
        sink: "Sink | None" = None,
    ) -> None:
        if scenario.replay:
            raise ScenarioError(
                f"{scenario.name}: is of a recording, which is not simulated; repeat it by"
                f" `crossmodal replay {scenario.replay} --calibration ... --topics ...`"
            )
        self._video_file, self._sink = video_file, sink
        self._video: VideoWriter | None = None
        self._scenario = scenario
        self._meshcat = meshcat
        self.session: LiveSession | None = None
        self._events: EventText | None = None
        self._is_live, self._begins_paused = is_live, begins_paused
        with building(scenario.name):
            self._build(application, scenario, sensors_file)

    def _build(
        self, application: Application, scenario: Scenario, sensors_file: Path | None
    ) -> None:
        self.calibration = application.make_calibration(scenario)
        self.station = build_station(application, scenario, self.calibration)
        self.estimators = build_estimators(application, scenario, self.calibration)
        period = scenario.network_period
        builder = DiagramBuilder()
        station = builder.AddNamedSystem("station", self.station.diagram)
        faults = scenario.disturbances.faults
        controls = self._controls(application) if self._is_live else []
        silenced = [control.port for control in controls if control.silences]
        heard = add_stream_faults(builder, station, faults, period, scenario.seed, silenced)
        self._stopwatches = {
            name: _add_estimator(builder, station, heard, name, estimator, period)
            for name, estimator in self.estimators.items()
        }
        application.close_loop(builder, scenario, station, self.estimators)
        quantities = recorded_quantities(application, scenario, self.estimators)
        station_quantities = application.station_quantities(scenario)
        pictures = application.pictures(scenario)
        _check_station(application, station, station_quantities, pictures)
        self.recorder = builder.AddNamedSystem(
            "recorder",
            EpisodeRecorder(
                period, list(self.estimators), quantities, station_quantities, pictures
            ),
        )
        connect_recorder(builder, station, self.estimators, self.recorder)
        self._sensor_log: SensorLogWriter | None = None
        if sensors_file is not None:
            self._sensor_log = _add_sensor_recorder(
                builder,
                application,
                scenario,
                self.calibration,
                station,
                self.estimators,
                sensors_file,
            )
        if self._sink is not None:
            ports = [station.get_output_port(k) for k in range(station.num_output_ports())]
            models = {
                port.get_name(): port.Allocate().get_value()
                for port in ports
                if port.get_data_type() == PortDataType.kAbstractValued
            }
            add_stream(
                builder, self._sink, application, scenario, self.calibration, station,
                self.estimators, models,
            )  # fmt: skip
        if self._video_file is not None:
            from crossmodal.diagrams.run.video import add_video

            film = application.film or application.pictures
            self._video = add_video(
                builder,
                station,
                film(scenario),
                application.viewpoint,
                self._video_file,
                period,
            )
        is_drawn = station.HasOutputPort(SCENE_PORT) or application.view is not None
        if not is_drawn and not self._is_live:
            self._meshcat = None
        if self._meshcat is not None:
            self._add_view(builder, application, self._meshcat, station, controls)
        self.diagram = builder.Build()

    def _controls(self, application: Application) -> Sequence["Control"]:
        """What a person may change in this run."""
        from crossmodal.diagrams.run.live.controls import heard_controls

        return heard_controls(application.controls(self._scenario), self.estimators.values())

    def _add_view(
        self,
        builder: DiagramBuilder,
        application: Application,
        meshcat: Meshcat,
        station: Diagram,
        controls: Sequence["Control"],
    ) -> None:
        from crossmodal.diagrams.drawing.legend import EventBoard
        from crossmodal.diagrams.run.live.controls import connect_controls
        from crossmodal.diagrams.run.live.events import EventText
        from crossmodal.diagrams.run.live.session import LiveSession

        scenario, layers = self._scenario, Layers()
        spans = scenario.disturbances.spans()
        title = f"{scenario.name}, seed {scenario.seed}"
        if self._is_live and not controls:
            title += "; nothing in it can be changed by hand"
        self._events = EventText(EventBoard(meshcat), self.recorder, spans, title)
        if application.view is not None:
            layers = application.view(builder, scenario, meshcat, station, self.estimators)
        if station.HasOutputPort(SCENE_PORT):
            params = MeshcatVisualizerParams(publish_period=1.0 / 16.0)
            scene = builder.AddNamedSystem("meshcat_scene", MeshcatVisualizer(meshcat, params))
            builder.Connect(station.GetOutputPort(SCENE_PORT), scene.query_object_input_port())
        if self._is_live:
            self.session = LiveSession(
                meshcat=meshcat, layers=layers, controls=controls, is_paused=self._begins_paused
            )
            read, period = meshcat.GetSliderValue, scenario.network_period
            connect_controls(builder, station, controls, read, period)

    def Start(self) -> Simulator:
        """A simulator of the diagram in its initial state."""
        simulator = Simulator(self.diagram)
        self.station.initialise(simulator.get_mutable_context())
        if self.station.after_step is not None:
            simulator.set_monitor(self.station.after_step)
        if self._meshcat is not None:
            self._meshcat.DeleteRecording()
            self._meshcat.StartRecording(frames_per_second=16.0)
        if self._events is not None:
            self._events.begin()
        simulator.Initialize()
        return simulator

    def Run(self, progress: Callable[[float], None] | None = None) -> EpisodeRecord:
        """Simulates until the robot has stopped or the scenario's time is over.

        A KeyboardInterrupt ends it early, and so does an error in code of a user's own; what was
        recorded until then is returned.
        """
        scenario = self._scenario
        with building(scenario.name):
            simulator = self.Start()
        root = simulator.get_context()
        interrupted, failure, trace = True, "", ""
        began = time.perf_counter()
        with compilation_timed() as compiling:
            try:
                if self.session is not None:
                    self.session.between_ticks()
                advance_by_ticks(
                    simulator,
                    self.recorder,
                    scenario.network_period,
                    scenario.duration,
                    scenario.stop_time,
                    self.between_ticks(progress),
                )
                interrupted = False
            except KeyboardInterrupt:
                pass
            except Exception as error:
                if not self.recorder.station or not place_of(error):
                    raise
                interrupted, failure, trace = False, told(error), traceback_of(error)
            finally:
                if self._video is not None:
                    self._video.close()
                if self._sensor_log is not None:
                    self._sensor_log.close(
                        root.get_time(), interrupted=interrupted or bool(failure)
                    )
        wall_time = time.perf_counter() - began - compiling.seconds
        if self._events is not None:
            how = "ended by hand" if interrupted else "the episode is over"
            self._events.add(Event(time=root.get_time(), name=how))
        if self.session is not None:
            wall_time -= self.session.waited
            self.session.close()
        for name, (start, stop) in self._stopwatches.items():
            pairs = zip(start.marks, stop.marks, strict=False)
            self.recorder.estimators[name].tick_times = [b - a for a, b in pairs]
        log, video = self._sensor_log, self._video
        return EpisodeRecord(
            scenario=scenario,
            calibration=self.calibration,
            station=self.recorder.station,
            estimators=self.recorder.estimators,
            duration=root.get_time(),
            wall_time=wall_time,
            pictures=self.recorder.pictures,
            events=self.recorder.events,
            peak_memory=peak_memory(),
            interrupted=interrupted,
            failure=failure,
            traceback=trace,
            wants_next=self.session is not None and self.session.wants_next,
            sensors_file=None if log is None or log.failure else log.path,
            video_file=None if video is None or video.failure else video.path,
            missing=[file.failure for file in (log, video) if file is not None and file.failure],
            meshcat_html=None if self._meshcat is None else recorded_page(self._meshcat),
        )

    def between_ticks(
        self, progress: Callable[[float], None] | None = None
    ) -> Callable[[float], None]:
        """What is done with the time [s] after every tick: a person's wishes, and the events."""
        session, events = self.session, self._events

        def between(time: float) -> None:
            if progress is not None:
                progress(time)
            if session is not None:
                hand = [Event(time=time, name=f"by hand: {what}") for what in session.changes()]
                self.recorder.events.extend(hand)
            if events is not None:
                events.update(time)
            if session is not None:
                session.between_ticks()

        return between


def output_ports(system: System) -> list[OutputPort]:
    """All of a system's."""
    return [system.get_output_port(index) for index in range(system.num_output_ports())]


def _check_station(
    application: Application,
    station: System,
    quantities: Sequence[Quantity],
    pictures: Sequence[str],
) -> None:
    """Refuses a port that is to be recorded and that the station does not have."""
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


def _add_estimator(
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


def _add_sensor_recorder(
    builder: DiagramBuilder,
    application: Application,
    scenario: Scenario,
    calibration: Calibration,
    station: Diagram,
    estimators: Mapping[str, System],
    path: Path,
) -> SensorLogWriter:
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


def recorded_page(meshcat: Meshcat) -> str:
    """Meshcat's recording as one page that opens without a server."""
    from crossmodal.diagrams.drawing.legend import KEEPS_BOARDS

    meshcat.PublishRecording()
    return meshcat.StaticHtml() + KEEPS_BOARDS


def run_episode(
    application: Application,
    scenario: Scenario,
    *,
    meshcat: Meshcat | None = None,
    progress: Callable[[float], None] | None = None,
    sensors_file: Path | None = None,
    is_live: bool = False,
    sink: "Sink | None" = None,
    begins_paused: bool = False,
    video_file: Path | None = None,
) -> EpisodeRecord:
    """Builds and simulates one episode.

    Args:
        scenario: What is simulated, with its seed.
        meshcat: Where to draw; the recording becomes part of the record.
        progress: Called with the simulated time [s], about once per tick.
        sensors_file: Where to keep the sensor streams, so that they can be replayed.
        is_live: Whether a person at the page may pause, end and change it.
        sink: Takes images and estimates, for a viewer.
        begins_paused: Whether it then waits for that person before its first tick.
        video_file: Where to keep a video of it.
    """
    if meshcat is not None:
        from crossmodal.diagrams.drawing.legend import EventBoard

        EventBoard(meshcat).show([f"{scenario.name}, seed {scenario.seed}: is being built"])
    compile_ahead(application.name)
    episode = Episode(
        application, scenario, meshcat, sensors_file, is_live, begins_paused, video_file, sink
    )
    return episode.Run(progress)
