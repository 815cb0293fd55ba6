"""All cameras of a station, each as it is, and what the robot believes to see of itself."""

from collections.abc import Callable, Mapping

from pydrake.geometry import SceneGraph
from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.framework import DiagramBuilder, OutputPort

from crossmodal.diagrams.run.calibration import Calibration, Camera, draw_camera
from crossmodal.diagrams.run.scenario import Scenario
from crossmodal.diagrams.stations.add_rgbd_camera import (
    add_camera_scene,
    add_rgbd_camera,
    add_robot_mask,
)
from crossmodal.diagrams.stations.naming import owner_among
from crossmodal.systems.sensors.rgbd_camera import CameraNoiseConfig
from crossmodal.systems.sensors.robot_mask import MaskedRobot, RobotMaskConfig


def add_cameras(
    builder: DiagramBuilder,
    plant: MultibodyPlant,
    scene_graph: SceneGraph,
    scenario: Scenario,
    calibration: Calibration,
    config: CameraNoiseConfig,
    colour_is_read: bool = True,
) -> dict[str, OutputPort]:
    """Adds the cameras of a scenario, drawn by its seed around what is believed of them.

    Exports `color_measured` and `depth_measured`, of several cameras each with the camera's name
    before it.

    Args:
        builder: Of the station.
        plant: The simulated one.
        scene_graph: Its geometry.
        scenario: With seed, calibration errors, lamps and disturbances.
        calibration: What the robot believes of the cameras.
        config: Of their noise.
        colour_is_read: Whether an estimator reads the colour images; otherwise they are rendered
            for pictures only.

    Returns:
        What says the measured depth, by the camera's name.

    Raises:
        ValueError: if not all cameras have the same lamp.
    """
    lamps = {camera.lamp for camera in scenario.cameras.values()}
    if len(lamps) > 1:
        raise ValueError(f"cameras have lamps of {sorted(lamps)}, but all share one renderer")
    camera_scene = add_camera_scene(builder, plant, scene_graph, *lamps)
    depths = {}
    for name, believed in calibration.cameras.items():
        depths[name] = add_rgbd_camera(
            builder,
            plant,
            camera_scene,
            draw_camera(name, believed, scenario.calibration.errors, scenario.seed),
            config,
            scenario.disturbances,
            scenario.seed,
            scenario.network_period,
            owner_among(name, calibration.cameras),
            colour_is_read,
        )
    return depths


def add_robot_masks(
    builder: DiagramBuilder,
    build_robot: Callable[[MultibodyPlant], object],
    cameras: Mapping[str, Camera],
    robots: Mapping[str, MaskedRobot],
    config: RobotMaskConfig,
    postures: Mapping[str, OutputPort],
    depths: Mapping[str, OutputPort] | None = None,
) -> None:
    """Adds the mask of the robots in each camera's images; exports `robot_mask` as the images are.

    Args:
        builder: Of the station.
        build_robot: Adds the robots to a plant, fixed in the world where they believe to stand.
        cameras: As the robot knows them.
        robots: By name.
        config: Of the masks.
        postures: What says how the robots stand, by the input ports of `RobotMask`.
        depths: What the cameras see, by their names; with it what stands before a robot is not
            masked.
    """
    for name, camera in cameras.items():
        owner = owner_among(name, cameras)
        mask = add_robot_mask(builder, build_robot, camera, robots, config, owner)
        for port, source in postures.items():
            builder.Connect(source, mask.GetInputPort(port))
        if depths is not None:
            builder.Connect(depths[name], mask.GetInputPort("depth_measured"))
