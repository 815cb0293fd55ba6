"""The station: plant, sensors and controllers of one episode, as one Diagram.

Its outputs are what a robot has (measured and commanded quantities); the truth leaves it only
through ports named `cheat_...`, for evaluation.
"""

from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt
from pydrake.geometry import (
    ClippingRange,
    ColorRenderCamera,
    DepthRange,
    DepthRenderCamera,
    LightParameter,
    MakeRenderEngineVtk,
    RenderCameraCore,
    RenderEngineVtkParams,
    Role,
    SceneGraph,
)
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import JacobianWrtVariable, Joint
from pydrake.systems.framework import Context, Diagram, DiagramBuilder
from pydrake.systems.primitives import MatrixGain
from pydrake.systems.sensors import CameraInfo, RgbdSensor

from controllers.bending_excitation import BendingExcitation, BendingExcitationConfig
from controllers.exploration import ExplorationConfig, ExplorationController
from controllers.grasp_sequence import Goal, GraspSequence, GraspSequenceConfig
from controllers.impedance import ImpedanceConfig, ImpedanceController
from controllers.joint_memory import JointMemory
from controllers.robot_kinematics import ArmModel
from controllers.trajectory_generator import TrajectoryGenerator, TrajectoryGeneratorConfig
from diagrams.station_systems import Light, Lighting, ObjectTruth
from maths import se3
from plants.inverse_kinematics import inverse_kinematics
from plants.joint_friction import JointFriction
from plants.manipulation_scene import (
    ManipulationScene,
    ObjectPlacement,
    PlantConfig,
    add_manipulation_scene,
    facing,
)
from plants.pneumatic_hand import PneumaticHand, PneumaticHandConfig
from plants.robot import (
    ARM_JOINTS,
    CLOSED_POSTURE,
    FINGER_JOINTS,
    add_robot,
    make_arm_with_load,
)
from systems.sensors.air_pressure import PressureSensor, PressureSensorConfig
from systems.sensors.joint_encoders import JointEncoders, JointEncodersConfig
from systems.sensors.rgbd_camera import CameraNoise, CameraNoiseConfig
from systems.sensors.robot_mask import RobotMask, RobotMaskConfig
from systems.sensors.wrist_wrench import ReactionWrench, WristWrenchConfig, WristWrenchSensor

Array = npt.NDArray[np.float64]

# A visual that accepts the colour renderer only is transparent.
_RENDERERS = ("colour", "depth")
# What control is told of the perceived joint; see `InteractedJoint`.
PERCEIVED_INPUTS = ("joint_latest", "end_effector_screw_latest", "grasp_failure_latest")


@dataclass(kw_only=True)
class SensorsConfig:
    camera: CameraNoiseConfig = field(default_factory=CameraNoiseConfig)
    encoders: JointEncodersConfig = field(default_factory=JointEncodersConfig)
    wrench: WristWrenchConfig = field(default_factory=WristWrenchConfig)
    pressure: PressureSensorConfig = field(default_factory=PressureSensorConfig)
    robot_mask: RobotMaskConfig = field(default_factory=RobotMaskConfig)


@dataclass(kw_only=True)
class ControlConfig:
    sequence: GraspSequenceConfig = field(default_factory=GraspSequenceConfig)
    exploration: ExplorationConfig = field(default_factory=ExplorationConfig)
    impedance: ImpedanceConfig = field(default_factory=ImpedanceConfig)
    trajectory: TrajectoryGeneratorConfig = field(default_factory=TrajectoryGeneratorConfig)
    # With this the object is locked and the hand moves about it, to learn how it bends.
    excitation: BendingExcitationConfig | None = None
    # Posture (7,) near the taught grasp's, far from the joints' limits on all of the way, [rad].
    posture: np.ndarray = field(
        default_factory=lambda: np.array([-0.6, 0.9, 0.45, 1.5, -3.65, 0.7, 0.0])
    )
    # How well a person guides the hand to the handle, standard deviations.
    guidance_translation: float = 0.004  # [m]
    guidance_rotation: float = 0.03  # [rad]


@dataclass(kw_only=True)
class StationConfig:
    plant: PlantConfig = field(default_factory=PlantConfig)
    hand: PneumaticHandConfig = field(default_factory=PneumaticHandConfig)
    sensors: SensorsConfig = field(default_factory=SensorsConfig)
    control: ControlConfig = field(default_factory=ControlConfig)
    goal: Goal = field(default_factory=Goal)


@dataclass(kw_only=True)
class Station:
    """The station's Diagram and what the wiring around it needs to know.

    Attributes:
        diagram: See `add_station` for its ports.
        scene: The plant and its names.
        arm: The robot's knowledge of its arm, the hand a rigid load.
        intrinsics: Of the camera.
        X_WC: The camera's calibrated pose.
        joint: The explored joint.
        q_start: Posture (7,) at the start of the approach, true, [rad].
        locked: Whether the object is fixed to the world.
    """

    diagram: Diagram
    scene: ManipulationScene
    arm: MultibodyPlant
    intrinsics: CameraInfo
    X_WC: RigidTransform
    joint: Joint
    q_start: Array
    locked: bool

    def SetInitialState(self, root_context: Context) -> None:
        """Puts the arm where the approach begins; locks the object if it is to stay."""
        context = self.scene.plant.GetMyMutableContextFromRoot(root_context)
        self.scene.plant.SetPositions(context, self.scene.arm, self.q_start)
        if self.locked:
            self.joint.Lock(context)


@dataclass(kw_only=True)
class _Wiring:
    """Shared by the functions that build the station, in order."""

    builder: DiagramBuilder
    scene: ManipulationScene
    arm: MultibodyPlant
    config: StationConfig
    seed: int


def make_station(
    config: StationConfig,
    placement: ObjectPlacement,
    joint_name: str,
    handle_frame: str,
    pull_direction: Array,
    intrinsics: CameraInfo,
    X_WC: RigidTransform,
    light: Light,
    seed: int,
) -> Station:
    """Builds the station.

    Output ports of its Diagram: `color_measured`, `depth_measured`, `robot_mask`,
    `joint_state_window`, `wrench_window`, `pressure_window`, `interaction_active`, `phase`,
    `grasp_lost`, `path_planned`, `cheat_configuration`, `cheat_body_pose`, `cheat_plant_state`,
    `cheat_query_object`. Input ports, which may stay unconnected: `PERCEIVED_INPUTS`.

    Args:
        config: Of plant, sensors and controllers.
        placement: The object.
        joint_name: The joint to explore.
        handle_frame: The object's frame to grasp, x out of the object, y along the bar.
        pull_direction: Where the hand pulls to explore (3,), in the handle's frame.
        intrinsics: Of the camera.
        X_WC: Its pose.
        light: Disturbances.
        seed: Of the noise of all sensors and of how the hand is guided to the handle.

    Raises:
        ValueError: for impossible values, unknown names, a handle out of reach.
    """
    builder = DiagramBuilder()
    scene = add_manipulation_scene(builder, config.plant, placement)
    plant = scene.plant
    for kind, name, known in (
        (
            "joint",
            joint_name,
            [j.name() for j in map(plant.get_joint, plant.GetJointIndices(scene.object))],
        ),
        (
            "frame",
            handle_frame,
            [plant.get_frame(i).name() for i in plant.GetFrameIndices(scene.object)],
        ),
    ):
        if name not in known:
            raise ValueError(
                f"{placement.model}: no {kind} named '{name}'; there are {', '.join(known)}"
            )
    joint = plant.GetJointByName(joint_name, scene.object)
    wiring = _Wiring(
        builder=builder,
        scene=scene,
        arm=make_arm_with_load(scene.X_WBase),
        config=config,
        seed=seed,
    )
    _add_object_mechanics(wiring, joint)
    X_WHandle = plant.GetFrameByName(handle_frame, scene.object).CalcPoseInWorld(
        plant.CreateDefaultContext()
    )
    q_grasp, q_start = _taught_postures(wiring, X_WHandle)
    encoders = _add_proprioception(wiring, q_grasp)
    # A person guided the hand along the approach, so the arm knows it as its encoders read it.
    taught = [encoders.measure(np.append(q, np.zeros(7)), 0)[:7] for q in (q_grasp, q_start)]
    direction_E = facing(RigidTransform()).rotation().inverse() @ pull_direction
    sequence = _add_control(wiring, encoders, taught[0], taught[1], direction_E)
    _add_vision(wiring, encoders, sequence, intrinsics, X_WC, light)
    return Station(
        diagram=builder.Build(),
        scene=scene,
        arm=wiring.arm,
        intrinsics=intrinsics,
        X_WC=X_WC,
        joint=joint,
        q_start=q_start,
        locked=config.control.excitation is not None,
    )


def _add_object_mechanics(wiring: _Wiring, joint: Joint) -> None:
    builder, scene = wiring.builder, wiring.scene
    plant = scene.plant
    friction = builder.AddNamedSystem("joint_friction", JointFriction(plant, scene.friction))
    truth = builder.AddNamedSystem("object_truth", ObjectTruth(plant, joint))
    builder.Connect(plant.get_state_output_port(), friction.get_input_port())
    builder.Connect(friction.get_output_port(), plant.get_applied_generalized_force_input_port())
    builder.Connect(plant.get_state_output_port(), truth.get_input_port())
    for name in ("cheat_configuration", "cheat_body_pose"):
        builder.ExportOutput(truth.GetOutputPort(name), name)
    builder.ExportOutput(plant.get_state_output_port(), "cheat_plant_state")
    builder.ExportOutput(scene.scene_graph.get_query_output_port(), "cheat_query_object")


def _taught_postures(wiring: _Wiring, X_WHandle: RigidTransform) -> tuple[Array, Array]:
    """True arm postures (7,) at the grasp that a person guided the hand to, and before it."""
    control = wiring.config.control
    rng = np.random.default_rng((wiring.seed, 1))
    rotation = se3.so3_exp(rng.normal(0.0, control.guidance_rotation, 3))
    X_guided = RigidTransform(
        RotationMatrix(rotation), rng.normal(0.0, control.guidance_translation, 3)
    )
    X_WE = facing(X_WHandle) @ X_guided
    back = RigidTransform([0.0, 0.0, -control.sequence.approach_distance])
    q_grasp = inverse_kinematics(wiring.arm, X_WE, control.posture)
    return q_grasp, inverse_kinematics(wiring.arm, X_WE @ back, q_grasp)


def _add_proprioception(wiring: _Wiring, q_grasp: Array) -> JointEncoders:
    builder, plant, arm = wiring.builder, wiring.scene.plant, wiring.arm
    sensors, seed = wiring.config.sensors, wiring.seed
    context = arm.CreateDefaultContext()
    arm.SetPositions(context, q_grasp)
    frame = arm.GetFrameByName("end_effector")
    J_E = arm.CalcJacobianSpatialVelocity(
        context, JacobianWrtVariable.kV, frame, np.zeros(3), arm.world_frame(), frame
    )
    encoders = builder.AddNamedSystem("encoders", JointEncoders(sensors.encoders, J_E, seed))
    builder.Connect(
        plant.get_state_output_port(wiring.scene.arm), encoders.GetInputPort("joint_state")
    )
    wrist = plant.GetBodyByName("wrist")
    (mount,) = (
        joint
        for joint in map(plant.get_joint, plant.GetJointIndices())
        if joint.child_body().index() == wrist.index()
    )
    X_JcS = plant.GetFrameByName("sensor").CalcPose(
        plant.CreateDefaultContext(), mount.frame_on_child()
    )
    wrench = builder.AddNamedSystem("wrist_load", ReactionWrench(plant, mount, X_JcS))
    wrench_sensor = builder.AddNamedSystem("wrench", WristWrenchSensor(sensors.wrench, seed))
    builder.Connect(plant.get_reaction_forces_output_port(), wrench.get_input_port())
    builder.Connect(wrench.get_output_port(), wrench_sensor.get_input_port())
    pneumatics = builder.AddNamedSystem("pneumatics", PneumaticHand(wiring.config.hand))
    fingers = builder.AddNamedSystem("finger_state", MatrixGain(_finger_selection(wiring.scene)))
    pressure = builder.AddNamedSystem("pressure", PressureSensor(sensors.pressure, seed))
    builder.Connect(plant.get_state_output_port(wiring.scene.hand), fingers.get_input_port())
    builder.Connect(fingers.get_output_port(), pneumatics.GetInputPort("hand_state"))
    builder.Connect(
        pneumatics.GetOutputPort("joint_torques"), plant.get_actuation_input_port(wiring.scene.hand)
    )
    builder.Connect(pneumatics.GetOutputPort("cheat_pressure"), pressure.get_input_port())
    for system, port in (
        (encoders, "joint_state_window"),
        (wrench_sensor, "wrench_window"),
        (pressure, "pressure_window"),
    ):
        builder.ExportOutput(system.GetOutputPort(port), port)
    return encoders


def _finger_selection(scene: ManipulationScene) -> Array:
    """Matrix (30, n) that takes the finger joints' angles and rates out of the hand's state."""
    plant, hand = scene.plant, scene.hand
    n = plant.num_positions(hand)
    first = min(
        joint.position_start()
        for joint in map(plant.get_joint, plant.GetJointIndices(hand))
        if joint.num_positions() > 0
    )
    selection = np.zeros((30, 2 * n))
    for row, name in enumerate(FINGER_JOINTS):
        column = plant.GetJointByName(name, hand).position_start() - first
        selection[row, column] = selection[15 + row, n + column] = 1.0
    return selection


def _add_control(
    wiring: _Wiring,
    encoders: JointEncoders,
    q_taught: Array,
    q_before: Array,
    direction_E: Array,
) -> GraspSequence:
    builder, plant, control = wiring.builder, wiring.scene.plant, wiring.config.control
    arm = ArmModel(wiring.arm)
    X_WE, X_WE_before = (
        arm.Evaluate(np.concatenate([q, np.zeros(7)])).X_WE for q in (q_taught, q_before)
    )
    sequence = builder.AddNamedSystem(
        "grasp_sequence",
        GraspSequence(control.sequence, arm, X_WE, X_WE_before, direction_E, wiring.config.goal),
    )
    if control.excitation is None:
        exploration = builder.AddNamedSystem(
            "exploration", ExplorationController(control.exploration, arm, direction_E)
        )
        builder.Connect(
            encoders.GetOutputPort("joint_state_measured"),
            exploration.GetInputPort("joint_state_measured"),
        )
    else:
        start = control.sequence.approach_time + control.sequence.close_time
        exploration = builder.AddNamedSystem(
            "excitation", BendingExcitation(control.excitation, start, wiring.seed)
        )
    impedance = builder.AddNamedSystem(
        "impedance", ImpedanceController(control.impedance, arm, q_taught)
    )
    pneumatics = builder.GetSubsystemByName("pneumatics")
    builder.Connect(
        builder.GetSubsystemByName("pressure").GetOutputPort("pressure_measured"),
        sequence.GetInputPort("pressure_measured"),
    )
    memory = builder.AddNamedSystem("joint_memory", JointMemory(control.sequence.period))
    generator = builder.AddNamedSystem(
        "trajectory_generator", TrajectoryGenerator(control.trajectory, arm)
    )
    for system in (sequence, generator, impedance):
        builder.Connect(
            encoders.GetOutputPort("joint_state_measured"),
            system.GetInputPort("joint_state_measured"),
        )
    for source, output, target, port in (
        (sequence, "motion_desired", exploration, "motion_desired"),
        (exploration, "motion_commanded", generator, "motion_desired"),
        (generator, "motion_commanded", impedance, "motion_desired"),
        (sequence, "gains_desired", generator, "gains_desired"),
        (generator, "gains_commanded", impedance, "gains_commanded"),
        (sequence, "phase", exploration, "phase"),
        (sequence, "phase", memory, "phase"),
        (sequence, "phase", generator, "phase"),
        (sequence, "phase", impedance, "phase"),
        (generator, "plan_time_left", sequence, "plan_time_left"),
        *(
            (memory, port, target, port)
            for port in ("joint_remembered", "end_effector_screw_remembered")
            for target in (sequence, generator)
        ),
    ):
        builder.Connect(source.GetOutputPort(output), target.GetInputPort(port))
    for port in PERCEIVED_INPUTS:
        source = builder.ExportInput(
            (sequence if sequence.HasInputPort(port) else memory).GetInputPort(port), port
        )
        if generator.HasInputPort(port):
            builder.ConnectInput(source, generator.GetInputPort(port))
    builder.ExportOutput(generator.GetOutputPort("path_planned"), "path_planned")
    builder.Connect(impedance.get_output_port(), plant.get_actuation_input_port(wiring.scene.arm))
    for port in ("pressure_commanded", "sealed"):
        builder.Connect(sequence.GetOutputPort(port), pneumatics.GetInputPort(port))
    for port in ("interaction_active", "phase", "grasp_lost"):
        builder.ExportOutput(sequence.GetOutputPort(port), port)
    return sequence


def _add_vision(
    wiring: _Wiring,
    encoders: JointEncoders,
    sequence: GraspSequence,
    intrinsics: CameraInfo,
    X_WC: RigidTransform,
    light: Light,
) -> None:
    builder, scene_graph = wiring.builder, wiring.scene.scene_graph
    sensors = wiring.config.sensors
    for name in _RENDERERS:
        scene_graph.AddRenderer(name, MakeRenderEngineVtk(_room_light(light.lamp)))
    colour, depth = (
        RenderCameraCore(name, intrinsics, ClippingRange(0.05, 10.0), RigidTransform())
        for name in _RENDERERS
    )
    camera = builder.AddNamedSystem(
        "rgbd_sensor",
        RgbdSensor(
            scene_graph.world_frame_id(),
            X_WC,
            ColorRenderCamera(colour),
            DepthRenderCamera(depth, DepthRange(0.1, 8.0)),
        ),
    )
    noise = builder.AddNamedSystem(
        "camera_noise", CameraNoise(sensors.camera, intrinsics, wiring.seed)
    )
    lighting = builder.AddNamedSystem("lighting", Lighting(light))
    mask = builder.AddNamedSystem(
        "robot_mask",
        RobotMask(
            sensors.robot_mask,
            lambda plant: add_robot(plant, wiring.scene.X_WBase),
            intrinsics,
            X_WC,
            ARM_JOINTS,
            {joint: (0.0, closed) for joint, closed in CLOSED_POSTURE.items()},
        ),
    )
    builder.Connect(scene_graph.get_query_output_port(), camera.query_object_input_port())
    builder.Connect(camera.color_image_output_port(), noise.GetInputPort("color_image"))
    builder.Connect(camera.depth_image_32F_output_port(), noise.GetInputPort("depth_image"))
    if _has_transparent_visuals(scene_graph):
        panes = builder.AddNamedSystem(
            "transparent_surfaces",
            RgbdSensor(
                scene_graph.world_frame_id(),
                X_WC,
                ColorRenderCamera(colour),
                DepthRenderCamera(colour, DepthRange(0.1, 8.0)),
            ),
        )
        builder.Connect(scene_graph.get_query_output_port(), panes.query_object_input_port())
        builder.Connect(panes.depth_image_32F_output_port(), noise.GetInputPort("surface_image"))
    for port in ("illumination", "cover"):
        builder.Connect(lighting.GetOutputPort(port), noise.GetInputPort(port))
    builder.Connect(
        encoders.GetOutputPort("joint_state_measured"), mask.GetInputPort("joint_state_measured")
    )
    builder.Connect(
        sequence.GetOutputPort("closure_commanded"), mask.GetInputPort("closure_commanded")
    )
    builder.ExportOutput(noise.GetOutputPort("color_measured"), "color_measured")
    builder.ExportOutput(noise.GetOutputPort("depth_measured"), "depth_measured")
    builder.ExportOutput(mask.GetOutputPort("robot_mask"), "robot_mask")


def _has_transparent_visuals(scene_graph: SceneGraph) -> bool:
    """Which renderers a visual names cannot be read in Python; those that take all name none."""
    inspector = scene_graph.model_inspector()
    return any(
        inspector.GetPerceptionProperties(geometry).HasProperty("renderer", "accepting")
        for geometry in inspector.GetAllGeometryIds(Role.kPerception)
    )


def _room_light(lamp: float) -> RenderEngineVtkParams:
    """A ceiling light and a window, and the lamp at the camera."""
    lights = [
        LightParameter(
            type="directional", direction=[0.5, -0.5, -1.0], intensity=0.9, frame="world"
        ),
        LightParameter(
            type="directional", direction=[0.6, 0.7, -0.3], intensity=0.5, frame="world"
        ),
    ]
    if lamp > 0.0:
        lights.append(
            LightParameter(
                type="directional", direction=[0.0, 0.0, 1.0], intensity=lamp, frame="camera"
            )
        )
    return RenderEngineVtkParams(default_clear_color=[0.7, 0.75, 0.8], lights=lights)
