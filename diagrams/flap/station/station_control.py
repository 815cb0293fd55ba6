"""How the arms of a station are moved: joint positions that their own drives follow."""

from pydrake.systems.framework import Diagram, OutputPort

from crossmodal.diagrams.flap.flip_control import make_flip_control, make_line_control
from crossmodal.diagrams.flap.flip_status import flip_status
from crossmodal.diagrams.flap.robot_config import (
    FINGER,
    FINGER_ARM,
    HOLDER,
    HOLDER_ARM,
)
from crossmodal.diagrams.flap.station.wiring import StationWiring
from crossmodal.diagrams.stations.connections import export_input, export_outputs
from crossmodal.diagrams.stations.drives import add_drives
from crossmodal.diagrams.stations.task_status import add_task_status
from crossmodal.systems.sensors.joint_encoders import JointEncoders
from crossmodal.systems.shared_settings import with_shared

SET_FORCE, FEED_SPEED = "force_desired", "feed_speed"  # Inputs of the station, (1,) [N], [m/s].


def add_flip_control(wiring: StationWiring, encoders: JointEncoders, taxels: OutputPort) -> Diagram:
    """Adds what moves the fingertip.

    Inputs `flap_angle_latest`, `hinge_latest` and `flap_plane_latest` of the station say what is
    perceived, `force_desired` and
    `feed_speed` what a person wants; they may stay unconnected.

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
    add_drives(wiring, FINGER, FINGER_ARM, encoders, control)
    builder.Connect(taxels, control.GetInputPort("taxel_measured"))
    builder.ExportOutput(taxels, "taxel_measured")
    export_input(builder, "flap_angle_latest", control)
    export_input(builder, "hinge_latest", control)
    export_input(builder, "flap_plane_latest", control)
    for name in (SET_FORCE, FEED_SPEED):
        export_input(builder, name, control)
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
    add_drives(wiring, HOLDER, HOLDER_ARM, encoders, line)
    builder.Connect(flip.GetOutputPort("phase"), line.GetInputPort("flip_phase"))
    export_input(builder, "tool_latest", line)
    export_outputs(builder, line, "tip_estimated")
    ports = {
        f"{name}_{port}": control.GetOutputPort(port)
        for name, control in (("flip", flip), ("line", line))
        for port in ("phase", "failure")
    }
    add_task_status(builder, flip_status, ports)
