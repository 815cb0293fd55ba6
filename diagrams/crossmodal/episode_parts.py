"""What an episode consists of: station, estimators, what control reads, what is recorded."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from pydrake.systems.framework import Diagram, DiagramBuilder, System

from crossmodal.diagrams.crossmodal.estimators import (
    BODY_MOTIONS,
    BODY_STREAMS,
    SEEN_STREAMS,
    make_network,
)
from crossmodal.diagrams.crossmodal.modalities import FEELING, SEEING
from crossmodal.diagrams.crossmodal.robot_config import ARM
from crossmodal.diagrams.crossmodal.scenario import Scenario
from crossmodal.diagrams.crossmodal.station.start_warnings import (
    overlaps,
    settling,
    unclaimed_errors,
)
from crossmodal.diagrams.crossmodal.station.station import (
    draw_placements,
    make_manipulation_station,
)
from crossmodal.diagrams.crossmodal.station.station_control import PERCEIVED_INPUTS
from crossmodal.diagrams.run.application import Station
from crossmodal.diagrams.run.calibration import Calibration
from crossmodal.diagrams.run.record import Quantity
from crossmodal.diagrams.run.sensor_streams.codecs import JOINT_STATES, WRENCHES, Topic
from crossmodal.diagrams.stations.believed_robots import believed_robots
from crossmodal.plants.robots.wam import WAM_WITH_SOFT_HAND
from crossmodal.systems.kinematics.held_joint import HeldJoint, HeldJointConfig
from crossmodal.systems.port_values import (
    IN_PLACE,
    UNKNOWN_END_EFFECTOR,
    BodyMotions,
    JointBeliefs,
    JointMechanicsBeliefs,
    PoseBelief,
    StreamHealth,
    no_features,
)
from crossmodal.systems.proprioception.grasp_model import initial_grasp
from crossmodal.systems.proprioception.grasp_model_config import GraspModelConfig

QUANTITIES = (
    Quantity(port="joints_latest", model=JointBeliefs()),
    Quantity(port="body_motions_latest", model=BodyMotions()),
    Quantity(port="features_latest", model=no_features(), estimators=SEEING),
    Quantity(port="grasp_latest", model=initial_grasp(GraspModelConfig()), estimators=FEELING),
    Quantity(port="joint_mechanics_latest", model=JointMechanicsBeliefs(), estimators=FEELING),
    Quantity(port="end_effector_latest", model=UNKNOWN_END_EFFECTOR, estimators=FEELING),
    Quantity(
        port="hand_bending_latest",
        model=PoseBelief(X=np.eye(4), covariance=np.eye(6)),
        estimators=FEELING,
    ),
    Quantity(port="camera_displacement_latest", model=IN_PLACE, estimators=SEEING),
    Quantity(port="camera_health_latest", model=StreamHealth(), estimators=SEEING),
    Quantity(port=f"{BODY_MOTIONS}_health_latest", model=StreamHealth()),
    *(
        Quantity(port=f"{stream}_health_latest", model=StreamHealth(), estimators=having)
        for having, streams in ((SEEING, SEEN_STREAMS), (FEELING, BODY_STREAMS))
        for stream in streams
    ),
)
TOPICS = {
    "joint_state_window": Topic(name="/joint_states", window=JOINT_STATES),
    "wrench_window": Topic(name="/wrist/wrench", window=WRENCHES),
    "pressure_window": Topic(name="/hand/pressures"),
    "color_measured": Topic(name="/camera/color/image_raw"),
    "depth_measured": Topic(name="/camera/depth/image_raw"),
    "robot_mask": Topic(name="/camera/robot_mask"),
    "interaction_active": Topic(name="/hand/interaction_active"),
    "cheat_configuration": Topic(name="/cheat/configuration"),
    "cheat_body_pose": Topic(name="/cheat/body_pose"),
    "cheat_joint": Topic(name="/cheat/joint"),
    "cheat_joint_mechanics": Topic(name="/cheat/joint_mechanics"),
    "cheat_hand_pose": Topic(name="/cheat/hand_pose"),
    "cheat_handle_pose": Topic(name="/cheat/handle_pose"),
}
# What an encoder on the motor's side of an elastic cable is taken to be off by, [rad].
_JOINT_OFFSET = float(np.deg2rad(3.0))


def make_calibration(scenario: Scenario) -> Calibration:
    """Camera and arm as the scenario places them, and how well that is taken to be known."""
    robots = {ARM: WAM_WITH_SOFT_HAND}
    return believed_robots(scenario, scenario.plant.scene, robots, scenario.cameras, _JOINT_OFFSET)


def make_station(scenario: Scenario, calibration: Calibration) -> Station:
    """The station of a scenario with its seed."""
    station = make_manipulation_station(scenario, calibration)
    inside = overlaps(station)
    # What begins inside the robot is pushed out of it, which is no fall.
    falling = [] if inside else settling(scenario, draw_placements(scenario), station.q_start)
    return replace(station, warnings=[*inside, *falling, *unclaimed_errors(scenario)])


def make_estimators(scenario: Scenario, calibration: Calibration) -> dict[str, Diagram]:
    """One network of filters for each of the scenario's modalities and variants."""
    return {
        name: make_network(
            scenario.original(name),
            scenario.perception,
            calibration,
            scenario.network_period,
            replacements=scenario.replacements(name),
        )
        for name in scenario.modalities
    }


def close_loop(
    builder: DiagramBuilder, scenario: Scenario, station: System, estimators: Mapping[str, System]
) -> None:
    """Connects what a network believes about the joint in the hand to the controllers."""
    if scenario.task.goal is None:
        return
    network = estimators[scenario.acting_modality]
    readout = builder.AddNamedSystem("held_joint", HeldJoint(HeldJointConfig()))
    for index in range(readout.num_input_ports()):
        port = readout.get_input_port(index)
        if network.HasOutputPort(port.get_name()):
            builder.Connect(network.GetOutputPort(port.get_name()), port)
    for name in PERCEIVED_INPUTS:
        builder.Connect(readout.GetOutputPort(name), station.GetInputPort(name))
