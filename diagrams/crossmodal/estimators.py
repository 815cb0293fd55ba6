"""The network of coupled filters: one factory, three wirings of the same systems."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType

import numpy as np
from pydrake.systems.framework import Diagram, DiagramBuilder, System

from crossmodal.diagrams.run.believed import depth_camera
from crossmodal.diagrams.run.calibration import Calibration
from crossmodal.diagrams.stations.add_monitors import (
    add_image_monitor,
    add_window_monitor,
)
from crossmodal.diagrams.stations.connections import (
    Connection,
    connect,
    connect_alike,
    export_input,
    export_outputs,
)
from crossmodal.diagrams.stations.filters import Filters, MakeFilter
from crossmodal.systems.kinematics.calibration_errors import SensorCalibration
from crossmodal.systems.kinematics.joint_filters_config import JointFiltersConfig, TypePriorsConfig
from crossmodal.systems.kinematics.kinematic_model import KinematicModel, KinematicModelConfig
from crossmodal.systems.kinematics.measurement_errors import MeasurementErrorsConfig
from crossmodal.systems.kinematics.mechanics.joint_mechanics import JointMechanicsFilter
from crossmodal.systems.kinematics.mechanics.joint_mechanics_config import JointMechanicsConfig
from crossmodal.systems.monitoring.angles import AnglesByRates, AnglesConfig
from crossmodal.systems.monitoring.arm_response import ArmResponse, ArmResponseConfig
from crossmodal.systems.monitoring.image_monitor import ImageMonitorConfig
from crossmodal.systems.monitoring.offsets import OffsetModel
from crossmodal.systems.monitoring.steps import IsolatedSteps, StepsConfig
from crossmodal.systems.monitoring.window_monitor import WindowMonitorConfig
from crossmodal.systems.proprioception.end_effector_motion import (
    EndEffectorMotion,
    EndEffectorMotionConfig,
)
from crossmodal.systems.proprioception.grasp_model import GraspModel
from crossmodal.systems.proprioception.grasp_model_config import GraspModelConfig
from crossmodal.systems.proprioception.hand_bending import HandBending, HandBendingConfig
from crossmodal.systems.proprioception.hand_config import HandConfig
from crossmodal.systems.proprioception.held_body_motion import (
    HeldBodyMotion,
    HeldBodyMotionConfig,
)
from crossmodal.systems.proprioception.slip_detection import SlipDetection, SlipDetectionConfig
from crossmodal.systems.shared_settings import with_shared
from crossmodal.systems.vision.bodies.rigid_body_motion import RigidBodyMotion
from crossmodal.systems.vision.bodies.rigid_body_motion_config import RigidBodyMotionConfig
from crossmodal.systems.vision.camera.camera_motion import CameraMotion, CameraMotionConfig
from crossmodal.systems.vision.features.feature_motion import FeatureMotion
from crossmodal.systems.vision.features.feature_motion_config import FeatureMotionConfig

VISION_INPUTS = ("color_measured", "depth_measured", "robot_mask")
SEEN_STREAMS = ("color", "depth")
BODY_STREAMS = ("joint_state", "wrench", "pressure")
BODY_MOTIONS = "body_motions"  # What the joints are made of.
PROPRIOCEPTION_INPUTS = (
    "joint_state_window",
    "wrench_window",
    "pressure_window",
    "interaction_active",
)


@dataclass(frozen=True, kw_only=True)
class CrossModalConnection:
    """A flow of information that a scenario may cut, by its connections.

    Attributes:
        carries: What, and what for.
        connections: (system, output port, system, input port); every input works unconnected.
    """

    carries: str
    connections: tuple[tuple[str, str, str, str], ...]


_BODIES, _FEATURES = "body_motions_estimated", "features_estimated"
CROSSMODAL_CONNECTIONS = {
    "held_body_to_vision": CrossModalConnection(
        carries="where the hand takes its body, so that vision finds its features",
        connections=(("held_body_motion", "body_prior", "rigid_body_motion", "held_body_prior"),),
    ),
    "features_to_held_body": CrossModalConnection(
        carries="the features of the body in the hand, which correct its pose",
        connections=(
            ("camera_motion", _FEATURES, "held_body_motion", _FEATURES),
            ("rigid_body_motion", _BODIES, "held_body_motion", _BODIES),
        ),
    ),
    "held_body_to_grasp": CrossModalConnection(
        carries="how the body in the hand was seen to move, from which the grasp is learnt",
        connections=(("held_body_motion", _BODIES, "grasp_model", _BODIES),),
    ),
    "visual_bodies_to_joints": CrossModalConnection(
        carries="bodies that only vision sees, to which the body in the hand may be jointed",
        connections=(("rigid_body_motion", _BODIES, "kinematic_model", "body_motions"),),
    ),
    "joints_to_vision": CrossModalConnection(
        carries="where the joints expect the bodies, as one more prediction for vision",
        connections=(
            ("kinematic_model", "bodies_predicted", "rigid_body_motion", "joint_predictions"),
        ),
    ),
}


def check_cut(cut: Sequence[str]) -> None:
    """Raises ValueError, naming the known ones, where one is unknown."""
    for name in cut:
        if name not in CROSSMODAL_CONNECTIONS:
            raise ValueError(
                f"perception.cut: unknown connection '{name}';"
                f" there are {', '.join(CROSSMODAL_CONNECTIONS)}"
            )


_FURNITURE = TypePriorsConfig(screw=0.02, rigid=0.4)  # Few of its joints are screws.
_HINGE_PITCH = 3e-3  # What errors that last make a hinge climb, [m/rad].


def joints_of_furniture() -> KinematicModelConfig:
    """What an arm opens has its hinge within reach.

    What the bodies declare to be correlated of their errors, those of their landmarks and of the
    hand, lasts for some seconds.
    """
    return KinematicModelConfig(
        filters=JointFiltersConfig(
            type_priors=_FURNITURE,
            ranking_priors=_FURNITURE,
            hinge_pitch=_HINGE_PITCH,
            errors=MeasurementErrorsConfig(declared_time=3.0),
        ),
    )


@dataclass(kw_only=True)
class PerceptionConfig:
    """One config per filter, and what they share.

    Attributes:
        joints: Of all networks.
        cut: Wires of `CROSSMODAL_CONNECTIONS` that the cross-modal network does without.
        hand: That holds the body.
    """

    cut: list[str] = field(default_factory=list)
    windows: WindowMonitorConfig = field(default_factory=WindowMonitorConfig)
    angles: AnglesConfig = field(default_factory=AnglesConfig)
    steps: StepsConfig = field(default_factory=StepsConfig)
    arm_response: ArmResponseConfig = field(default_factory=ArmResponseConfig)
    images: ImageMonitorConfig = field(default_factory=ImageMonitorConfig)
    end_effector: EndEffectorMotionConfig = field(default_factory=EndEffectorMotionConfig)
    hand_bending: HandBendingConfig = field(default_factory=HandBendingConfig)
    hand: HandConfig = field(default_factory=HandConfig)
    slip: SlipDetectionConfig = field(default_factory=SlipDetectionConfig)
    grasp: GraspModelConfig = field(default_factory=GraspModelConfig)
    held_body: HeldBodyMotionConfig = field(default_factory=HeldBodyMotionConfig)
    features: FeatureMotionConfig = field(default_factory=FeatureMotionConfig)
    camera: CameraMotionConfig = field(default_factory=CameraMotionConfig)
    bodies: RigidBodyMotionConfig = field(default_factory=RigidBodyMotionConfig)
    joints: KinematicModelConfig = field(default_factory=joints_of_furniture)
    joint_mechanics: JointMechanicsConfig = field(default_factory=JointMechanicsConfig)


def make_network(
    modality: str,
    config: PerceptionConfig,
    calibration: Calibration,
    period: float,
    *,
    replacements: Mapping[str, MakeFilter] = MappingProxyType({}),
) -> Diagram:
    """The filters of one modality, wired.

    Inputs are those of `VISION_INPUTS` and `PROPRIOCEPTION_INPUTS` that the modality uses; outputs
    are `joints_latest`, `body_motions_latest` with its health and, where they exist,
    `features_latest`, `camera_displacement_latest` with its health, `grasp_latest`,
    `hand_bending_latest`, `end_effector_latest` and `joint_mechanics_latest`.

    Args:
        modality: One of `MODALITIES`.
        calibration: What the robot believes of its sensors.
        period: Of the ticks, [s].
        replacements: By a filter's name in the network, the class or function that makes another
            one in its place, called with the same arguments, such as
            `{"hand_bending": MyBending}`.

    Raises:
        ValueError: for an impossible config value, and for a replacement that does not fit.
    """
    check_cut(config.cut)
    config = with_shared(
        config, period=period, noise=calibration.noise, hand=config.hand, windows=config.windows
    )
    builder = DiagramBuilder()
    filters = Filters(replacements)
    kinematics = config.joints
    if modality == "vision":
        camera = _camera(calibration)
        model = filters.add(builder, "kinematic_model", KinematicModel, kinematics, camera=camera)
        bodies = _add_vision(builder, filters, config, calibration, with_held_body=False)
        connect(builder, [(bodies, _BODIES, model, "body_motions")])
        connect(builder, [(model, "bodies_predicted", bodies, "joint_predictions")])
    elif modality == "proprioception":
        arm = _arm_base(calibration)
        model = filters.add(builder, "kinematic_model", KinematicModel, kinematics, arm=arm)
        body, grasp = _add_proprioception(
            builder, filters, config, calibration, corrected_by_vision=False
        )
        connect_alike(builder, body, _BODIES, grasp)
        connect(builder, [(body, _BODIES, model, "body_motions")])
    else:
        model = filters.add(
            builder,
            "kinematic_model",
            KinematicModel,
            kinematics,
            inputs=2,
            camera=_camera(calibration),
            arm=_arm_base(calibration),
        )
        _add_vision(builder, filters, config, calibration, with_held_body=True)
        body, _ = _add_proprioception(
            builder, filters, config, calibration, corrected_by_vision=True
        )
        for name, wire in CROSSMODAL_CONNECTIONS.items():
            if name not in config.cut:
                connect(builder, _between(builder, wire))
        # What touch and vision know together of the held body counts, not what vision knows.
        connect(builder, [(body, _BODIES, model, "body_motions_1")])
    if modality != "vision":
        _add_joint_mechanics(builder, filters, config, model)
    filters.check(modality)
    export_outputs(builder, model, "joints_latest", "body_motions_latest")
    builder.ExportOutput(model.GetOutputPort("health_latest"), f"{BODY_MOTIONS}_health_latest")
    diagram = builder.Build()
    diagram.set_name(modality)
    return diagram


def _camera(calibration: Calibration) -> SensorCalibration:
    camera = depth_camera(calibration)
    return SensorCalibration(
        X_WF=camera.X_WC,
        covariance=camera.pose_covariance,
        scale=camera.depth_scale_std,
        focal_length=camera.focal_length_std,
        latency=camera.latency_std,
    )


def _arm_base(calibration: Calibration) -> SensorCalibration:
    arm = calibration.arm
    return SensorCalibration(X_WF=arm.X_WBase.GetAsMatrix4(), covariance=arm.covariance)


def _add_vision(
    builder: DiagramBuilder,
    filters: Filters,
    config: PerceptionConfig,
    calibration: Calibration,
    with_held_body: bool,
) -> System:
    """Features, the camera's own motion and that of rigid bodies; returns the last."""
    camera = calibration.camera
    intrinsics, X_WC = camera.intrinsics, camera.X_PC.GetAsMatrix4()
    features = filters.add(builder, "feature_motion", FeatureMotion, config.features, intrinsics)
    bodies = filters.add(
        builder,
        "rigid_body_motion",
        RigidBodyMotion,
        config.bodies,
        intrinsics,
        X_WC,
        with_held_body,
    )
    readers = {stream: [features] for stream in SEEN_STREAMS}
    monitor = add_image_monitor(builder, config.images, calibration, readers, masked=features)
    place = filters.add(
        builder, "camera_motion", CameraMotion, config.camera, config.bodies.dynamics, X_WC
    )
    connect_alike(builder, features, _FEATURES, place)
    connect_alike(builder, place, _FEATURES, bodies)
    for reader in (features, place):
        connect_alike(builder, bodies, "features_predicted", reader)
    for source, reader in (("latest", monitor), ("latest", features), ("estimated", bodies)):
        displacement = f"camera_displacement_{source}"
        connect(builder, [(place, displacement, reader, "camera_displacement")])
    export_outputs(builder, features, "features_latest")
    export_outputs(builder, place, "camera_displacement_latest")
    builder.ExportOutput(place.GetOutputPort("health_latest"), "camera_health_latest")
    return bodies


def _add_proprioception(
    builder: DiagramBuilder,
    filters: Filters,
    config: PerceptionConfig,
    calibration: Calibration,
    corrected_by_vision: bool,
) -> tuple[System, System]:
    """End-effector, bending, grasp and interacted body; returns the last and the grasp."""
    end_effector = filters.add(
        builder,
        "end_effector_motion",
        EndEffectorMotion,
        config.end_effector,
        calibration.arm.model,
    )
    bending = filters.add(builder, "hand_bending", HandBending, config.hand_bending)
    slip = filters.add(builder, "slip_detection", SlipDetection, config.slip)
    grasp = filters.add(builder, "grasp_model", GraspModel, config.grasp)
    body = filters.add(
        builder,
        "held_body_motion",
        HeldBodyMotion,
        config.held_body,
        corrected_by_vision=corrected_by_vision,
    )
    _add_body_monitors(builder, config, calibration, (end_effector, bending, bending))
    export_input(builder, "interaction_active", bending, slip, grasp, body)
    connect_alike(builder, end_effector, "end_effector_estimated", bending, slip, grasp, body)
    connect_alike(builder, bending, "hand_bending_estimated", grasp, body)
    connect_alike(builder, slip, "slip_estimated", grasp, body)
    connect_alike(builder, bending, "hand_load_estimated", slip)
    connect_alike(builder, grasp, "grasp_latest", body)
    export_outputs(builder, end_effector, "end_effector_latest")
    export_outputs(builder, bending, "hand_bending_latest")
    export_outputs(builder, grasp, "grasp_latest")
    return body, grasp


def _add_joint_mechanics(
    builder: DiagramBuilder, filters: Filters, config: PerceptionConfig, model: System
) -> None:
    """Friction and range of the joint, where a wrist measures forces; no filter reads them."""
    mechanics = filters.add(
        builder, "joint_mechanics", JointMechanicsFilter, config.joint_mechanics
    )
    for name, port in (
        ("end_effector_motion", "end_effector_estimated"),
        ("hand_bending", "hand_load_estimated"),
        ("grasp_model", "grasp_latest"),
    ):
        connect_alike(builder, builder.GetSubsystemByName(name), port, mechanics)
    for port in ("joints_estimated", "body_motions_latest"):
        connect_alike(builder, model, port, mechanics)
    builder.ConnectInput("interaction_active", mechanics.GetInputPort("interaction_active"))
    export_outputs(builder, mechanics, "joint_mechanics_latest")


def _add_body_monitors(
    builder: DiagramBuilder,
    config: PerceptionConfig,
    calibration: Calibration,
    readers: Sequence[System],
) -> None:
    """A monitor between each of `BODY_STREAMS` and the filter that reads it."""
    arm, steps = calibration.arm.model, config.steps
    response = ArmResponse(config.arm_response, arm)
    wrench, pressure = calibration.noise.wrench, np.full(4, calibration.noise.pressure)
    models: tuple[tuple[int, OffsetModel], ...] = (
        (2 * arm.num_positions(), AnglesByRates(config.angles)),
        (6, IsolatedSteps(steps, wrench, response.is_sensed)),
        (4, IsolatedSteps(steps, pressure)),
    )
    joints, wrist, _ = (
        add_window_monitor(
            builder, stream, size, config.windows, model, [reader.GetInputPort(f"{stream}_window")]
        )
        for stream, reader, (size, model) in zip(BODY_STREAMS, readers, models, strict=True)
    )
    connect(builder, [(joints, "window_checked", wrist, "joint_state_window")])


def _between(builder: DiagramBuilder, wire: CrossModalConnection) -> Iterator[Connection]:
    """The connections of a flow between the systems of those names."""
    for source, output, target, port in wire.connections:
        yield builder.GetSubsystemByName(source), output, builder.GetSubsystemByName(target), port
