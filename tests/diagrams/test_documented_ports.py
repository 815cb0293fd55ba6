"""The ports in the docstrings of all systems of some episodes are the ports that they declare."""

import re
from collections import defaultdict
from collections.abc import Iterator

import pytest
from pydrake.systems.framework import Diagram, LeafSystem, System

from crossmodal.diagrams.applications import load_scenario
from crossmodal.diagrams.crossmodal.meshcat_view import MeshcatView
from crossmodal.diagrams.crossmodal.robot_config import ARM, HAND
from crossmodal.diagrams.drawing.meshcat import start_meshcat
from crossmodal.diagrams.run.calibration import Calibration
from crossmodal.diagrams.run.episode import Episode
from crossmodal.diagrams.run.record import TaskStatus
from crossmodal.diagrams.run.recorder import STATUS_PORT
from crossmodal.diagrams.run.sensor_streams.log import (
    SensorLog,
    SensorRecorder,
    SensorReplay,
    make_streams,
)
from crossmodal.plants.camera_view import renderer_intrinsics
from crossmodal.plants.hands.soft_hand import CLOSED_POSTURE
from crossmodal.plants.robots.arm_with_hand import add_robot
from crossmodal.plants.robots.wam import ARM_JOINTS, WAM_WITH_SOFT_HAND
from crossmodal.systems.arm_pose import ArmPose
from crossmodal.systems.sensors.image_stamps import ImageStamps, Mounting
from crossmodal.systems.sensors.robot_mask import MaskedRobot, RobotMask, RobotMaskConfig
from tests.documented_ports import documented_of

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


def with_optional_ports(calibration: Calibration) -> list[Diagram | LeafSystem]:
    """Systems with ports that their instances in the episode have no use for."""
    arm = calibration.arm
    carried = Mounting(arm=ArmPose(arm.model, arm.covariance, arm.joint_offset_std))
    hand_joints = list(CLOSED_POSTURE)
    robot = MaskedRobot(arm=ARM, arm_joints=ARM_JOINTS, hand=HAND, hand_joints=hand_joints)
    mask = RobotMask(
        RobotMaskConfig(),
        lambda plant: add_robot(plant, WAM_WITH_SOFT_HAND, arm.X_WBase, ARM, HAND),
        renderer_intrinsics(calibration.camera.intrinsics),
        calibration.camera.X_PC,
        {"robot": robot},
    )
    return [ImageStamps(carried), mask, *systems_within(mask)]


def built(scenario: str) -> Episode:
    return Episode(*load_scenario(scenario))


@pytest.fixture(scope="module")
def declared(tmp_path_factory: pytest.TempPathFactory) -> dict[type, dict[str, set[str]]]:
    """By class of our own, the names of input and output ports that its instances declare."""
    episode = built("drawer-return")
    view = MeshcatView(start_meshcat(), list(episode.estimators))
    path = tmp_path_factory.mktemp("log") / "sensors.mcap"
    streams = make_streams({STATUS_PORT: TaskStatus()}, {})
    recorder = SensorRecorder(path, streams, 1.0)
    recorder.log.write(streams[0], TaskStatus(), 0.0)
    recorder.log.close()
    replay = SensorReplay(SensorLog(path, streams), 1.0)
    ports: dict[type, dict[str, set[str]]] = defaultdict(lambda: {"input": set(), "output": set()})
    optional = with_optional_ports(episode.calibration)
    others = [built("pose"), built("pose-estimation")]
    systems = [system for one in (episode, *others) for system in systems_within(one.diagram)]
    for system in [*systems, view, recorder, replay, *optional]:
        if type(system).__module__.startswith(_ROOMS):
            for i in range(system.num_input_ports()):
                ports[type(system)]["input"].add(system.get_input_port(i).get_name())
            for i in range(system.num_output_ports()):
                ports[type(system)]["output"].add(system.get_output_port(i).get_name())
    return ports


def test_all_filters_sensors_and_controllers_are_in_an_episode(
    declared: dict[type, dict[str, set[str]]],
) -> None:
    names = {cls.__name__ for cls in declared}
    assert {"FeatureMotion", "GraspModel", "KinematicModel", "CameraNoise", "RobotMask"} <= names
    assert {"ImpedanceController", "ExplorationController", "PneumaticHand"} <= names
    assert {"SensorRecorder", "SensorReplay", "EpisodeRecorder", "TaskStatusSource"} <= names
    assert {"Look", "GuardedTouch", "TaxelArrayForces", "TaxelArraySensor"} <= names
    assert {"PoseMeasurements", "PoseEstimator", "ViewPlanner", "TouchPlanner"} <= names
    assert {"MeasuringRig"} <= names
    assert len(names) > 30


@pytest.mark.parametrize("kind", ["input", "output"])
def test_documented_ports_are_the_declared_ones(
    declared: dict[type, dict[str, set[str]]], kind: str
) -> None:
    for cls, ports in declared.items():
        names = documented_of(cls, kind)
        for port in ports[kind]:
            assert any(matches(port, name) for name in names), (
                f"{cls.__name__}: {port} undocumented"
            )
        for name in names:
            found = any(matches(port, name) for port in ports[kind])
            assert found, f"{cls.__name__}: there is no {kind} port {name}"
