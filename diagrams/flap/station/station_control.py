"""How the arms of a station are moved: joint positions that their own drives follow."""

import numpy as np
from pydrake.systems.framework import Diagram, OutputPort
from pydrake.systems.primitives import ConstantVectorSource, MatrixGain

from crossmodal.diagrams.flap.flip_control import make_flip_control, make_line_control
from crossmodal.diagrams.flap.flip_status import flip_status
from crossmodal.diagrams.flap.robot_config import (
    FINGER,
    FINGER_ARM,
    HOLDER,
    HOLDER_ARM,
    HOLDER_HAND,
)
from crossmodal.diagrams.flap.station.wiring import StationWiring
from crossmodal.diagrams.stations.connections import connect_alike, export_input, export_outputs
from crossmodal.diagrams.stations.naming import prefixed
from crossmodal.diagrams.stations.task_status import add_task_status
from crossmodal.systems.sensors.joint_encoders import JointEncoders
from crossmodal.systems.shared_settings import with_shared


def add_flip_control(wiring: StationWiring, encoders: JointEncoders, taxels: OutputPort) -> Diagram:
    """Adds what moves the fingertip.

    Inputs `flap_angle_latest` and `hinge_latest` of the station say what is perceived; they may
    stay unconnected.

    Args:
        encoders: Of the finger's arm.
        taxels: `taxel_measured` of the fingertip.
    """
    builder, scenario = wiring.builder, wiring.scenario
    noise, lever = wiring.calibration.noise, scenario.perception.angle.lever
    control = builder.AddNamedSystem(
        "flip_control",
        make_flip_control(
            with_shared(scenario.control, noise=noise, typical_distance=lever),
            wiring.calibration.arms[FINGER_ARM].model,
            scenario.finger.layout(),
            encoders.as_read(wiring.start.finger),
        ),
    )
    _drive(wiring, FINGER, FINGER_ARM, encoders, control)
    builder.Connect(taxels, control.GetInputPort("taxel_measured"))
    builder.ExportOutput(taxels, "taxel_measured")
    export_input(builder, "flap_angle_latest", control)
    export_input(builder, "hinge_latest", control)
    return control


def add_line_control(wiring: StationWiring, encoders: JointEncoders, flip: Diagram) -> None:
    """Adds what moves the held tool; exports `tip_estimated` and `task_status`.

    The station's input `tool_latest` says what is perceived of it; it may stay unconnected.

    Args:
        encoders: Of the arm with the tool.
        flip: What moves the fingertip.
    """
    builder = wiring.builder
    line = builder.AddNamedSystem(
        "line_control",
        make_line_control(
            wiring.scenario.control,
            wiring.calibration.arms[HOLDER_ARM].model,
            encoders.as_read(wiring.start.holder),
        ),
    )
    _drive(wiring, HOLDER, HOLDER_ARM, encoders, line)
    builder.Connect(flip.GetOutputPort("phase"), line.GetInputPort("flip_phase"))
    export_input(builder, "tool_latest", line)
    export_outputs(builder, line, "tip_estimated")
    ports = {
        f"{name}_{port}": control.GetOutputPort(port)
        for name, control in (("flip", flip), ("line", line))
        for port in ("phase", "failure")
    }
    add_task_status(builder, flip_status, ports)


def _drive(
    wiring: StationWiring, owner: str, arm: str, encoders: JointEncoders, control: Diagram
) -> None:
    """Lets a control read an arm's joints, and the arm's drives follow it."""
    builder, plant = wiring.builder, wiring.plant
    target = plant.get_desired_state_input_port(wiring.scene.model(arm))
    n = target.size() // 2
    at_rest = np.vstack([np.eye(n), np.zeros((n, n))])
    drives = builder.AddNamedSystem(prefixed(owner, "drives"), MatrixGain(at_rest))
    connect_alike(builder, encoders, "joint_state_measured", control)
    command = control.GetOutputPort("joint_position_commanded")
    builder.Connect(command, drives.get_input_port())
    builder.Connect(drives.get_output_port(), target)


def hold_still(wiring: StationWiring) -> None:
    """Commands the hand around the tool to stay; the scene does so for the tool's hinge."""
    scene, q = wiring.scene, wiring.start.hand
    port = scene.plant.get_desired_state_input_port(scene.model(HOLDER_HAND))
    if port.size() > 0:
        source = ConstantVectorSource(np.append(q, np.zeros(len(q))))
        builder = wiring.builder
        builder.Connect(builder.AddNamedSystem("hand_posture", source).get_output_port(), port)
