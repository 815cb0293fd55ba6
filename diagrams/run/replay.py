"""Recorded sensor streams drive the network again: other wirings on the very same measurements."""

import json
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from time import perf_counter
from typing import Any

from pydrake.common.value import AbstractValue
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import BasicVector, Context, Diagram, DiagramBuilder, LeafSystem

from diagrams.crossmodal.estimators import RobotKnowledge, make_network
from diagrams.crossmodal.scenario import Scenario, load_scenario
from diagrams.run.episode import build_station, connect_latest, joint_truth
from diagrams.run.record import EpisodeResult, Event, Phase, PinholeCamera
from diagrams.run.recorder import EpisodeRecorder, RecorderConfig
from diagrams.run.run_folder import SCENARIO_FILE, SENSORS_FILE, SUMMARY_FILE
from diagrams.run.sensor_log import STREAMS, SensorLog
from diagrams.run.yaml_schema import ScenarioError


class SensorReplay(LeafSystem):
    """Hands out recorded sensor streams as the station handed out the measurements.

    At the tick t a window holds the samples of (t - period, t], every other port the last value at
    or before t. Between ticks the ports keep the last tick's values.

    .. pydrake_system::

        name: SensorReplay
        output_ports:
        - <stream>

    - `<stream>`: each of `STREAMS` that the file holds, typed like the station's.

    Args:
        log: The streams.
        period: Of the ticks, [s].
    """

    def __init__(self, log: SensorLog, period: float) -> None:
        super().__init__()
        self._log = log
        self._period = period
        self._read_tick = -1
        self._values: dict[str, Any] = {}
        for port in log.ports:
            model = STREAMS[port].model
            if model is None:
                self.DeclareVectorOutputPort(port, 1, self._writer(port), {self.time_ticket()})
            else:
                self.DeclareAbstractOutputPort(
                    port, model, self._writer(port), {self.time_ticket()}
                )

    def _writer(self, port: str) -> Callable[[Context, Any], None]:
        def write(context: Context, output: BasicVector | AbstractValue) -> None:
            output.set_value(self._at(context.get_time())[port])

        return write

    def _at(self, time: float) -> dict[str, Any]:
        """All values at the last tick, read from the file once for all ports."""
        tick = int(time / self._period + 1e-6)
        if tick != self._read_tick:
            self._values = self._log.read(tick * self._period, self._period)
            self._read_tick = tick
        return self._values


@dataclass(kw_only=True)
class Wiring:
    """A modality and the wires that it does without, see `CROSSMODAL_WIRES`."""

    modality: str = "crossmodal"
    cut: Sequence[str] = ()


def load_recorded_scenario(folder: Path, overrides: Sequence[str] = ()) -> Scenario:
    """The scenario of a recorded run; only what perceives can be replaced.

    Raises:
        ScenarioError: if there is no recording, or the change would need another simulation.
    """
    for needed, remedy in (
        (SCENARIO_FILE, "name the folder of a run"),
        (SENSORS_FILE, "record one with `crossmodal run ... --record-sensors`"),
    ):
        if not (folder / needed).is_file():
            raise ScenarioError(f"{folder}: holds no {needed}; {remedy}")
    for assignment in overrides:
        if assignment.split("=")[0].split(".")[0].strip() not in ("perception", "modalities"):
            raise ScenarioError(
                f"--set {assignment}: a replay keeps what was measured;"
                " only perception and modalities can be replaced"
            )
    return load_scenario(str(folder / SCENARIO_FILE), overrides)


def replay(
    folder: Path,
    scenario: Scenario,
    wirings: Mapping[str, Wiring],
    progress: Callable[[float], None] | None = None,
) -> EpisodeResult:
    """Runs networks side by side on the streams that a run has recorded.

    Args:
        folder: Of the run.
        scenario: From `load_recorded_scenario`.
        wirings: The networks by name, which is their key in the result's `modalities`.
        progress: Called with the time [s] since the recording's start, about once per tick.
    """
    log = SensorLog(folder / SENSORS_FILE)
    station = build_station(scenario, scenario.seed)
    robot = RobotKnowledge(arm=station.arm, intrinsics=station.intrinsics, X_WC=station.X_WC)
    networks = {
        name: make_network(
            wiring.modality, replace(scenario.perception, cut=list(wiring.cut)), robot
        )
        for name, wiring in wirings.items()
    }
    period = scenario.network_period
    recorder = EpisodeRecorder(RecorderConfig(period=period), list(networks))
    simulator = Simulator(_diagram(SensorReplay(log, period), networks, recorder))
    simulator.Initialize()
    began = perf_counter()
    ticks = int(log.end / period + 1e-6)
    for tick in range(ticks + 1):
        simulator.AdvanceTo((tick + 0.6) * period)
        if progress is not None:
            progress(tick * period)
    return EpisodeResult(
        scenario=scenario,
        truth=recorder.truth(station.joint.name(), *joint_truth(station)),
        modalities=recorder.modalities,
        camera=PinholeCamera(
            K=station.intrinsics.intrinsic_matrix(), X_WC=station.X_WC.GetAsMatrix4()
        ),
        duration=log.end,
        wall_time=perf_counter() - began,
        frames=recorder.frames,
        **_outcome(folder),
    )


def _outcome(folder: Path) -> dict[str, Any]:
    """What the recorded run came to; perceiving it again changes nothing of that."""
    try:
        summary = json.loads((folder / SUMMARY_FILE).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}
    return {
        "failure": summary["failure"],
        "phases": {
            name: Phase(
                target=phase["target"],
                reached=math.nan if phase["reached"] is None else phase["reached"],
            )
            for name, phase in summary["phases"].items()
        },
        "events": [Event(time=event["time"], name=event["name"]) for event in summary["events"]],
    }


def _diagram(
    source: SensorReplay, networks: Mapping[str, Diagram], recorder: EpisodeRecorder
) -> Diagram:
    builder = DiagramBuilder()
    builder.AddNamedSystem("sensor_replay", source)
    for name, network in networks.items():
        network.set_name(name)
        builder.AddSystem(network)
        for index in range(network.num_input_ports()):
            port = network.get_input_port(index)
            builder.Connect(source.GetOutputPort(port.get_name()), port)
    builder.AddNamedSystem("recorder", recorder)
    for output, port in (
        ("interaction_active", "interaction_active"),
        ("cheat_configuration", "cheat_configuration"),
        ("cheat_body_pose", "cheat_body_pose"),
        ("color_measured", "color_image"),
    ):
        builder.Connect(source.GetOutputPort(output), recorder.GetInputPort(port))
    for name, network in networks.items():
        connect_latest(builder, network, name, recorder)
    return builder.Build()
