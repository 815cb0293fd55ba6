"""A camera in a scene that holds nothing but the robot's model of itself."""

from collections.abc import Callable

from pydrake.geometry import (
    ClippingRange,
    ColorRenderCamera,
    DepthRange,
    DepthRenderCamera,
    MakeRenderEngineVtk,
    RenderCameraCore,
    RenderEngineVtkParams,
    SceneGraph,
)
from pydrake.math import RigidTransform
from pydrake.multibody.parsing import GetScopedFrameByName
from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.framework import Diagram, DiagramBuilder
from pydrake.systems.rendering import MultibodyPositionToGeometryPose
from pydrake.systems.sensors import CameraInfo, RgbdSensor

_RENDERER = "robot"


class RobotCamera(Diagram):
    """Renders the robot's model at given positions, from the camera's pose.

    The scene is its own, so that no true pose of anything can leak into an image. A camera on a
    link moves with the model's link. Rendered only when read.

    Input ports:
    - `positions`: (nq,), of the model, [rad].

    Output ports:
    - `depth_image`: `ImageDepth32F`, inf where the robot is not, [m].
    - `label_image`: `ImageLabel16I`, index of the body that is seen.

    Frames: P what carries the camera, C camera (x right, y down, z forward).

    Args:
        build_robot: Adds the robots to a plant and fixes them in the world; it need not finalize.
        intrinsics: Of the image.
        X_PC: The camera's calibrated pose.
        depth_range: Nearest and farthest surface, [m].
        base_frame: P, a frame of a model (`model::frame`) or the world.
    """

    def __init__(
        self,
        build_robot: Callable[[MultibodyPlant], object],
        intrinsics: CameraInfo,
        X_PC: RigidTransform,
        depth_range: tuple[float, float],
        base_frame: str = "world",
    ) -> None:
        super().__init__()
        builder = DiagramBuilder()
        scene_graph = builder.AddNamedSystem("scene_graph", SceneGraph())
        plant = MultibodyPlant(time_step=0.0)
        plant.RegisterAsSourceForSceneGraph(scene_graph)
        build_robot(plant)
        if not plant.is_finalized():
            plant.Finalize()
        self.plant = plant  # MultibodyPositionToGeometryPose refers to it.
        scene_graph.AddRenderer(_RENDERER, MakeRenderEngineVtk(RenderEngineVtkParams()))
        to_pose = builder.AddNamedSystem("to_pose", MultibodyPositionToGeometryPose(plant))
        near, far = depth_range
        core = RenderCameraCore(
            _RENDERER, intrinsics, ClippingRange(0.5 * near, 1.1 * far), RigidTransform()
        )
        base = GetScopedFrameByName(plant, base_frame)
        sensor = builder.AddNamedSystem(
            "camera",
            RgbdSensor(
                parent_id=plant.GetBodyFrameIdOrThrow(base.body().index()),
                X_PB=base.GetFixedPoseInBodyFrame() @ X_PC,
                color_camera=ColorRenderCamera(core, False),
                depth_camera=DepthRenderCamera(core, DepthRange(near, far)),
            ),
        )
        source = scene_graph.get_source_pose_port(plant.get_source_id())
        builder.Connect(to_pose.get_output_port(), source)
        builder.Connect(scene_graph.get_query_output_port(), sensor.query_object_input_port())
        builder.ExportInput(to_pose.get_input_port(), "positions")
        builder.ExportOutput(sensor.depth_image_32F_output_port(), "depth_image")
        builder.ExportOutput(sensor.label_image_output_port(), "label_image")
        builder.BuildInto(self)
