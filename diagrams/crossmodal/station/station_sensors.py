"""The sensors of a station and their wires: what the body feels and what the eye sees."""

import numpy as np
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
from pydrake.math import RigidTransform
from pydrake.multibody.tree import JacobianWrtVariable
from pydrake.systems.primitives import MatrixGain
from pydrake.systems.sensors import CameraInfo, RgbdSensor

from controllers.interaction.grasp_sequence import GraspSequence
from diagrams.crossmodal.robot_config import ARM, HAND
from diagrams.crossmodal.station.station_config import StationWiring
from diagrams.stations.lighting import Light, Lighting
from maths.arrays import Array
from plants.hands.pneumatic_hand import PneumaticHand
from plants.hands.soft_hand import CLOSED_POSTURE, finger_selection
from plants.robots.arm_with_hand import add_robot
from plants.robots.wam import ARM_JOINTS, WAM_WITH_SOFT_HAND
from systems.sensors.air_pressure import PressureSensor
from systems.sensors.joint_encoders import JointEncoders
from systems.sensors.rgbd_camera import CameraNoise
from systems.sensors.robot_mask import RobotMask
from systems.sensors.wrist_wrench import ReactionWrench, WristWrenchSensor

# A visual that accepts the colour renderer only is transparent.
_RENDERERS = ("colour", "depth")


def add_proprioception(wiring: StationWiring, q_grasp: Array) -> JointEncoders:
    builder, plant, arm = wiring.builder, wiring.scene.plant, wiring.arm
    sensors, seed = wiring.config.sensors, wiring.seed
    hand = wiring.scene.model(HAND)
    context = arm.CreateDefaultContext()
    arm.SetPositions(context, q_grasp)
    frame = arm.GetFrameByName("end_effector")
    J_E = arm.CalcJacobianSpatialVelocity(
        context, JacobianWrtVariable.kV, frame, np.zeros(3), arm.world_frame(), frame
    )
    encoders = builder.AddNamedSystem("encoders", JointEncoders(sensors.encoders, J_E, seed))
    builder.Connect(
        plant.get_state_output_port(wiring.scene.model(ARM)), encoders.GetInputPort("joint_state")
    )
    wrist = plant.GetBodyByName("wrist", hand)
    (mount,) = (
        joint
        for joint in map(plant.get_joint, plant.GetJointIndices())
        if joint.child_body().index() == wrist.index()
    )
    X_JcS = plant.GetFrameByName("sensor", hand).CalcPose(
        plant.CreateDefaultContext(), mount.frame_on_child()
    )
    wrench = builder.AddNamedSystem("wrist_load", ReactionWrench(plant, mount, X_JcS))
    wrench_sensor = builder.AddNamedSystem("wrench", WristWrenchSensor(sensors.wrench, seed))
    builder.Connect(plant.get_reaction_forces_output_port(), wrench.get_input_port())
    builder.Connect(wrench.get_output_port(), wrench_sensor.get_input_port())
    pneumatics = builder.AddNamedSystem("pneumatics", PneumaticHand(wiring.config.hand))
    fingers = builder.AddNamedSystem("finger_state", MatrixGain(finger_selection(plant, hand)))
    pressure = builder.AddNamedSystem("pressure", PressureSensor(sensors.pressure, seed))
    builder.Connect(plant.get_state_output_port(hand), fingers.get_input_port())
    builder.Connect(fingers.get_output_port(), pneumatics.GetInputPort("hand_state"))
    builder.Connect(
        pneumatics.GetOutputPort("joint_torques"),
        plant.get_actuation_input_port(hand),
    )
    builder.Connect(pneumatics.GetOutputPort("cheat_pressure"), pressure.get_input_port())
    for system, port in (
        (encoders, "joint_state_window"),
        (wrench_sensor, "wrench_window"),
        (pressure, "pressure_window"),
    ):
        builder.ExportOutput(system.GetOutputPort(port), port)
    return encoders


def add_vision(
    wiring: StationWiring,
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
            lambda plant: add_robot(plant, WAM_WITH_SOFT_HAND, wiring.scene.pose("base", ARM)),
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
