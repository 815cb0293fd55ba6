"""Where the camera sees the robot itself, from the robot's model at the measured joints."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt
from pydrake.common.value import AbstractValue, Value
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
from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.framework import BasicVector, Context, Diagram, DiagramBuilder, LeafSystem
from pydrake.systems.rendering import MultibodyPositionToGeometryPose
from pydrake.systems.sensors import CameraInfo, ImageDepth32F, ImageGrey8U, RgbdSensor

from maths.arrays import Array, Ids
from systems.checks import require

Grey = npt.NDArray[np.uint8]

_RENDERER = "silhouette"


@dataclass(kw_only=True)
class RobotMaskConfig:
    reduction: int = 4  # The silhouette is rendered in an image smaller by this factor.
    margin: float = 0.03  # Added around the robot, for its pose is not known exactly, [m].
    range_min: float = 0.2  # Nearest robot surface, [m].
    range_max: float = 4.0  # Farthest robot surface, [m].


def reduced_intrinsics(full: CameraInfo, reduction: int) -> CameraInfo:
    """The same view in an image smaller by `reduction`, which divides width and height."""
    return CameraInfo(
        full.width() // reduction,
        full.height() // reduction,
        full.focal_x() / reduction,
        full.focal_y() / reduction,
        (full.center_x() + 0.5) / reduction - 0.5,
        (full.center_y() + 0.5) / reduction - 0.5,
    )


def silhouette_to_mask(depth: npt.NDArray[np.float32], focal: float, margin: float) -> Grey:
    """Grey image (h, w), 255 within `margin` of what the depth image sees.

    The margin in pixels is that at each surface's own depth, and one pixel more for what the
    rendering, which samples the pixels' centres, can miss.

    Args:
        depth: (h, w), inf where there is nothing, 0 where something is too near, [m].
        focal: Of that image, [px].
        margin: [m].
    """
    nearest = depth[depth > 0.0].min(initial=np.inf)
    distance = np.where(depth > 0.0, depth, nearest)
    radius = np.where(depth < np.inf, np.ceil(focal * margin / distance) + 1.0, 0.0).astype(int)
    mask = np.zeros(depth.shape, dtype=np.uint8)
    for r in np.unique(radius[radius > 0]):
        layer = np.where(radius == r, np.uint8(255), np.uint8(0))
        shape = cv2.MORPH_ELLIPSE if r > 1 else cv2.MORPH_RECT
        disc = cv2.getStructuringElement(shape, (2 * int(r) + 1, 2 * int(r) + 1))
        np.maximum(mask, cv2.dilate(layer, disc), out=mask)
    return mask


def enlarge(mask: Grey, reduction: int, enlarged: Grey) -> None:
    """Writes each pixel of `mask` (h, w) to a block of `enlarged` (h reduction, w reduction)."""
    blocks = enlarged.reshape(mask.shape[0], reduction, mask.shape[1], reduction)
    blocks[:] = mask[:, None, :, None]


class HandPostureModel(LeafSystem):
    """The positions of the robot's whole model, from measured arm joints and commanded closure.

    A soft hand has no encoders in its fingers: their joints go linearly from the open to the
    closed posture with the commanded closure.

    .. pydrake_system::

        name: HandPostureModel
        input_ports:
        - joint_state_measured
        - closure_commanded
        output_ports:
        - positions_estimated

    - `joint_state_measured`: (2 n,), q [rad] and qdot [rad/s] of the arm; qdot is not used.
    - `closure_commanded`: (1,), 0 open, 1 closed; 0 if not connected.
    - `positions_estimated`: (nq,), of the model, [rad].
    """

    def __init__(self, arm: Ids, q_open: Array, q_closed: Array) -> None:
        """Keeps the postures.

        Args:
            arm: Indices (n,) of the arm's joints in the model's positions.
            q_open: Positions (nq,) with the hand open.
            q_closed: Positions (nq,) with the hand closed.
        """
        super().__init__()
        self._arm, self._q_open, self._q_closed = arm, q_open, q_closed
        self._state = self.DeclareVectorInputPort("joint_state_measured", 2 * len(arm))
        self._closure = self.DeclareVectorInputPort("closure_commanded", 1)
        self.DeclareVectorOutputPort("positions_estimated", len(q_open), self._calc)

    def _calc(self, context: Context, output: BasicVector) -> None:
        closure = self._closure.Eval(context)[0] if self._closure.HasValue(context) else 0.0
        q = self._q_open + np.clip(closure, 0.0, 1.0) * (self._q_closed - self._q_open)
        q[self._arm] = self._state.Eval(context)[: len(self._arm)]
        output.set_value(q)


class SilhouetteMask(LeafSystem):
    """Turns the robot's rendered depth into a mask of the camera's size, with a margin.

    .. pydrake_system::

        name: SilhouetteMask
        input_ports:
        - depth_image
        output_ports:
        - robot_mask

    - `depth_image`: `ImageDepth32F` of the reduced size, inf where the robot is not.
    - `robot_mask`: `ImageGrey8U` of the camera's size, 255 robot, 0 elsewhere.
    """

    def __init__(self, config: RobotMaskConfig, reduced: CameraInfo) -> None:
        super().__init__()
        self._config = config
        self._focal = reduced.focal_x()
        width, height = reduced.width(), reduced.height()
        depth = Value[ImageDepth32F](ImageDepth32F(width, height))
        scale = config.reduction
        mask = Value[ImageGrey8U](ImageGrey8U(width * scale, height * scale))
        self._depth = self.DeclareAbstractInputPort("depth_image", depth)
        self.DeclareAbstractOutputPort("robot_mask", mask.Clone, self._calc)

    def _calc(self, context: Context, output: AbstractValue) -> None:
        depth = self._depth.Eval(context).data[:, :, 0]
        mask = silhouette_to_mask(depth, self._focal, self._config.margin)
        enlarge(mask, self._config.reduction, output.get_mutable_value().mutable_data[:, :, 0])


class RobotMask(Diagram):
    """Renders the robot's model of itself, at the measured joints, from the camera's pose.

    It holds a scene of its own with nothing but the robot, rendered at a reduced size, so that no
    true pose of anything can leak into the mask. The joints are measured with an offset, hence the
    margin. Rendered only when read.

    .. pydrake_system::

        name: RobotMask
        input_ports:
        - joint_state_measured
        - closure_commanded
        output_ports:
        - robot_mask

    - `joint_state_measured`: (2 n,), q [rad] and qdot [rad/s] of the arm.
    - `closure_commanded`: (1,), 0 open, 1 closed; 0 if not connected.
    - `robot_mask`: `ImageGrey8U` of the camera's size, 255 robot, 0 elsewhere.

    Frames: W world, C camera (x right, y down, z forward).
    """

    def __init__(
        self,
        config: RobotMaskConfig,
        build_robot: Callable[[MultibodyPlant], object],
        intrinsics: CameraInfo,
        X_WC: RigidTransform,
        arm_joints: list[str],
        hand_posture: Mapping[str, tuple[float, float]],
    ) -> None:
        """Builds the robot's scene.

        Args:
            config: Size, margin and range.
            build_robot: Adds the robot to a plant and fixes it in the world; it need not finalize.
            intrinsics: Of the camera.
            X_WC: The camera's calibrated pose.
            arm_joints: Names of the arm's joints, in the order of `joint_state_measured`.
            hand_posture: Angles (open, closed) of the hand's joints by name, [rad].
        """
        super().__init__()
        c, name = config, "RobotMask"
        divides = c.reduction > 0 and not (
            intrinsics.width() % c.reduction or intrinsics.height() % c.reduction
        )
        require(divides, name, c, "reduction", "a divisor of the image's width and height")
        require(0 <= c.margin < np.inf, name, c, "margin", ">= 0 m")
        require(0 < c.range_min < np.inf, name, c, "range_min", "> 0 m")
        require(c.range_min < c.range_max < np.inf, name, c, "range_max", "> range_min, in m")

        builder = DiagramBuilder()
        scene_graph = SceneGraph()
        plant = MultibodyPlant(time_step=0.0)
        plant.RegisterAsSourceForSceneGraph(scene_graph)
        build_robot(plant)
        if not plant.is_finalized():
            plant.Finalize()
        self._plant = plant  # MultibodyPositionToGeometryPose refers to it.
        scene_graph.AddRenderer(_RENDERER, MakeRenderEngineVtk(RenderEngineVtkParams()))
        builder.AddNamedSystem("scene_graph", scene_graph)

        arm, q_open, q_closed = _postures(plant, arm_joints, hand_posture)
        posture = builder.AddNamedSystem("posture", HandPostureModel(arm, q_open, q_closed))
        to_pose = builder.AddNamedSystem("to_pose", MultibodyPositionToGeometryPose(plant))
        reduced = reduced_intrinsics(intrinsics, c.reduction)
        camera = builder.AddNamedSystem("camera", _make_camera(c, scene_graph, reduced, X_WC))
        mask = builder.AddNamedSystem("mask", SilhouetteMask(c, reduced))

        builder.Connect(posture.get_output_port(), to_pose.get_input_port())
        builder.Connect(
            to_pose.get_output_port(), scene_graph.get_source_pose_port(plant.get_source_id())
        )
        builder.Connect(scene_graph.get_query_output_port(), camera.query_object_input_port())
        builder.Connect(camera.depth_image_32F_output_port(), mask.get_input_port())
        for port in ("joint_state_measured", "closure_commanded"):
            builder.ExportInput(posture.GetInputPort(port), port)
        builder.ExportOutput(mask.get_output_port(), "robot_mask")
        builder.BuildInto(self)


def _postures(
    plant: MultibodyPlant,
    arm_joints: list[str],
    hand_posture: Mapping[str, tuple[float, float]],
) -> tuple[Ids, Array, Array]:
    arm = np.array([plant.GetJointByName(joint).position_start() for joint in arm_joints])
    q_open = plant.GetPositions(plant.CreateDefaultContext())
    q_closed = q_open.copy()
    for joint, (angle_open, angle_closed) in hand_posture.items():
        index = plant.GetJointByName(joint).position_start()
        q_open[index], q_closed[index] = angle_open, angle_closed
    return arm, q_open, q_closed


def _make_camera(
    config: RobotMaskConfig, scene_graph: SceneGraph, intrinsics: CameraInfo, X_WC: RigidTransform
) -> RgbdSensor:
    clipping = ClippingRange(0.5 * config.range_min, 1.1 * config.range_max)
    core = RenderCameraCore(_RENDERER, intrinsics, clipping, RigidTransform())
    return RgbdSensor(
        parent_id=scene_graph.world_frame_id(),
        X_PB=X_WC,
        color_camera=ColorRenderCamera(core, False),
        depth_camera=DepthRenderCamera(core, DepthRange(config.range_min, config.range_max)),
    )
