"""Recorded sensor streams drive the estimators again: other filters on the very same measurements.

No plant is built: what the robot knows of itself is in the scenario's calibration, what was true,
where that is known, in the recording.
"""

from collections.abc import Callable, Mapping
from pathlib import Path
from time import perf_counter
from typing import TYPE_CHECKING

from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder, System
from pydrake.systems.sensors import ImageRgba8U

from crossmodal.diagrams.run.application import Application
from crossmodal.diagrams.run.build import build_estimators, building
from crossmodal.diagrams.run.folder.run_folder import SCENARIO_FILE, SENSORS_FILE
from crossmodal.diagrams.run.record import EpisodeRecord
from crossmodal.diagrams.run.recorded_scenario import check_unchanged
from crossmodal.diagrams.run.recorder import EpisodeRecorder
from crossmodal.diagrams.run.scenario import Scenario
from crossmodal.diagrams.run.sensor_streams.log import (
    SensorLog,
    SensorReplay,
    Stream,
    StreamLog,
    make_streams,
)
from crossmodal.diagrams.run.sensor_streams.stream_faults import add_stream_faults
from crossmodal.diagrams.run.ticks import advance_by_ticks
from crossmodal.diagrams.run.wiring import (
    add_stream,
    connect_recorder,
    output_ports,
    recorded_quantities,
    refuse_truth,
    stream_models,
)
from crossmodal.diagrams.run.yaml_input.schema import ScenarioError, suggestion
from crossmodal.systems.compile_ahead import compile_ahead
from crossmodal.systems.port_values import StampedImage

if TYPE_CHECKING:
    from crossmodal.diagrams.run.stream.sinks import Sink


def check_recorded(folder: Path) -> Path:
    """The scenario's file of a recorded run.

    Raises:
        ScenarioError: if there is no recording.
    """
    for needed, remedy in (
        (SCENARIO_FILE, "name the folder of a run"),
        (
            SENSORS_FILE,
            "record one with `crossmodal run ... --record-sensors`; the replay of a recording is"
            f" repeated by the command that `crossmodal run {folder / SCENARIO_FILE}` names",
        ),
    ):
        if not (folder / needed).is_file():
            raise ScenarioError(f"{folder}: holds no {needed}; {remedy}")
    return folder / SCENARIO_FILE


def replay(
    application: Application,
    folder: Path | str,
    scenario: Scenario,
    estimators: Mapping[str, System] | None = None,
    progress: Callable[[float], None] | None = None,
    sink: "Sink | None" = None,
    open_log: Callable[[list[Stream]], StreamLog] | None = None,
) -> EpisodeRecord:
    """Runs estimators side by side on the streams that a run has recorded.

    Args:
        application: What ran it.
        folder: Of the run, or what else is to be named where a stream is missing.
        scenario: As it was run, but for what perceives.
        estimators: By name; by default those of the scenario.
        progress: Called with the time [s] since the recording's start, about once per tick.
        sink: Takes images and estimates, for a viewer.
        open_log: Gives the streams, of those that the stations' ports would be; by default the
            run's own `sensors.mcap`.

    Raises:
        ScenarioError: if the recording is damaged, lacks a stream that an estimator needs, or was
            made with another scenario; if an estimator reads the truth.
    """
    folder = Path(folder)
    compile_ahead(application.name)
    with building(scenario.name):
        calibration = application.make_calibration(scenario)
    if estimators is None:
        estimators = build_estimators(application, scenario, calibration)
    for name, estimator in estimators.items():
        refuse_truth(name, estimator)
    pictures = application.pictures(scenario)
    station_quantities = application.station_quantities(scenario)
    models = dict.fromkeys(pictures, StampedImage(time=0.0, image=ImageRgba8U()))
    models |= stream_models(estimators, station_quantities)
    streams = make_streams(models, application.topics(scenario), calibration)
    source_file = folder / SENSORS_FILE if open_log is None else folder
    log: StreamLog = SensorLog(source_file, streams) if open_log is None else open_log(streams)
    check_unchanged(application, scenario, log.scenario, str(folder / SCENARIO_FILE))
    period = scenario.network_period
    recorder = EpisodeRecorder(
        period,
        list(estimators),
        recorded_quantities(application, scenario, estimators),
        station_quantities,
        pictures,
    )
    builder = DiagramBuilder()
    source = builder.AddNamedSystem("sensor_replay", SensorReplay(log, period))
    with building(scenario.name):
        faults = scenario.disturbances.faults
        heard = add_stream_faults(builder, source, faults, period, scenario.seed)
    for name, estimator in estimators.items():
        builder.AddNamedSystem(name, estimator)
        for index in range(estimator.num_input_ports()):
            port = estimator.get_input_port(index)
            if not source.HasOutputPort(port.get_name()):
                there = [stream.get_name() for stream in output_ports(source)]
                there = [stream for stream in there if not stream.startswith("cheat_")]
                raise ScenarioError(
                    f"{source_file}: holds no stream '{port.get_name()}', which the"
                    f" estimator '{name}' reads: record it again, if it is no mistake;"
                    f" {suggestion(port.get_name(), there)}"
                )
            builder.Connect(heard(port.get_name()), port)
    builder.AddNamedSystem("recorder", recorder)
    connect_recorder(builder, source, estimators, recorder)
    if sink is not None:
        held = {stream.port: stream.model for stream in log.streams}
        add_stream(
            builder, sink, application, scenario, calibration, source, estimators, held, log.start
        )
    simulator = Simulator(builder.Build())
    simulator.Initialize()
    began = perf_counter()
    advance_by_ticks(simulator, recorder, period, log.end, progress=progress)
    return EpisodeRecord(
        scenario=scenario,
        calibration=calibration,
        station=recorder.station,
        estimators=recorder.estimators,
        duration=log.end,
        wall_time=perf_counter() - began,
        pictures=recorder.pictures,
        events=recorder.events,
        interrupted=log.interrupted,
    )
