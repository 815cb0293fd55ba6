"""What an episode consists of: station, estimators, what control reads, what is recorded."""

from collections.abc import Mapping

import numpy as np
from pydrake.math import RigidTransform
from pydrake.systems.framework import Diagram, DiagramBuilder, System

from crossmodal.diagrams.flap.estimators import JOINT_STREAMS, SEEN_STREAMS, TAXELS, make_estimator
from crossmodal.diagrams.flap.robot_config import ROBOTS
from crossmodal.diagrams.flap.scenario import Scenario
from crossmodal.diagrams.flap.truth import UNKNOWN_FLAP
from crossmodal.diagrams.run.calibration import Calibration
from crossmodal.diagrams.run.record import Quantity
from crossmodal.diagrams.run.sensor_streams.codecs import JOINT_STATES, Topic
from crossmodal.diagrams.stations.believed_robots import believed_robots
from crossmodal.systems.port_values import (
    UNKNOWN_ANGLE,
    UNKNOWN_FINGERTIP,
    UNKNOWN_HINGE,
    UNKNOWN_TOOL,
    StreamHealth,
    unseen,
)

QUANTITIES = (
    Quantity(port="tool_latest", model=UNKNOWN_TOOL),
    Quantity(port="hinge_latest", model=UNKNOWN_HINGE),
    Quantity(port="flap_angle_latest", model=UNKNOWN_ANGLE),
    Quantity(port="flap_plane_latest", model=unseen("no image yet")),
    Quantity(port="fingertip_contact_latest", model=UNKNOWN_FINGERTIP),
    *(
        Quantity(port=f"{stream}_health_latest", model=StreamHealth())
        for stream in (*SEEN_STREAMS, *JOINT_STREAMS, TAXELS)
    ),
)
STATION_QUANTITIES = (
    Quantity(port="tip_estimated", model=np.full(3, np.nan)),
    Quantity(port="cheat_flap", model=UNKNOWN_FLAP),
    Quantity(port="cheat_edge_pose", model=RigidTransform()),
    Quantity(port="cheat_end_effector_pose", model=RigidTransform()),
    Quantity(port="cheat_fingertip_pose", model=RigidTransform()),
)
TOPICS = {
    "holder_joint_state_window": Topic(name="/holder/joint_states", window=JOINT_STATES),
    "finger_joint_state_window": Topic(name="/finger/joint_states", window=JOINT_STATES),
    "taxel_window": Topic(name="/fingertip/taxels"),
    "color_measured": Topic(name="/camera/color/image_raw"),
    "depth_measured": Topic(name="/camera/depth/image_raw"),
    "robot_mask": Topic(name="/camera/robot_mask"),
    "tip_estimated": Topic(name="/holder/tip"),
    "cheat_flap": Topic(name="/cheat/flap"),
    "cheat_edge_pose": Topic(name="/cheat/edge_pose"),
    "cheat_end_effector_pose": Topic(name="/cheat/end_effector_pose"),
    "cheat_fingertip_pose": Topic(name="/cheat/fingertip_pose"),
}
# Beliefs that control acts by: the station's inputs of these names.
PERCEIVED = ("flap_angle_latest", "hinge_latest", "flap_plane_latest", "tool_latest")
# What is left of an encoder's offset behind the gears once the joints are mastered, [rad].
_JOINT_OFFSET = float(np.deg2rad(0.05))


def make_calibration(scenario: Scenario) -> Calibration:
    """Camera and arms as scenario and seed place them, and how well that is taken to be known."""
    cameras = scenario.drawn_cameras()
    return believed_robots(scenario, scenario.plant.scene, ROBOTS, cameras, _JOINT_OFFSET)


def make_estimators(scenario: Scenario, calibration: Calibration) -> dict[str, Diagram]:
    """The estimators that the scenario asks for."""
    layout = scenario.finger.layout()
    return {
        name: make_estimator(
            scenario.original(name),
            scenario.perception,
            calibration,
            layout,
            scenario.network_period,
            replacements=scenario.replacements(name),
        )
        for name in scenario.modalities
    }


def close_loop(
    builder: DiagramBuilder, scenario: Scenario, station: System, estimators: Mapping[str, System]
) -> None:
    """Lets both arms act by what the acting estimator believes of flap and tool."""
    estimator = estimators[scenario.acting_estimator]
    for port in PERCEIVED:
        builder.Connect(estimator.GetOutputPort(port), station.GetInputPort(port))
