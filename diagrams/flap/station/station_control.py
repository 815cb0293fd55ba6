"""How the arms of a station are moved: joint positions that their own drives follow."""

import numpy as np
from pydrake.multibody.tree import ModelInstanceIndex
from pydrake.systems.framework import InputPort, OutputPort
from pydrake.systems.primitives import ConstantVectorSource, MatrixGain

from diagrams.flap.flip_control import make_flip_control
from diagrams.flap.flip_status import FlipStatus
from diagrams.flap.robot_config import FINGER, FINGER_ARM, HOLDER, HOLDER_ARM, HOLDER_HAND, TOOL
from diagrams.flap.station.wiring import StationWiring
from diagrams.run.recorder import STATUS_PORT
from diagrams.stations.naming import prefixed
from maths.arrays import Array
from systems.sensors.joint_encoders import JointEncoders


def add_drives(wiring: StationWiring) -> dict[str, InputPort]:
    """Lets each arm's drives follow joint positions (7,), [rad].

    Returns:
        By owner, where the positions are commanded.
    """
    plant, builder = wiring.scene.plant, wiring.builder
    inputs = {}
    for owner, arm in ((HOLDER, HOLDER_ARM), (FINGER, FINGER_ARM)):
        target = plant.get_desired_state_input_port(wiring.scene.model(arm))
        n = target.size() // 2
        at_rest = np.vstack([np.eye(n), np.zeros((n, n))])
        drives = builder.AddNamedSystem(prefixed(owner, "drives"), MatrixGain(at_rest))
        builder.Connect(drives.get_output_port(), target)
        inputs[owner] = drives.get_input_port()
    return inputs


def add_flip_control(
    wiring: StationWiring,
    drive: InputPort,
    encoders: JointEncoders,
    taxels: OutputPort,
) -> None:
    """Adds what moves the fingertip; exports `task_status`.

    Inputs `flap_angle_latest` and `hinge_latest` of the station say what is perceived; they may
    stay unconnected.

    Args:
        wiring: Of the station.
        drive: Where the finger's joint positions are commanded.
        encoders: Of the finger's arm.
        taxels: `taxel_measured` of the fingertip.
    """
    builder, scenario, start = wiring.builder, wiring.scenario, wiring.start.finger
    as_read = encoders.measure(np.append(start, np.zeros(len(start))), 0)[: len(start)]
    model = wiring.calibration.arms[FINGER_ARM].model
    control = builder.AddNamedSystem(
        "flip_control",
        make_flip_control(scenario.control, model, scenario.finger.layout(), as_read),
    )
    builder.Connect(
        encoders.GetOutputPort("joint_state_measured"),
        control.GetInputPort("joint_state_measured"),
    )
    builder.Connect(taxels, control.GetInputPort("taxel_measured"))
    builder.ExportOutput(taxels, "taxel_measured")
    builder.Connect(control.GetOutputPort("joint_position_commanded"), drive)
    for port in ("flap_angle_latest", "hinge_latest"):
        builder.ExportInput(control.GetInputPort(port), port)
    status = builder.AddNamedSystem("task_status", FlipStatus())
    for port in ("phase", "failure"):
        builder.Connect(control.GetOutputPort(port), status.GetInputPort(port))
    builder.ExportOutput(status.get_output_port(), STATUS_PORT)


def hold_still(wiring: StationWiring, drives: dict[str, InputPort]) -> None:
    """Commands the holding arm, its hand and the hinge's brake to stay as they are."""
    builder, scene, start = wiring.builder, wiring.scene, wiring.start
    holder = builder.AddNamedSystem("holder_posture", ConstantVectorSource(start.holder))
    builder.Connect(holder.get_output_port(), drives[HOLDER])
    _command(wiring, scene.model(HOLDER_HAND), "hand_posture", start.hand)
    brakes = scene.plant.get_desired_state_input_port(scene.model(TOOL)).size() // 2
    _command(wiring, scene.model(TOOL), "hinge_brake", np.zeros(brakes))


def _command(wiring: StationWiring, model: ModelInstanceIndex, name: str, q: Array) -> None:
    port = wiring.scene.plant.get_desired_state_input_port(model)
    if port.size() > 0:
        source = ConstantVectorSource(np.append(q, np.zeros(len(q))))
        builder = wiring.builder
        builder.Connect(builder.AddNamedSystem(name, source).get_output_port(), port)
