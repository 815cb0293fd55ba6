"""A camera of a station: images with noise, disturbances, and a mask of the robot in them."""

from collections.abc import Callable, Mapping
from dataclasses import replace

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
from pydrake.systems.framework import DiagramBuilder, OutputPort
from pydrake.systems.sensors import RgbdSensor

from crossmodal.diagrams.run.calibration import Camera
from crossmodal.diagrams.run.scenario import Disturbances
from crossmodal.diagrams.stations.lighting import Lighting
from crossmodal.diagrams.stations.naming import own_seed, prefixed
from crossmodal.plants.camera_view import renderer_intrinsics
from crossmodal.systems.sensors.image_delay import ImageDelay
from crossmodal.systems.sensors.image_stamps import ImageStamps
from crossmodal.systems.sensors.rgbd_camera import CameraNoise, CameraNoiseConfig
from crossmodal.systems.sensors.robot_mask import MaskedRobot, RobotMask, RobotMaskConfig

# A visual that accepts the colour renderer only is transparent.
_RENDERERS = ("colour", "depth")


def add_camera_scene(
    builder: DiagramBuilder, plant: MultibodyPlant, scene_graph: SceneGraph, lamp: float = 0.0
) -> SceneGraph:
    """Adds a copy of the scene for all cameras of a station to look at.

    Renderers follow every pose that their scene is asked for. The plant asks at each of its steps;
    the copy, which holds them, is asked when an image is due only.

    Args:
        builder: Of the station.
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


def add_rgbd_camera(
    builder: DiagramBuilder,
    plant: MultibodyPlant,
    scene_graph: SceneGraph,
    camera: Camera,
    config: CameraNoiseConfig,
    disturbances: Disturbances,
    seed: int,
    period: float,
    owner: str = "",
    colour_is_read: bool = True,
) -> OutputPort:
    """Adds a camera and what disturbs it; exports `color_measured` and `depth_measured`.

    The images at a tick are those that were taken the camera's latency before it; nobody knows of
    it, so that they are stamped with the tick.

    Args:
        builder: Of the station.
        plant: The simulated one.
        scene_graph: What `add_camera_scene` gave.
        camera: As it is, which need not be what the robot believes.
        config: Of its noise.
        disturbances: When it is dark and when something covers the camera.
        seed: Of the noise.
        period: Between two images that are read, the ticks of the estimators, [s].
        owner: Name of the camera where there are several; it then begins the names.
        colour_is_read: Whether an estimator reads the colour image. Otherwise it is for pictures:
            rendered when one is taken, with a fixed exposure and without latency.

    Returns:
        What says the measured depth, as an image without a stamp.
    """
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

    def add_sensor(name: str, depth_core: RenderCameraCore) -> RgbdSensor:
        depth_camera = DepthRenderCamera(depth_core, DepthRange(0.1, 8.0))
        sensor = builder.AddNamedSystem(
            prefixed(owner, name),
            RgbdSensor(parent, X_BC, ColorRenderCamera(colour), depth_camera),
        )
        builder.Connect(scene_graph.get_query_output_port(), sensor.query_object_input_port())
        return sensor

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
            is_metered=colour_is_read,
        ),
    )
    lighting = builder.AddNamedSystem(prefixed(owner, "lighting"), Lighting(disturbances))
    builder.Connect(sensor.color_image_output_port(), noise.GetInputPort("color_image"))
    builder.Connect(sensor.depth_image_32F_output_port(), noise.GetInputPort("depth_image"))
    if _has_transparent_visuals(scene_graph):
        surfaces = add_sensor("transparent_surfaces", surface)
        builder.Connect(surfaces.depth_image_32F_output_port(), noise.GetInputPort("surface_image"))
    for port in ("illumination", "cover"):
        builder.Connect(lighting.GetOutputPort(port), noise.GetInputPort(port))
    stamps = builder.AddNamedSystem(prefixed(owner, "image_stamps"), ImageStamps())
    measured = {}
    for image in ("color", "depth"):
        port = f"{image}_measured"
        measured[image] = noise.GetOutputPort(port)
        if camera.latency > 0.0 and (colour_is_read or image == "depth"):
            model = measured[image].Allocate()
            delay = builder.AddNamedSystem(
                prefixed(owner, f"{image}_delay"), ImageDelay(model, camera.latency, period)
            )
            builder.Connect(measured[image], delay.get_input_port())
            measured[image] = delay.get_output_port()
        builder.Connect(measured[image], stamps.GetInputPort(f"{image}_image"))
        builder.ExportOutput(stamps.GetOutputPort(port), prefixed(owner, port))
    return measured["depth"]


def add_robot_mask(
    builder: DiagramBuilder,
    build_robot: Callable[[MultibodyPlant], object],
    believed: Camera,
    robots: Mapping[str, MaskedRobot],
    config: RobotMaskConfig,
    owner: str = "",
) -> RobotMask:
    """Adds the mask of the robot in a camera's images; exports `robot_mask`.

    The mask's inputs are left to be connected.

    Args:
        builder: Of the station.
        build_robot: Adds the robots to a plant, fixed in the world where they believe to stand.
        believed: The camera as the robot knows it.
        robots: By name.
        config: Of the mask.
        owner: Name of the camera where there are several; it then begins the names.
    """
    mask = builder.AddNamedSystem(
        prefixed(owner, "robot_mask"),
        RobotMask(
            config,
            build_robot,
            renderer_intrinsics(believed.intrinsics),
            believed.X_PC,
            robots,
            believed.base_frame,
        ),
    )
    builder.ExportOutput(mask.GetOutputPort("robot_mask"), prefixed(owner, "robot_mask"))
    return mask


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
