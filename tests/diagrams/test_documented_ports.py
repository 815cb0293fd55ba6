"""The ports in the docstrings of all systems of an episode are the ports that they declare."""

import re
from collections import defaultdict
from collections.abc import Iterator

import pytest
from pydrake.systems.framework import Diagram, System

from crossmodal.diagrams.applications import load_scenario
from crossmodal.diagrams.crossmodal.meshcat_view import MeshcatView
from crossmodal.diagrams.drawing.meshcat import start_meshcat
from crossmodal.diagrams.run.episode import Episode
from crossmodal.diagrams.run.record import TaskStatus
from crossmodal.diagrams.run.recorder import STATUS_PORT
from crossmodal.diagrams.run.sensor_streams.log import (
    SensorLog,
    SensorRecorder,
    SensorReplay,
    make_streams,
)
from tests.documented_ports import documented_ports

_ROOMS = (
    "crossmodal.systems.",
    "crossmodal.controllers.",
    "crossmodal.plants.",
    "crossmodal.diagrams.",
)


def systems_within(diagram: Diagram) -> Iterator[System]:
    for system in diagram.GetSystems():
        yield system
        if isinstance(system, Diagram):
            yield from systems_within(system)


def matches(name: str, documented_name: str) -> bool:
    pattern = re.sub(r"<\w+>|\(\w+\)", r"\\w+", documented_name)
    pattern = re.sub(r"\[\w+\]", r"\\w*", pattern)
    return re.fullmatch(pattern, name) is not None


@pytest.fixture(scope="module")
def declared(tmp_path_factory: pytest.TempPathFactory) -> dict[type, dict[str, set[str]]]:
    """By class of our own, the names of input and output ports that its instances declare."""
    application, scenario = load_scenario("drawer-return")
    episode = Episode(application, scenario)
    view = MeshcatView(start_meshcat(), scenario.modalities)
    path = tmp_path_factory.mktemp("log") / "sensors.mcap"
    streams = make_streams({STATUS_PORT: TaskStatus()}, {})
    recorder = SensorRecorder(path, streams, 1.0)
    recorder.log.write(streams[0], TaskStatus(), 0.0)
    recorder.log.close()
    replay = SensorReplay(SensorLog(path, streams), 1.0)
    ports: dict[type, dict[str, set[str]]] = defaultdict(lambda: {"input": set(), "output": set()})
    for system in [*systems_within(episode.diagram), view, recorder, replay]:
        if type(system).__module__.startswith(_ROOMS):
            for i in range(system.num_input_ports()):
                ports[type(system)]["input"].add(system.get_input_port(i).get_name())
            for i in range(system.num_output_ports()):
                ports[type(system)]["output"].add(system.get_output_port(i).get_name())
    return ports


def test_all_filters_sensors_and_controllers_are_in_the_episode(
    declared: dict[type, dict[str, set[str]]],
) -> None:
    names = {cls.__name__ for cls in declared}
    assert {"FeatureMotion", "GraspModel", "KinematicModel", "CameraNoise", "RobotMask"} <= names
    assert {"ImpedanceController", "ExplorationController", "PneumaticHand"} <= names
    assert {"SensorRecorder", "SensorReplay", "EpisodeRecorder", "TaskStatusSource"} <= names
    assert len(names) > 20


@pytest.mark.parametrize("kind", ["input", "output"])
def test_documented_ports_are_the_declared_ones(
    declared: dict[type, dict[str, set[str]]], kind: str
) -> None:
    for cls, ports in declared.items():
        names = documented_ports(cls.__doc__, kind)
        for port in ports[kind]:
            assert any(matches(port, name) for name in names), (
                f"{cls.__name__}: {port} undocumented"
            )
        for name in names:
            found = any(matches(port, name) for port in ports[kind])
            assert found, f"{cls.__name__}: there is no {kind} port {name}"
