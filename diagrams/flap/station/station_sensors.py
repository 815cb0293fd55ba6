"""The sensors of a station: joints, taxels and the camera."""

from collections.abc import Mapping
from dataclasses import replace

from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.framework import OutputPort

from crossmodal.diagrams.flap.robot_config import (
    FINGER,
    FINGER_ARM,
    FINGERTIP,
    HOLDER,
    HOLDER_ARM,
    HOLDER_HAND,
)
from crossmodal.diagrams.flap.robot_view import add_believed_robots
from crossmodal.diagrams.flap.station.wiring import StationWiring
from crossmodal.diagrams.run.sensor_streams.stream_faults import add_stream_faults
from crossmodal.diagrams.stations.add_arm import add_encoders
from crossmodal.diagrams.stations.add_cameras import add_cameras, add_robot_masks
from crossmodal.diagrams.stations.naming import own_seed, prefixed
from crossmodal.plants.hands.three_finger_hand import JOINTS
from crossmodal.plants.robots.lwr import ARM_JOINTS
from crossmodal.systems.sensors.joint_encoders import JointEncoders
from crossmodal.systems.sensors.robot_mask import MaskedRobot
from crossmodal.systems.sensors.taxels import TaxelForces, TaxelSensor, draw_places
from crossmodal.systems.tactile.taxel_layout import TaxelLayout


def add_joint_sensors(
    wiring: StationWiring, arms: Mapping[str, MultibodyPlant]
) -> dict[str, JointEncoders]:
    """Adds the encoders of both arms; exports `<owner>_joint_state_window`.

    Args:
        arms: The arms alone, as they are, by their names.
    """
    start, config = wiring.start, wiring.scenario.sensors.encoders
    return {
        owner: add_encoders(wiring, arm, arms[arm], q, config, owner)
        for owner, arm, q in (
            (HOLDER, HOLDER_ARM, start.holder),
            (FINGER, FINGER_ARM, start.finger),
        )
    }


def add_taxels(wiring: StationWiring, layout: TaxelLayout) -> OutputPort:
    """Adds the taxels, where the seed has put them on the fingertip; exports `taxel_window`.

    Args:
        layout: Where the robot believes them to be.

    Returns:
        `taxel_measured` as it reaches control: a fault of the stream `taxel_window` is one of the
        skin's cable, which control depends on, too.
    """
    builder, plant = wiring.builder, wiring.scene.plant
    config, seed = wiring.scenario.sensors.taxels, wiring.scenario.seed
    places = draw_places(layout.p_ST, config, seed)
    forces = builder.AddNamedSystem(
        "taxel_forces",
        TaxelForces(plant, wiring.fingertip, wiring.skin, places, layout.n_S, config.spread),
    )
    builder.Connect(plant.get_contact_results_output_port(), forces.GetInputPort("contact_results"))
    builder.Connect(plant.get_body_poses_output_port(), forces.GetInputPort("body_poses"))
    sensor = builder.AddNamedSystem(
        "taxels",
        TaxelSensor(
            config,
            len(layout.p_ST),
            own_seed(seed, FINGERTIP),
            wiring.scenario.disturbances.taxels,
            wiring.scenario.network_period,
        ),
    )
    builder.Connect(forces.get_output_port(), sensor.get_input_port())
    builder.ExportOutput(sensor.GetOutputPort("taxel_window"), "taxel_window")
    faults = [
        replace(fault, stream="taxel_measured")
        for fault in wiring.scenario.disturbances.faults
        if fault.stream == "taxel_window" and fault.kind != "clock_jump"
    ]
    return add_stream_faults(builder, sensor, faults, config.period, seed)("taxel_measured")


def add_vision(wiring: StationWiring, encoders: Mapping[str, JointEncoders]) -> None:
    """Adds the camera and the mask of both robots in its images.

    Args:
        encoders: Of the arms, by owner.
    """
    sensors = wiring.scenario.sensors
    depths = add_cameras(wiring, sensors.camera, colour_is_streamed=False)
    # The hand keeps hold of the tool: its fingers are where they are, open or closed.
    closed = {name: (q, q) for name, q in zip(JOINTS, wiring.start.fingers.tolist(), strict=True)}
    robots = {
        HOLDER: MaskedRobot(
            arm=HOLDER_ARM, arm_joints=ARM_JOINTS, hand=HOLDER_HAND, hand_posture=closed
        ),
        FINGER: MaskedRobot(arm=FINGER_ARM, arm_joints=ARM_JOINTS),
    }
    add_robot_masks(
        wiring,
        lambda plant: add_believed_robots(plant, wiring.calibration),
        robots,
        sensors.robot_mask,
        {
            prefixed(owner, "joint_state_measured"): system.GetOutputPort("joint_state_measured")
            for owner, system in encoders.items()
        },
        depths,
    )
