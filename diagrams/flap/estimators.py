"""The estimators of the held tool's kinematics: one factory, two ways of finding the hinge."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType

from pydrake.systems.framework import Diagram, DiagramBuilder, System

from crossmodal.diagrams.flap.robot_config import FINGER, FINGER_ARM, HOLDER, HOLDER_ARM
from crossmodal.diagrams.flap.robot_view import make_robot_view
from crossmodal.diagrams.run.believed import arm_pose, calibrated_arm, depth_camera
from crossmodal.diagrams.run.calibration import Calibration
from crossmodal.diagrams.stations.add_monitors import add_image_monitor, add_window_monitor
from crossmodal.diagrams.stations.connections import connect_alike, export_outputs
from crossmodal.diagrams.stations.filters import Filters, MakeFilter
from crossmodal.systems.depth_camera import DepthCamera
from crossmodal.systems.flap.flap_angle import FlapAngleConfig, FlapAngleFilter
from crossmodal.systems.flap.flap_geometry import HingeLimitsConfig
from crossmodal.systems.flap.hinge.hinge_estimator import HingeEstimator, HingeEstimatorConfig
from crossmodal.systems.flap.hinge.plane_intersection import (
    PlaneIntersection,
    PlaneIntersectionConfig,
)
from crossmodal.systems.flap.joint.flap_joint import FlapJoint
from crossmodal.systems.flap.joint.flap_joint_model import FlapJointConfig
from crossmodal.systems.flap.tool_kinematics import ToolKinematics, ToolKinematicsConfig
from crossmodal.systems.flap.tracking.flap_tracking import FlapTracker
from crossmodal.systems.flap.tracking.flap_tracking_config import FlapTrackingConfig
from crossmodal.systems.monitoring.angles import AnglesByRates, AnglesConfig
from crossmodal.systems.monitoring.image_monitor import ImageMonitorConfig
from crossmodal.systems.monitoring.window_monitor import WindowMonitorConfig
from crossmodal.systems.proprioception.end_effector_pose import (
    EndEffectorPose,
    EndEffectorPoseConfig,
)
from crossmodal.systems.registration.arm_registration import ArmRegistration, ArmRegistrationConfig
from crossmodal.systems.shared_settings import with_shared
from crossmodal.systems.tactile.fingertip_motion import FingertipMotion, FingertipMotionConfig
from crossmodal.systems.tactile.taxel_layout import TaxelLayout

SEEN_STREAMS = ("depth",)  # The flap is seen by its depth.
JOINT_STREAMS = ("holder_joint_state", "finger_joint_state")
TAXELS = "taxel"


def _angles_of_drives() -> AnglesConfig:
    """The drives take their commands in steps, as often as every second sample of the encoders.

    The rates are then sampled always at the same instants of a step, and their integral is off by a
    share of the way; 1.3 % were measured.
    """
    return AnglesConfig(scale=0.03)


@dataclass(kw_only=True)
class PerceptionConfig:
    """One config per system."""

    windows: WindowMonitorConfig = field(default_factory=WindowMonitorConfig)
    angles: AnglesConfig = field(default_factory=_angles_of_drives)
    images: ImageMonitorConfig = field(default_factory=ImageMonitorConfig)
    end_effector: EndEffectorPoseConfig = field(default_factory=EndEffectorPoseConfig)
    fingertip: FingertipMotionConfig = field(default_factory=FingertipMotionConfig)
    registration: ArmRegistrationConfig = field(default_factory=ArmRegistrationConfig)
    tracker: FlapTrackingConfig = field(default_factory=FlapTrackingConfig)
    limits: HingeLimitsConfig = field(default_factory=HingeLimitsConfig)
    hinge: HingeEstimatorConfig = field(default_factory=HingeEstimatorConfig)
    planes: PlaneIntersectionConfig = field(default_factory=PlaneIntersectionConfig)
    angle: FlapAngleConfig = field(default_factory=FlapAngleConfig)
    joint: FlapJointConfig = field(default_factory=FlapJointConfig)
    tool: ToolKinematicsConfig = field(default_factory=ToolKinematicsConfig)


def make_estimator(
    name: str,
    config: PerceptionConfig,
    calibration: Calibration,
    layout: TaxelLayout,
    period: float,
    *,
    replacements: Mapping[str, MakeFilter] = MappingProxyType({}),
) -> Diagram:
    """The systems of one estimator, wired.

    Inputs are `depth_measured`, `robot_mask`, `holder_joint_state_window`,
    `finger_joint_state_window` and `taxel_window`; outputs are `tool_latest`, `hinge_latest`,
    `flap_angle_latest`, `flap_plane_latest`, `fingertip_contact_latest` and the streams' health.

    Args:
        name: One of `ESTIMATORS`: `geometric` fits the flap's planes and the contact's circle,
            `filtered` asks the joint filters of the cross-modal network, `planes` intersects the
            flap's planes as the paper does.
        calibration: What the robots believe of their sensors.
        period: Of the ticks, [s].
        replacements: By a filter's name, the class or function that makes another one in its
            place, called with the same arguments.

    Raises:
        ValueError: for an impossible config value, and for a replacement that does not fit.
    """
    config = with_shared(config, period=period, noise=calibration.noise, windows=config.windows)
    builder = DiagramBuilder()
    filters = Filters(replacements)
    camera = depth_camera(calibration)
    tracker = filters.add(builder, "flap_tracker", FlapTracker, config.tracker, camera)
    registration = _add_registration(builder, filters, config, calibration, camera)
    fingertip, holder = _add_arms(builder, filters, config, calibration, layout, registration)
    add_image_monitor(
        builder, config.images, calibration, {"depth": [tracker, registration]}, masked=tracker
    )
    tool = filters.add(builder, "tool_kinematics", ToolKinematics, config.tool)
    if name != "filtered":
        if name == "geometric":
            hinge = filters.add(
                builder, "hinge", HingeEstimator, config.hinge, camera, config.limits
            )
        else:
            hinge = filters.add(builder, "hinge", PlaneIntersection, config.planes, config.limits)
        angle = filters.add(builder, "flap_angle", FlapAngleFilter, config.angle, camera)
        connect_alike(builder, hinge, "hinge_estimated", angle, tool)
    else:
        hinge = angle = filters.add(
            builder, "flap_joint", FlapJoint, config.joint, camera, config.limits
        )
        connect_alike(builder, hinge, "hinge_estimated", tool)
    connect_alike(builder, angle, "flap_angle_estimated", tool)
    planes = (hinge,) if hinge is angle else (hinge, angle)
    if name != "planes":
        connect_alike(builder, registration, "displacements_estimated", hinge)
    connect_alike(builder, tracker, "flap_plane_estimated", *planes)
    connect_alike(builder, fingertip, "fingertip_contact_estimated", tracker, *planes, tool)
    connect_alike(builder, holder, "end_effector_estimated", tracker, tool)
    for system, port in (
        (tool, "tool_latest"),
        (hinge, "hinge_latest"),
        (angle, "flap_angle_latest"),
        (tracker, "flap_plane_latest"),
        (fingertip, "fingertip_contact_latest"),
    ):
        export_outputs(builder, system, port)
    filters.check(name)
    diagram = builder.Build()
    diagram.set_name(name)
    return diagram


def _add_registration(
    builder: DiagramBuilder,
    filters: Filters,
    config: PerceptionConfig,
    calibration: Calibration,
    camera: DepthCamera,
) -> System:
    """What compares camera and arms."""
    arms = {
        owner: calibrated_arm(calibration, name)
        for owner, name in ((HOLDER, HOLDER_ARM), (FINGER, FINGER_ARM))
    }
    view = make_robot_view(calibration)
    return filters.add(
        builder, "arm_registration", ArmRegistration, config.registration, view, camera, arms
    )


def _add_arms(
    builder: DiagramBuilder,
    filters: Filters,
    config: PerceptionConfig,
    calibration: Calibration,
    layout: TaxelLayout,
    registration: System,
) -> tuple[System, System]:
    """The fingertip with its contact, and the end-effector that holds the tool."""
    finger_arm, holder_arm = (arm_pose(calibration, name) for name in (FINGER_ARM, HOLDER_ARM))
    fingertip = filters.add(
        builder, "fingertip_motion", FingertipMotion, config.fingertip, finger_arm, layout
    )
    holder = filters.add(
        builder, "end_effector_pose", EndEffectorPose, config.end_effector, holder_arm
    )
    readers = (
        (holder.GetInputPort("joint_state_window"), holder_arm),
        (fingertip.GetInputPort("finger_joint_state_window"), finger_arm),
    )
    for stream, (reader, arm) in zip(JOINT_STREAMS, readers, strict=True):
        add_window_monitor(
            builder,
            stream,
            2 * arm.num_joints,
            config.windows,
            AnglesByRates(config.angles),
            [reader, registration.GetInputPort(f"{stream}_window")],
        )
    builder.ExportInput(fingertip.GetInputPort("taxel_window"), f"{TAXELS}_window")
    builder.ExportOutput(fingertip.GetOutputPort("health_latest"), f"{TAXELS}_health_latest")
    return fingertip, holder
