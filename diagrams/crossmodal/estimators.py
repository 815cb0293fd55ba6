"""The network of coupled filters: one factory, three wirings of the same systems."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from pydrake.systems.framework import Diagram, DiagramBuilder, System

from crossmodal.diagrams.crossmodal.modalities import MODALITIES
from crossmodal.diagrams.run.calibration import Calibration
from crossmodal.systems.kinematics.joint_filters_config import JointFiltersConfig, TypePriorsConfig
from crossmodal.systems.kinematics.kinematic_model import KinematicModel, KinematicModelConfig
from crossmodal.systems.kinematics.measurement_errors import MeasurementErrorsConfig
from crossmodal.systems.kinematics.mechanics.joint_mechanics import JointMechanicsFilter
from crossmodal.systems.kinematics.mechanics.joint_mechanics_config import JointMechanicsConfig
from crossmodal.systems.monitoring.angles import AnglesByRates, AnglesConfig
from crossmodal.systems.monitoring.arm_response import ArmResponse, ArmResponseConfig
from crossmodal.systems.monitoring.image_monitor import ImageMonitor, ImageMonitorConfig
from crossmodal.systems.monitoring.offsets import OffsetModel
from crossmodal.systems.monitoring.steps import IsolatedSteps, StepsConfig
from crossmodal.systems.monitoring.window_monitor import WindowMonitor, WindowMonitorConfig
from crossmodal.systems.proprioception.end_effector_motion import (
    EndEffectorMotion,
    EndEffectorMotionConfig,
)
from crossmodal.systems.proprioception.grasp_model import GraspModel
from crossmodal.systems.proprioception.grasp_model_config import GraspModelConfig
from crossmodal.systems.proprioception.hand_bending import HandBending, HandBendingConfig
from crossmodal.systems.proprioception.held_body_motion import (
    HeldBodyMotion,
    HeldBodyMotionConfig,
)
from crossmodal.systems.proprioception.slip_detection import SlipDetection, SlipDetectionConfig
from crossmodal.systems.vision.bodies.rigid_body_motion import RigidBodyMotion
from crossmodal.systems.vision.bodies.rigid_body_motion_config import RigidBodyMotionConfig
from crossmodal.systems.vision.features.feature_motion import FeatureMotion
from crossmodal.systems.vision.features.feature_motion_config import FeatureMotionConfig

VISION_INPUTS = ("color_measured", "depth_measured", "robot_mask")
SEEN_STREAMS = ("color", "depth")  # Those that a monitor watches, of the eye and of the body.
FELT_STREAMS = ("joint_state", "wrench", "pressure")
BODY_MOTIONS = "body_motions"  # What the joints are made of.
PROPRIOCEPTION_INPUTS = (
    "joint_state_window",
    "wrench_window",
    "pressure_window",
    "interaction_active",
)


@dataclass(frozen=True, kw_only=True)
class CrossModalWire:
    """A flow of information that a scenario may cut, by its connections.

    Attributes:
        carries: What, and what for.
        connections: (system, output port, system, input port); every input works unconnected.
    """

    carries: str
    connections: tuple[tuple[str, str, str, str], ...]


CROSSMODAL_WIRES = {
    "held_body_to_vision": CrossModalWire(
        carries="where the hand takes its body, so that vision finds its features",
        connections=(("held_body_motion", "body_prior", "rigid_body_motion", "held_body_prior"),),
    ),
    "features_to_held_body": CrossModalWire(
        carries="the features of the body in the hand, which correct its pose",
        connections=(
            (
                "feature_motion",
                "features_estimated",
                "held_body_motion",
                "features_estimated",
            ),
            (
                "rigid_body_motion",
                "body_motions_estimated",
                "held_body_motion",
                "body_motions_estimated",
            ),
        ),
    ),
    "held_body_to_grasp": CrossModalWire(
        carries="how the body in the hand was seen to move, from which the grasp is learnt",
        connections=(
            (
                "held_body_motion",
                "body_motions_estimated",
                "grasp_model",
                "body_motions_estimated",
            ),
        ),
    ),
    "visual_bodies_to_joints": CrossModalWire(
        carries="bodies that only vision sees, to which the body in the hand may be jointed",
        connections=(
            ("rigid_body_motion", "body_motions_estimated", "kinematic_model", "body_motions"),
        ),
    ),
    "joints_to_vision": CrossModalWire(
        carries="where the joints expect the bodies, as one more prediction for vision",
        connections=(
            ("kinematic_model", "bodies_predicted", "rigid_body_motion", "joint_predictions"),
        ),
    ),
}


def check_cut(cut: Sequence[str]) -> None:
    """Raises ValueError, naming the known wires, where one is unknown."""
    for name in cut:
        if name not in CROSSMODAL_WIRES:
            raise ValueError(
                f"perception.cut: unknown wire '{name}'; there are {', '.join(CROSSMODAL_WIRES)}"
            )


_FURNITURE = TypePriorsConfig(screw=0.02, rigid=0.4)  # Few of its joints are screws.
_HINGE_PITCH = 3e-3  # What errors that last make a hinge climb, [m/rad].


def errors_of_the_eye() -> MeasurementErrorsConfig:
    """Bodies followed by the eye drift by a tenth of a millimetre or two for seconds."""
    return MeasurementErrorsConfig(
        correlated_rotation=1.5e-3, correlated_translation=1.5e-4, correlated_time=2.0
    )


def joints_of_furniture() -> KinematicModelConfig:
    """What an arm opens has its hinge within reach.

    The hand pulls at what the eye sees; unseen, a body's error is that of the hand.
    """
    return KinematicModelConfig(
        filters=JointFiltersConfig(
            type_priors=_FURNITURE,
            ranking_priors=_FURNITURE,
            hinge_pitch=_HINGE_PITCH,
            errors=MeasurementErrorsConfig(
                correlated_rotation=3e-3,
                correlated_translation=3e-4,
                correlated_time=2.0,
                declared_time=5.0,
            ),
        )
    )


@dataclass(kw_only=True)
class PerceptionConfig:
    """One config per filter.

    Attributes:
        joints: Of all networks; the errors are those of bodies that the hand moves.
        visual_errors: Of bodies that only the eye sees, in the place of those.
        cut: Wires of `CROSSMODAL_WIRES` that the cross-modal network does without.
    """

    cut: list[str] = field(default_factory=list)
    windows: WindowMonitorConfig = field(default_factory=WindowMonitorConfig)
    angles: AnglesConfig = field(default_factory=AnglesConfig)
    steps: StepsConfig = field(default_factory=StepsConfig)
    arm_response: ArmResponseConfig = field(default_factory=ArmResponseConfig)
    images: ImageMonitorConfig = field(default_factory=ImageMonitorConfig)
    end_effector: EndEffectorMotionConfig = field(default_factory=EndEffectorMotionConfig)
    hand_bending: HandBendingConfig = field(default_factory=HandBendingConfig)
    slip: SlipDetectionConfig = field(default_factory=SlipDetectionConfig)
    grasp: GraspModelConfig = field(default_factory=GraspModelConfig)
    held_body: HeldBodyMotionConfig = field(default_factory=HeldBodyMotionConfig)
    features: FeatureMotionConfig = field(default_factory=FeatureMotionConfig)
    bodies: RigidBodyMotionConfig = field(default_factory=RigidBodyMotionConfig)
    joints: KinematicModelConfig = field(default_factory=joints_of_furniture)
    visual_errors: MeasurementErrorsConfig = field(default_factory=errors_of_the_eye)
    joint_mechanics: JointMechanicsConfig = field(default_factory=JointMechanicsConfig)


def make_network(modality: str, config: PerceptionConfig, calibration: Calibration) -> Diagram:
    """The filters of one modality, wired.

    Inputs are those of `VISION_INPUTS` and `PROPRIOCEPTION_INPUTS` that the modality uses; outputs
    are `joints_latest`, `body_motions_latest` with its health and, where they exist,
    `features_latest`, `grasp_latest`, `hand_bending_latest`, `end_effector_latest` and
    `joint_mechanics_latest`.

    Args:
        modality: One of `MODALITIES`.

    Raises:
        ValueError: for an unknown modality or an impossible config value.
    """
    if modality not in MODALITIES:
        raise ValueError(f"unknown modality '{modality}'; there are {', '.join(MODALITIES)}")
    check_cut(config.cut)
    builder = DiagramBuilder()
    kinematics = config.joints
    if modality == "vision":
        filters = replace(kinematics.filters, errors=config.visual_errors)
        kinematics = replace(kinematics, filters=filters)
        model = _add(builder, "kinematic_model", KinematicModel(kinematics, inputs=1))
        bodies = _add_vision(builder, config, calibration, with_held_body=False)
        _wire(builder, bodies, "body_motions_estimated", model, "body_motions")
        _wire(builder, model, "bodies_predicted", bodies, "joint_predictions")
    elif modality == "proprioception":
        model = _add(builder, "kinematic_model", KinematicModel(kinematics, inputs=1))
        body, grasp = _add_proprioception(builder, config, calibration, corrected_by_vision=False)
        _wire(builder, body, "body_motions_estimated", grasp, "body_motions_estimated")
        _wire(builder, body, "body_motions_estimated", model, "body_motions")
    else:
        model = _add(builder, "kinematic_model", KinematicModel(kinematics, inputs=2))
        _add_vision(builder, config, calibration, with_held_body=True)
        body, _ = _add_proprioception(builder, config, calibration, corrected_by_vision=True)
        for name, wire in CROSSMODAL_WIRES.items():
            if name not in config.cut:
                _connect(builder, wire)
        # What hand and eye know together of the interacted body counts, not what the eye knows.
        _wire(builder, body, "body_motions_estimated", model, "body_motions_1")
    if modality != "vision":
        _add_joint_mechanics(builder, config, model)
    _export_outputs(builder, model, "joints_latest", "body_motions_latest")
    builder.ExportOutput(model.GetOutputPort("health_latest"), f"{BODY_MOTIONS}_health_latest")
    diagram = builder.Build()
    diagram.set_name(modality)
    return diagram


def _add_vision(
    builder: DiagramBuilder,
    config: PerceptionConfig,
    calibration: Calibration,
    with_held_body: bool,
) -> System:
    """Feature motion and, on top of it, rigid-body motion; returns the latter."""
    camera = calibration.camera
    intrinsics, X_WC = camera.intrinsics, camera.X_PC.GetAsMatrix4()
    features = _add(builder, "feature_motion", FeatureMotion(config.features, intrinsics, X_WC))
    bodies = _add(
        builder,
        "rigid_body_motion",
        RigidBodyMotion(config.bodies, intrinsics, X_WC, with_held_body),
    )
    monitor = ImageMonitor(config.images, intrinsics.width, intrinsics.height)
    _add(builder, "image_monitor", monitor)
    for name in SEEN_STREAMS:
        builder.ExportInput(monitor.GetInputPort(f"{name}_measured"), f"{name}_measured")
        _wire(builder, monitor, f"{name}_checked", features, f"{name}_measured")
        _export_outputs(builder, monitor, f"{name}_health_latest")
    mask = builder.ExportInput(features.GetInputPort("robot_mask"), "robot_mask")
    builder.ConnectInput(mask, monitor.GetInputPort("robot_mask"))
    _wire(builder, features, "features_estimated", bodies, "features_estimated")
    _wire(builder, bodies, "features_predicted", features, "features_predicted")
    _export_outputs(builder, features, "features_latest")
    return bodies


def _add_proprioception(
    builder: DiagramBuilder,
    config: PerceptionConfig,
    calibration: Calibration,
    corrected_by_vision: bool,
) -> tuple[System, System]:
    """End-effector, bending, grasp and interacted body; returns the last and the grasp."""
    end_effector = _add(
        builder,
        "end_effector_motion",
        EndEffectorMotion(config.end_effector, calibration.arm.model),
    )
    bending = _add(builder, "hand_bending", HandBending(config.hand_bending))
    slip = _add(builder, "slip_detection", SlipDetection(config.slip))
    grasp = _add(builder, "grasp_model", GraspModel(config.grasp))
    body = _add(
        builder,
        "held_body_motion",
        HeldBodyMotion(config.held_body, corrected_by_vision=corrected_by_vision),
    )
    _add_felt_monitors(builder, config, calibration, (end_effector, bending, bending))
    active = builder.ExportInput(bending.GetInputPort("interaction_active"), "interaction_active")
    for system in (slip, grasp, body):
        builder.ConnectInput(active, system.GetInputPort("interaction_active"))
    for system in (bending, slip, grasp, body):
        _wire(builder, end_effector, "end_effector_estimated", system, "end_effector_estimated")
    for system in (grasp, body):
        _wire(builder, bending, "hand_bending_estimated", system, "hand_bending_estimated")
        _wire(builder, slip, "slip_estimated", system, "slip_estimated")
    _wire(builder, bending, "hand_load_estimated", slip, "hand_load_estimated")
    _wire(builder, grasp, "grasp_latest", body, "grasp_latest")
    _export_outputs(builder, end_effector, "end_effector_latest")
    _export_outputs(builder, bending, "hand_bending_latest")
    _export_outputs(builder, grasp, "grasp_latest")
    return body, grasp


def _add_joint_mechanics(builder: DiagramBuilder, config: PerceptionConfig, model: System) -> None:
    """Friction and range of the joint, where there is a wrist that feels; read by nobody."""
    mechanics = _add(builder, "joint_mechanics", JointMechanicsFilter(config.joint_mechanics))
    for name, port in (
        ("end_effector_motion", "end_effector_estimated"),
        ("hand_bending", "hand_load_estimated"),
        ("grasp_model", "grasp_latest"),
    ):
        _wire(builder, builder.GetSubsystemByName(name), port, mechanics, port)
    for port in ("joints_estimated", "body_motions_latest"):
        _wire(builder, model, port, mechanics, port)
    builder.ConnectInput("interaction_active", mechanics.GetInputPort("interaction_active"))
    _export_outputs(builder, mechanics, "joint_mechanics_latest")


def _add_felt_monitors(
    builder: DiagramBuilder,
    config: PerceptionConfig,
    calibration: Calibration,
    readers: Sequence[System],
) -> None:
    """A monitor between each of `FELT_STREAMS` and the filter that reads it."""
    arm, steps = calibration.arm.model, config.steps
    response = ArmResponse(config.arm_response, arm)
    wrench = np.repeat([steps.torque_noise, steps.force_noise], 3)
    pressure = np.full(4, steps.pressure_noise)
    models: list[tuple[int, OffsetModel]] = [
        (2 * arm.num_positions(), AnglesByRates(config.angles)),
        (6, IsolatedSteps(steps, wrench, response.is_felt)),
        (4, IsolatedSteps(steps, pressure)),
    ]
    monitors = {}
    for stream, reader, (size, model) in zip(FELT_STREAMS, readers, models, strict=True):
        monitor = _add(builder, f"{stream}_monitor", WindowMonitor(config.windows, size, model))
        monitors[stream] = monitor
        builder.ExportInput(monitor.GetInputPort("window"), f"{stream}_window")
        _wire(builder, monitor, "window_checked", reader, f"{stream}_window")
        builder.ExportOutput(monitor.GetOutputPort("health_latest"), f"{stream}_health_latest")
    joints = monitors["joint_state"]
    _wire(builder, joints, "window_checked", monitors["wrench"], "joint_state_window")


def _add(builder: DiagramBuilder, name: str, system: System) -> System:
    return builder.AddNamedSystem(name, system)


def _wire(builder: DiagramBuilder, source: System, output: str, target: System, port: str) -> None:
    builder.Connect(source.GetOutputPort(output), target.GetInputPort(port))


def _connect(builder: DiagramBuilder, wire: CrossModalWire) -> None:
    for source, output, target, port in wire.connections:
        _wire(
            builder,
            builder.GetSubsystemByName(source),
            output,
            builder.GetSubsystemByName(target),
            port,
        )


def _export_outputs(builder: DiagramBuilder, system: System, *ports: str) -> None:
    for port in ports:
        builder.ExportOutput(system.GetOutputPort(port), port)
