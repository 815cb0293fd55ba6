"""Two arms with soft hands, a fixed camera and one on a wrist, and two objects on a table."""

from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.framework import Context, Diagram, DiagramBuilder, System
from pydrake.systems.primitives import ConstantValueSource, ConstantVectorSource

from crossmodal.controllers.arm.impedance import DesiredMotion, ImpedanceConfig, ImpedanceGains
from crossmodal.controllers.arm.kinematics import ArmModel
from crossmodal.diagrams.evaluation.estimates import Row, error_metrics, evaluate_rows, vector
from crossmodal.diagrams.run.application import SCENE_PORT, Application, Quantity, Station
from crossmodal.diagrams.run.calibration import (
    ArmCalibration,
    Calibration,
    Camera,
    calibrated,
    draw_base,
    pose_covariance,
)
from crossmodal.diagrams.run.record import Tick
from crossmodal.diagrams.run.scenario import Scenario
from crossmodal.diagrams.run.yaml_input.schema import ScenarioError
from crossmodal.diagrams.stations.add_arm import (
    add_encoders,
    add_impedance_control,
    add_wrist_wrench,
)
from crossmodal.diagrams.stations.add_cameras import CameraCarrier, add_cameras, add_robot_masks
from crossmodal.diagrams.stations.add_soft_hand import add_soft_hand
from crossmodal.diagrams.stations.naming import prefixed
from crossmodal.diagrams.stations.true_pose import add_true_pose
from crossmodal.diagrams.stations.wiring import StationWiring
from crossmodal.maths.validation import number, numbers
from crossmodal.models import SDF_DIR
from crossmodal.plants.hands.pneumatic_hand import PneumaticHandConfig
from crossmodal.plants.robots.arm_with_hand import add_robot, make_arm_with_load
from crossmodal.plants.robots.wam import ARM_JOINTS, WAM_WITH_SOFT_HAND
from crossmodal.plants.scene import (
    ObjectPlacement,
    PlantConfig,
    add_manipulation_scene,
    nominal_pose,
)
from crossmodal.systems.arm_pose import ArmPose
from crossmodal.systems.monitoring.image_monitor import ImageMonitor, ImageMonitorConfig
from crossmodal.systems.port_values import UNKNOWN_END_EFFECTOR, no_features
from crossmodal.systems.proprioception.end_effector_motion import (
    EndEffectorMotion,
    EndEffectorMotionConfig,
)
from crossmodal.systems.sensors.air_pressure import PressureSensorConfig
from crossmodal.systems.sensors.joint_encoders import JointEncoders, JointEncodersConfig
from crossmodal.systems.sensors.rgbd_camera import CameraNoiseConfig
from crossmodal.systems.sensors.robot_mask import MaskedRobot, RobotMaskConfig
from crossmodal.systems.sensors.wrist_wrench import WristWrenchConfig
from crossmodal.systems.vision.features.feature_motion import FeatureMotion
from crossmodal.systems.vision.features.feature_motion_config import FeatureMotionConfig

SIDES = ("left", "right")
GAINS = ImpedanceGains(
    stiffness=np.diag([30.0] * 3 + [2000.0] * 3),
    damping=np.diag([1.0] * 3 + [80.0] * 3),
    mass=np.eye(6),
)


@dataclass(kw_only=True)
class ObjectConfig:
    model: str = "chest_drawer.sdf"  # In models/sdf.
    position: np.ndarray = numbers(np.zeros(3), at_least=-100.0, at_most=100.0, unit="m")
    yaw: float = number(0.0, at_least=-720.0, at_most=720.0, unit="deg")
    free: bool = False  # Whether it only rests where it is.
    friction: float = number(1.0, at_least=0.0, at_most=1000.0, unit="N or N m")  # Of its joints.


@dataclass(kw_only=True)
class ModelDriver:
    pneumatics: PneumaticHandConfig = field(default_factory=PneumaticHandConfig)


@dataclass(kw_only=True)
class SensorsConfig:
    camera: CameraNoiseConfig = field(default_factory=CameraNoiseConfig)
    encoders: JointEncodersConfig = field(default_factory=JointEncodersConfig)
    wrench: WristWrenchConfig = field(default_factory=WristWrenchConfig)
    pressure: PressureSensorConfig = field(default_factory=PressureSensorConfig)
    robot_mask: RobotMaskConfig = field(default_factory=RobotMaskConfig)


@dataclass(kw_only=True)
class ArmControl:
    impedance: ImpedanceConfig = field(default_factory=ImpedanceConfig)
    # At the start (7,).
    posture: np.ndarray = numbers(
        np.array([-0.6, 0.9, 0.45, 1.5, -3.65, 0.7, 0.1]), at_least=-10.0, at_most=10.0, unit="rad"
    )
    # How far the desired position lies from that at the start (3,), in W.
    step: np.ndarray = numbers(np.zeros(3), at_least=-10.0, at_most=10.0, unit="m")


@dataclass(kw_only=True)
class TwoArms(Scenario):
    directives: str = ""  # File of Drake's model directives, beside the scenario's or absolute.
    objects: dict[str, ObjectConfig] = field(default_factory=dict)
    model_drivers: dict[str, ModelDriver] = field(
        default_factory=lambda: {f"{side}_hand": ModelDriver() for side in SIDES}
    )
    sensors: SensorsConfig = field(default_factory=SensorsConfig)
    control: dict[str, ArmControl] = field(default_factory=dict)
    features: FeatureMotionConfig = field(default_factory=FeatureMotionConfig)


def resolve(scenario: TwoArms, path: Path) -> TwoArms:
    directives = path.parent / scenario.directives
    if not directives.is_file():
        raise ScenarioError(f"{path}: directives = '{scenario.directives}': there is no such file")
    control = {side: scenario.control.get(side, ArmControl()) for side in SIDES}
    return replace(scenario, directives=str(directives.resolve()), control=control)


def make_calibration(scenario: TwoArms) -> Calibration:
    believed, arms = scenario.calibration.believed, {}
    for side in SIDES:
        X_WBase = nominal_pose(scenario.directives, "base", f"{side}_arm")
        arms[side] = ArmCalibration(
            model=make_arm_with_load(WAM_WITH_SOFT_HAND, X_WBase),
            X_WBase=X_WBase,
            covariance=pose_covariance(believed.arm_rotation, believed.arm_translation),
            joint_offset_std=np.full(len(ARM_JOINTS), np.deg2rad(3.0)),
        )
    cameras = {
        name: calibrated(config.camera(), believed) for name, config in scenario.cameras.items()
    }
    return Calibration(cameras=cameras, arms=arms)


def make_station(scenario: TwoArms, calibration: Calibration) -> Station:
    seed, sensors = scenario.seed, scenario.sensors
    errors = scenario.calibration.drawn_errors(seed)
    bases = {
        side: draw_base(side, arm.X_WBase, errors, seed) for side, arm in calibration.arms.items()
    }
    builder = DiagramBuilder()
    scene = add_manipulation_scene(
        builder,
        PlantConfig(scene=scenario.directives),
        {name: placement(thing) for name, thing in scenario.objects.items()},
        [(f"{side}_arm", f"{side}_hand") for side in SIDES],
        {f"{side}_arm": X_WBase for side, X_WBase in bases.items()},
    )
    plant = scene.plant
    wiring = StationWiring(builder=builder, scene=scene, scenario=scenario, calibration=calibration)
    encoders = {side: add_side(wiring, scenario, X_WBase, side) for side, X_WBase in bases.items()}
    carrier = CameraCarrier(
        pose=carrying_pose(calibration, "right", "tool_plate"),
        joint_state=encoders["right"].GetOutputPort("joint_state_measured"),
    )
    add_cameras(wiring, sensors.camera, carriers={"wrist": carrier})
    robots = {
        side: MaskedRobot(arm=f"{side}_arm", arm_joints=ARM_JOINTS, hand=f"{side}_hand")
        for side in SIDES
    }
    postures = {
        f"{side}_joint_state_measured": encoders[side].GetOutputPort("joint_state_measured")
        for side in SIDES
    }
    add_robot_masks(
        wiring,
        partial(add_robots, calibration),
        robots,
        sensors.robot_mask,
        postures,
    )
    builder.ExportOutput(scene.scene_graph.get_query_output_port(), SCENE_PORT)

    def initialise(root: Context) -> None:
        context = plant.GetMyMutableContextFromRoot(root)
        for side, control in scenario.control.items():
            plant.SetPositions(context, scene.model(f"{side}_arm"), control.posture)

    return Station(diagram=builder.Build(), initialise=initialise)


def placement(thing: ObjectConfig) -> ObjectPlacement:
    X_WO = RigidTransform(RollPitchYaw(0.0, 0.0, np.deg2rad(thing.yaw)), thing.position)
    return ObjectPlacement(
        model=SDF_DIR / thing.model, X_WO=X_WO, free=thing.free, friction=thing.friction
    )


def add_robots(calibration: Calibration, plant: MultibodyPlant) -> None:
    """Both robots where they believe to stand."""
    for side, arm in calibration.arms.items():
        add_robot(plant, WAM_WITH_SOFT_HAND, arm.X_WBase, f"{side}_arm", f"{side}_hand")


def carrying_pose(calibration: Calibration, side: str, frame: str) -> ArmPose:
    """Where a frame of an arm is, as the robot believes."""
    arm = calibration.arms[side]
    return ArmPose(arm.model, arm.covariance, arm.joint_offset_std, frame)


def add_side(
    wiring: StationWiring,
    scenario: TwoArms,
    X_WBase: RigidTransform,
    side: str,
) -> JointEncoders:
    """An arm that holds its place, or moves a step, with its open hand."""
    builder, plant, sensors = wiring.builder, wiring.plant, scenario.sensors
    arm, hand = f"{side}_arm", f"{side}_hand"
    control = scenario.control[side]
    encoders = add_encoders(
        wiring,
        arm,
        make_arm_with_load(WAM_WITH_SOFT_HAND, X_WBase),
        control.posture,
        sensors.encoders,
        side,
    )
    model = wiring.scene.model(hand)
    add_wrist_wrench(wiring, plant.GetFrameByName("sensor", model), sensors.wrench, side)
    pneumatics, _ = add_soft_hand(
        wiring,
        hand,
        scenario.model_drivers[f"{side}_hand"].pneumatics,
        sensors.pressure,
        side,
    )
    add_true_pose(builder, plant, plant.GetFrameByName("end_effector", model), side)
    believed = ArmModel(wiring.calibration.arms[side].model)
    start = encoders.measure(np.append(control.posture, np.zeros(len(ARM_JOINTS))), 0)
    impedance = add_impedance_control(
        wiring, arm, encoders, believed, control.impedance, start[: len(ARM_JOINTS)], side
    )
    X_WE = RigidTransform(control.step).GetAsMatrix4() @ believed.Evaluate(start).X_WE
    motion = DesiredMotion(X_WE=X_WE, V_WE_E=np.zeros(6), A_WE_E=np.zeros(6))
    for name, value, target in (
        ("motion_desired", motion, impedance),
        ("gains_desired", GAINS, impedance),
        ("tare", np.array([not np.any(control.step)], dtype=float), impedance),
        ("pressure_commanded", np.zeros(4), pneumatics),
        ("sealed", np.zeros(1), pneumatics),
    ):
        constant = (
            ConstantVectorSource(value)
            if isinstance(value, np.ndarray)
            else ConstantValueSource(AbstractValue.Make(value))
        )
        source = builder.AddNamedSystem(f"{side}_{name}", constant)
        builder.Connect(source.get_output_port(), target.GetInputPort(name))
    return encoders


def make_estimators(scenario: TwoArms, calibration: Calibration) -> dict[str, Diagram]:
    """Where each hand is, and what the fixed camera sees."""
    estimators = {
        side: estimator_of(
            side, EndEffectorMotion(EndEffectorMotionConfig(), arm.model), ["joint_state_window"]
        )
        for side, arm in calibration.arms.items()
    }
    images = ["color_measured", "depth_measured", "robot_mask"]
    eye = make_eye(scenario, calibration.cameras["fixed"])
    return estimators | {"eye": estimator_of("fixed", eye, images)}


def estimator_of(owner: str, system: System, inputs: list[str]) -> Diagram:
    """An estimator of one of several arms or cameras: its inputs are that one's ports of a station.

    Args:
        owner: Which one.
        system: The estimator, with inputs that are named as of the only one.
        inputs: Those that the station has; the others stay unconnected.

    Returns:
        A Diagram with the inputs `<owner>_<input>` and all outputs by their own names.
    """
    builder = DiagramBuilder()
    builder.AddSystem(system)
    for name in inputs:
        builder.ExportInput(system.GetInputPort(name), prefixed(owner, name))
    for index in range(system.num_output_ports()):
        port = system.get_output_port(index)
        builder.ExportOutput(port, port.get_name())
    return builder.Build()


def make_eye(scenario: TwoArms, camera: Camera) -> Diagram:
    """The features in a camera's images that can be trusted."""
    builder = DiagramBuilder()
    intrinsics = camera.intrinsics
    features = builder.AddSystem(FeatureMotion(scenario.features, intrinsics))
    monitor = builder.AddSystem(
        ImageMonitor(ImageMonitorConfig(), intrinsics.width, intrinsics.height)
    )
    for image in ("color", "depth"):
        port = f"{image}_measured"
        builder.ExportInput(monitor.GetInputPort(port), port)
        builder.Connect(monitor.GetOutputPort(f"{image}_checked"), features.GetInputPort(port))
    builder.ExportInput(features.GetInputPort("robot_mask"), "robot_mask")
    builder.ExportOutput(features.GetOutputPort("features_latest"), "features_latest")
    return builder.Build()


def rows(estimator: str, tick: Tick, station: Tick) -> list[Row]:
    """Where a hand is; of the camera's features nothing true is known."""
    hand = tick.values.get("end_effector_latest")
    if hand is None:
        return []
    R_WE, true = hand.X[:3, :3], station.values[f"cheat_{estimator}_pose"].translation()
    return vector("position", hand.X[:3, 3], R_WE @ hand.covariance[3:6, 3:6] @ R_WE.T, true)


APPLICATION = Application(
    name="two-arms",
    description="two arms with soft hands before a table, and two cameras",
    scenario=TwoArms,
    scenarios=Path(__file__).parent,
    resolve=resolve,
    make_calibration=make_calibration,
    make_station=make_station,
    make_estimators=make_estimators,
    quantities=lambda scenario: [
        Quantity(port="end_effector_latest", model=UNKNOWN_END_EFFECTOR, estimators=SIDES),
        Quantity(port="features_latest", model=no_features(), estimators=["eye"]),
    ],
    station_quantities=lambda scenario: [
        Quantity(port=f"cheat_{side}_pose", model=RigidTransform()) for side in SIDES
    ],
    pictures=lambda scenario: ("fixed_color_measured", "wrist_color_measured"),
    evaluate=partial(evaluate_rows, rows=rows, units={"position": "m"}),
    metrics=error_metrics({f"position_{axis}": "m" for axis in "xyz"}),
)
