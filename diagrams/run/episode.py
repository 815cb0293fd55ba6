"""One episode: a scenario with its seed, simulated to the end."""

import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from pydrake.geometry import Meshcat, MeshcatVisualizer, MeshcatVisualizerParams
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Diagram, DiagramBuilder, PortDataType

from crossmodal.diagrams.drawing.layers import Layers
from crossmodal.diagrams.run.application import SCENE_PORT, Application
from crossmodal.diagrams.run.build import build_estimators, build_station, building
from crossmodal.diagrams.run.own_code import place_of, told, traceback_of
from crossmodal.diagrams.run.process import peak_memory
from crossmodal.diagrams.run.record import EpisodeRecord, Event
from crossmodal.diagrams.run.recorder import EpisodeRecorder
from crossmodal.diagrams.run.scenario import Scenario
from crossmodal.diagrams.run.sensor_streams.log import SensorLogWriter
from crossmodal.diagrams.run.sensor_streams.stream_faults import add_stream_faults
from crossmodal.diagrams.run.ticks import advance_by_ticks
from crossmodal.diagrams.run.wiring import (
    add_estimator,
    add_sensor_recorder,
    add_stream,
    check_station,
    connect_recorder,
    recorded_quantities,
)
from crossmodal.diagrams.run.yaml_input.schema import ScenarioError
from crossmodal.maths.compiled import compilation_timed
from crossmodal.systems.compile_ahead import compile_ahead

if TYPE_CHECKING:
    from crossmodal.diagrams.run.live.controls import Control
    from crossmodal.diagrams.run.live.events import EventText
    from crossmodal.diagrams.run.live.session import LiveSession
    from crossmodal.diagrams.run.stream.sinks import Sink
    from crossmodal.diagrams.run.video import VideoWriter


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
            name: add_estimator(builder, station, heard, name, estimator, period)
            for name, estimator in self.estimators.items()
        }
        application.close_loop(builder, scenario, station, self.estimators)
        quantities = recorded_quantities(application, scenario, self.estimators)
        station_quantities = application.station_quantities(scenario)
        pictures = application.pictures(scenario)
        check_station(application, station, station_quantities, pictures)
        self.recorder = builder.AddNamedSystem(
            "recorder",
            EpisodeRecorder(
                period, list(self.estimators), quantities, station_quantities, pictures
            ),
        )
        connect_recorder(builder, station, self.estimators, self.recorder)
        self._sensor_log: SensorLogWriter | None = None
        if sensors_file is not None:
            self._sensor_log = add_sensor_recorder(
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
