"""The cameras of a station, each as it is, and what the robot believes to see of itself."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

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
from pydrake.multibody.parsing import GetScopedFrameByName
from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.framework import DiagramBuilder, OutputPort, System
from pydrake.systems.sensors import RgbdSensor

from crossmodal.diagrams.run.calibration import CameraCalibration, draw_camera
from crossmodal.diagrams.run.scenario import CameraBump
from crossmodal.diagrams.stations.naming import own_seed, owner_among, prefixed
from crossmodal.diagrams.stations.occurrence import Occurrence
from crossmodal.diagrams.stations.wiring import StationWiring
from crossmodal.plants.camera_view import renderer_intrinsics
from crossmodal.systems.arm_pose import ArmPose
from crossmodal.systems.sensors.bumped_camera import IMAGES, BumpedCamera
from crossmodal.systems.sensors.image_delay import ImageDelay
from crossmodal.systems.sensors.image_stamps import ImageStamps, Mounting
from crossmodal.systems.sensors.rgbd_camera import CameraNoise, CameraNoiseConfig
from crossmodal.systems.sensors.robot_mask import MaskedRobot, RobotMask, RobotMaskConfig

LIGHT, COVER = "light_by_hand", "cover_by_hand"  # Inputs of the station.
# A visual that accepts the colour renderer only is transparent.
_RENDERERS = ("colour", "depth")


@dataclass(frozen=True, kw_only=True)
class CameraCarrier:
    """The arm that carries a camera, as the robot knows it.

    Attributes:
        pose: Of the camera's `base_frame`, by the robot's own model of the arm.
        joint_state: What says `joint_state_measured` of the arm.
    """

    pose: ArmPose
    joint_state: OutputPort


def add_cameras(
    wiring: StationWiring,
    config: CameraNoiseConfig,
    colour_is_streamed: bool = True,
    carriers: Mapping[str, CameraCarrier] | None = None,
) -> dict[str, OutputPort]:
    """Adds the cameras of a scenario, drawn by its seed around what is believed of them.

    Exports `color_measured` and `depth_measured`, of several cameras each with the camera's name
    before it. Inputs `light_by_hand` and `cover_by_hand`, named likewise, may stay unconnected.

    Args:
        colour_is_streamed: Whether an estimator reads the colour images. Otherwise they are for
            pictures: rendered when one is taken, with a fixed exposure and without latency.
        carriers: The arms that carry cameras, by the camera's name. The images of a camera that is
            neither carried nor fixed in the world do not say where it is.

    Returns:
        What says the measured depth, as an image without a stamp, by the camera's name.

    Raises:
        ValueError: if not all cameras have the same lamp, or an arm carries none of them.
    """
    carriers, names = carriers or {}, wiring.calibration.cameras
    for name in carriers:
        if name not in names or names[name].is_fixed:
            raise ValueError(f"an arm cannot carry '{name}', which is no camera on a robot")
    lamps = {camera.lamp for camera in wiring.scenario.cameras.values()}
    if len(lamps) > 1:
        raise ValueError(f"cameras have lamps of {sorted(lamps)}, but all share one renderer")
    scene = add_camera_scene(wiring.builder, wiring.plant, wiring.scene.scene_graph, *lamps)
    return {
        name: _add_camera(wiring, scene, name, config, colour_is_streamed, carriers.get(name))
        for name in names
    }


def add_robot_masks(
    wiring: StationWiring,
    build_robot: Callable[[MultibodyPlant], object],
    robots: Mapping[str, MaskedRobot],
    config: RobotMaskConfig,
    postures: Mapping[str, OutputPort],
    depths: Mapping[str, OutputPort] | None = None,
) -> None:
    """Adds the mask of the robots in each camera's images; exports `robot_mask` as the images are.

    Args:
        build_robot: Adds the robots to a plant, fixed in the world where they believe to stand.
        robots: By name.
        postures: What says how the robots stand, by the input ports of `RobotMask`.
        depths: What the cameras see, by their names; with it what stands before a robot is not
            masked.
    """
    builder, cameras = wiring.builder, wiring.calibration.cameras
    for name, camera in cameras.items():
        port = prefixed(owner_among(name, cameras), "robot_mask")
        intrinsics = renderer_intrinsics(camera.intrinsics)
        mask = builder.AddNamedSystem(
            port,
            RobotMask(config, build_robot, intrinsics, camera.X_PC, robots, camera.base_frame),
        )
        builder.ExportOutput(mask.GetOutputPort("robot_mask"), port)
        for posture, source in postures.items():
            builder.Connect(source, mask.GetInputPort(posture))
        if depths is not None:
            builder.Connect(depths[name], mask.GetInputPort("depth_measured"))


def add_camera_scene(
    builder: DiagramBuilder, plant: MultibodyPlant, scene_graph: SceneGraph, lamp: float = 0.0
) -> SceneGraph:
    """Adds a copy of the scene for all cameras of a station to look at.

    Renderers follow every pose that their scene is asked for. The plant asks at each of its steps;
    the copy, which holds them, is asked when an image is due only.

    Args:
        plant: The simulated one.
        scene_graph: Its geometry, complete, without renderers.
        lamp: Intensity of a lamp at the camera that renders; the ceiling light's is 0.9.
    """
    scene = builder.AddNamedSystem("camera_scene", scene_graph.Clone())
    for name in _RENDERERS:
        scene.AddRenderer(name, MakeRenderEngineVtk(_room_light(lamp)))
    poses = scene.get_source_pose_port(plant.get_source_id())
    builder.Connect(plant.get_geometry_pose_output_port(), poses)
    return scene


def _add_camera(
    wiring: StationWiring,
    scene_graph: SceneGraph,
    name: str,
    config: CameraNoiseConfig,
    colour_is_streamed: bool,
    carrier: CameraCarrier | None,
) -> OutputPort:
    """Adds a camera and what disturbs it; exports its images and returns the measured depth.

    The images at a tick are those that were taken the camera's latency before it; nobody knows of
    it, so that they are stamped with the tick.

    Args:
        scene_graph: What `add_camera_scene` gave.
        name: Of the camera.
        colour_is_streamed: As for `add_cameras`.
        carrier: The arm that carries it.
    """
    builder, plant, scenario = wiring.builder, wiring.plant, wiring.scenario
    cameras, seed, period = wiring.calibration.cameras, scenario.seed, scenario.network_period
    errors = scenario.calibration.drawn_errors(seed)
    camera = draw_camera(name, cameras[name], errors, seed)
    owner, disturbances = owner_among(name, cameras), scenario.disturbances
    base = GetScopedFrameByName(plant, camera.base_frame)
    parent = plant.GetBodyFrameIdOrThrow(base.body().index())
    X_BC = base.GetFixedPoseInBodyFrame() @ camera.X_PC
    u, v = camera.registration
    colour_intrinsics = camera.intrinsics
    depth_intrinsics = replace(
        colour_intrinsics,
        center_x=colour_intrinsics.center_x + u,
        center_y=colour_intrinsics.center_y + v,
    )
    colour, depth, surface = (
        RenderCameraCore(
            name, renderer_intrinsics(intrinsics), ClippingRange(0.05, 10.0), RigidTransform()
        )
        for name, intrinsics in (
            (_RENDERERS[0], colour_intrinsics),
            (_RENDERERS[1], depth_intrinsics),
            (_RENDERERS[0], depth_intrinsics),
        )
    )

    bumps = sorted(
        (bump for bump in disturbances.camera_bumps if bump.camera in ("", name)),
        key=lambda bump: bump.start,
    )

    def add_sensor(name: str, depth_core: RenderCameraCore) -> System:
        """A camera; after each bump another one, which stands where that has put it."""
        depth_camera, X = DepthRenderCamera(depth_core, DepthRange(0.1, 8.0)), X_BC
        sensors = []
        for index, bump in enumerate([CameraBump(), *bumps]):
            X = X @ bump.displacement()
            sensor = builder.AddNamedSystem(
                prefixed(owner, f"{name}_after_bump_{index}" if index else name),
                RgbdSensor(parent, X, ColorRenderCamera(colour), depth_camera),
            )
            builder.Connect(scene_graph.get_query_output_port(), sensor.query_object_input_port())
            sensors.append(sensor)
        if not bumps:
            return sensors[0]
        switch = builder.AddNamedSystem(
            prefixed(owner, f"{name}_in_place"), BumpedCamera([bump.start for bump in bumps])
        )
        for index, sensor in enumerate(sensors):
            for port in IMAGES:
                source, target = sensor.GetOutputPort(port), f"{port}_{index}"
                builder.Connect(source, switch.GetInputPort(target))
        return switch

    sensor = add_sensor("rgbd_sensor", depth)
    noise = builder.AddNamedSystem(
        prefixed(owner, "camera_noise"),
        CameraNoise(
            config,
            renderer_intrinsics(depth_intrinsics),
            own_seed(seed, owner),
            depth_scale=camera.depth_scale,
            first_frame=-camera.latency % period,
            period=period,
            is_metered=colour_is_streamed,
        ),
    )
    builder.Connect(sensor.GetOutputPort("color_image"), noise.GetInputPort("color_image"))
    builder.Connect(sensor.GetOutputPort("depth_image_32f"), noise.GetInputPort("depth_image"))
    if _has_transparent_visuals(scene_graph):
        surfaces = add_sensor("transparent_surfaces", surface)
        builder.Connect(
            surfaces.GetOutputPort("depth_image_32f"), noise.GetInputPort("surface_image")
        )
    light = Occurrence(disturbances.lights_off, during=lambda span: span.remaining, otherwise=1.0)
    for port, occurrence, by_hand in (
        ("illumination", light, LIGHT),
        ("cover", Occurrence(disturbances.camera_covered), COVER),
    ):
        builder.AddNamedSystem(prefixed(owner, port), occurrence)
        builder.ExportInput(occurrence.get_input_port(), prefixed(owner, by_hand))
        builder.Connect(occurrence.get_output_port(), noise.GetInputPort(port))
    stamps = builder.AddNamedSystem(
        prefixed(owner, "image_stamps"), ImageStamps(_mounting(cameras[name], carrier))
    )
    if carrier is not None:
        builder.Connect(carrier.joint_state, stamps.GetInputPort("joint_state_measured"))
    measured = {}
    for image in ("color", "depth"):
        port = f"{image}_measured"
        measured[image] = noise.GetOutputPort(port)
        if camera.latency > 0.0 and (colour_is_streamed or image == "depth"):
            model = measured[image].Allocate()
            delay = builder.AddNamedSystem(
                prefixed(owner, f"{image}_delay"), ImageDelay(model, camera.latency, period)
            )
            builder.Connect(measured[image], delay.get_input_port())
            measured[image] = delay.get_output_port()
        builder.Connect(measured[image], stamps.GetInputPort(f"{image}_image"))
        builder.ExportOutput(stamps.GetOutputPort(port), prefixed(owner, port))
    return measured["depth"]


def _mounting(camera: CameraCalibration, carrier: CameraCarrier | None) -> Mounting | None:
    """What is believed of where a camera is fixed; None where nobody knows it."""
    if carrier is None and not camera.is_fixed:
        return None
    return Mounting(
        X_PC=camera.X_PC,
        covariance=camera.pose_covariance,
        arm=None if carrier is None else carrier.pose,
    )


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
