"""Where the camera sees the robot itself, from the robot's model at the measured joints."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt
from pydrake.common.value import AbstractValue, Value
from pydrake.math import RigidTransform
from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.framework import (
    BasicVector,
    Context,
    Diagram,
    DiagramBuilder,
    InputPort,
    LeafSystem,
)
from pydrake.systems.sensors import CameraInfo, ImageDepth32F, ImageGrey8U

from crossmodal.maths.arrays import Array, Ids
from crossmodal.maths.validation import check, number, require
from crossmodal.systems.sensors.robot_camera import RobotCamera

Depth = npt.NDArray[np.float32]


@dataclass(kw_only=True)
class RobotMaskConfig:
    # The silhouette is rendered in an image smaller by this factor.
    reduction: int = number(4, at_least=1, at_most=64)
    # Added around the robot, for its pose is not known exactly.
    margin: float = number(0.03, at_least=0.0, at_most=1.0, unit="m")
    range_min: float = number(0.2, at_least=1e-3, at_most=100.0, unit="m")  # Nearest robot surface.
    # Farthest robot surface.
    range_max: float = number(4.0, at_least=1e-3, at_most=1000.0, unit="m")


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


def nearest_surface(depth: Depth, focal: float, margin: float) -> Depth:
    """Depth (h, w) of the nearest surface within `margin` of each pixel; inf where there is none.

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
    widened = np.full(depth.shape, np.inf, dtype=np.float32)
    for r in np.unique(radius[radius > 0]):
        layer = np.where(radius == r, depth, np.float32(np.inf))
        shape = cv2.MORPH_ELLIPSE if r > 1 else cv2.MORPH_RECT
        disc = cv2.getStructuringElement(shape, (2 * int(r) + 1, 2 * int(r) + 1))
        np.minimum(widened, cv2.erode(layer, disc, borderValue=np.inf), out=widened)
    return widened


def enlarge(image: npt.NDArray[Any], reduction: int) -> npt.NDArray[Any]:
    """Each pixel of an image (h, w) as a block of an image (h reduction, w reduction)."""
    return np.repeat(np.repeat(image, reduction, axis=0), reduction, axis=1)


@dataclass(kw_only=True)
class MaskedRobot:
    """One arm with its hand, by the names that the robot's model of itself has for them.

    Attributes:
        arm: Model instance of the arm.
        arm_joints: Names of the arm's joints, in the order of `joint_state_measured`.
        hand: Model instance of the hand, if it has joints that move with the closure or are
            measured.
        hand_posture: Angles (open, closed) of these joints by name, [rad].
        hand_joints: Names of the hand's joints that have encoders, in the order of
            `hand_positions_measured`; none of a soft hand's.
    """

    arm: str
    arm_joints: Sequence[str]
    hand: str = ""
    hand_posture: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    hand_joints: Sequence[str] = ()


class RobotPosture(LeafSystem):
    """The positions of the robot's whole model, from measured joints and commanded closure.

    A soft hand has no encoders in its fingers: their joints go linearly from the open to the
    closed posture with the commanded closure. Joints of a hand that have encoders are where they
    are measured to be.

    Input ports:
    - `[robot_]joint_state_measured`: (2 n,), q [rad] and qdot [rad/s] of the arm; qdot is not used.
    - `[robot_]closure_commanded`: (1,), 0 open, 1 closed; 0 if not connected.
    - `[robot_]hand_positions_measured`: (m,) of the hand's joints with encoders, [rad] or [m]; only
      of a robot that has some.

    Output ports:
    - `positions_estimated`: (nq,), of the model, [rad] or [m].

    Only where there are several robots, the ports' names begin with theirs.
    """

    def __init__(
        self,
        arms: Mapping[str, Ids],
        hands: Mapping[str, Ids],
        q_open: Array,
        q_closed: Array,
        measured: Mapping[str, Ids] | None = None,
    ) -> None:
        """Keeps the postures.

        Args:
            arms: For each robot, indices (n,) of its arm's joints in the model's positions.
            hands: For each robot, indices of its hand's joints likewise.
            q_open: Positions (nq,) with the hands open.
            q_closed: Positions (nq,) with the hands closed.
            measured: For each robot whose hand has encoders, indices (m,) of these joints likewise.
        """
        super().__init__()
        self._q_open, self._q_closed = q_open, q_closed
        self._robots = []
        self._fingers: list[tuple[Ids, InputPort]] = []
        for name, arm in arms.items():
            prefix = f"{name}_" if len(arms) > 1 else ""
            state = self.DeclareVectorInputPort(f"{prefix}joint_state_measured", 2 * len(arm))
            closure = self.DeclareVectorInputPort(f"{prefix}closure_commanded", 1)
            self._robots.append((arm, hands[name], state, closure))
            fingers = (measured or {}).get(name, np.zeros(0, dtype=int))
            if len(fingers) > 0:
                port = self.DeclareVectorInputPort(f"{prefix}hand_positions_measured", len(fingers))
                self._fingers.append((fingers, port))
        self.DeclareVectorOutputPort("positions_estimated", len(q_open), self._calc)

    def _calc(self, context: Context, output: BasicVector) -> None:
        q = self._q_open.copy()
        for arm, hand, state, port in self._robots:
            closure = port.Eval(context)[0] if port.HasValue(context) else 0.0
            q[hand] += np.clip(closure, 0.0, 1.0) * (self._q_closed - self._q_open)[hand]
            q[arm] = state.Eval(context)[: len(arm)]
        for fingers, port in self._fingers:
            q[fingers] = port.Eval(context)
        output.set_value(q)


class SilhouetteMask(LeafSystem):
    """Turns the robot's rendered depth into a mask of the camera's size, with a margin.

    Input ports:
    - `depth_image`: `ImageDepth32F` of the reduced size, inf where the robot is not.
    - `depth_measured`: `ImageDepth32F` of the camera's size, [m]; what is seen before the robot, by
      more than the margin, is not the robot. If it is not connected, all of the silhouette is.

    Output ports:
    - `robot_mask`: `ImageGrey8U` of the camera's size, 255 robot, 0 elsewhere.
    """

    def __init__(self, config: RobotMaskConfig, reduced: CameraInfo) -> None:
        super().__init__()
        self._config = config
        self._focal = reduced.focal_x()
        width, height = reduced.width(), reduced.height()
        depth = Value[ImageDepth32F](ImageDepth32F(width, height))
        scale = config.reduction
        size = width * scale, height * scale
        measured = Value[ImageDepth32F](ImageDepth32F(*size))
        mask = Value[ImageGrey8U](ImageGrey8U(*size))
        self._depth = self.DeclareAbstractInputPort("depth_image", depth)
        self._measured = self.DeclareAbstractInputPort("depth_measured", measured)
        self.DeclareAbstractOutputPort("robot_mask", mask.Clone, self._calc)

    def _calc(self, context: Context, output: AbstractValue) -> None:
        margin, depth = self._config.margin, self._depth.Eval(context).data[:, :, 0]
        robot = enlarge(nearest_surface(depth, self._focal, margin), self._config.reduction)
        masked = robot < np.inf
        if self._measured.HasValue(context):
            seen = self._measured.Eval(context).data[:, :, 0]
            masked &= ~((seen > 0.0) & (seen < robot - margin))
        output.get_mutable_value().mutable_data[:, :, 0] = np.where(masked, np.uint8(255), 0)


class RobotMask(Diagram):
    """Renders the robot's model of itself, at the measured joints, from the camera's pose.

    What it renders, at a reduced size, is a `RobotCamera`. The joints are measured with an offset,
    hence the margin. Rendered only when read.

    Input ports:
    - `[robot_]joint_state_measured`: (2 n,), q [rad] and qdot [rad/s] of the arm.
    - `[robot_]closure_commanded`: (1,), 0 open, 1 closed; 0 if not connected.
    - `[robot_]hand_positions_measured`: (m,) of the hand's joints with encoders, [rad] or [m]; only
      of a robot that has some.
    - `depth_measured`: `ImageDepth32F` of the camera, [m]; see `SilhouetteMask`.

    Output ports:
    - `robot_mask`: `ImageGrey8U` of the camera's size, 255 robot, 0 elsewhere.

    Only where there are several robots, the inputs' names begin with theirs.

    Frames: P what carries the camera, C camera (x right, y down, z forward).
    """

    def __init__(
        self,
        config: RobotMaskConfig,
        build_robot: Callable[[MultibodyPlant], object],
        intrinsics: CameraInfo,
        X_PC: RigidTransform,
        robots: Mapping[str, MaskedRobot],
        base_frame: str = "world",
    ) -> None:
        """Builds the robot's scene.

        Args:
            config: Size, margin and range.
            build_robot: Adds the robots to a plant and fixes them in the world; it need not
                finalize.
            intrinsics: Of the camera, as the robot knows it.
            X_PC: The camera's calibrated pose.
            robots: By name.
            base_frame: P, a frame of a model (`model::frame`) or the world.
        """
        super().__init__()
        c, name = config, "RobotMask"
        check(c, name)
        divides = not (intrinsics.width() % c.reduction or intrinsics.height() % c.reduction)
        require(divides, name, c, "reduction", "a divisor of the image's width and height")
        require(c.range_min < c.range_max, name, c, "range_max", "> range_min")

        builder = DiagramBuilder()
        reduced = reduced_intrinsics(intrinsics, c.reduction)
        camera = builder.AddNamedSystem(
            "camera",
            RobotCamera(build_robot, reduced, X_PC, (c.range_min, c.range_max), base_frame),
        )
        posture = builder.AddNamedSystem("posture", _posture(camera.plant, robots))
        mask = builder.AddNamedSystem("mask", SilhouetteMask(c, reduced))
        builder.Connect(posture.get_output_port(), camera.GetInputPort("positions"))
        builder.Connect(camera.GetOutputPort("depth_image"), mask.GetInputPort("depth_image"))
        builder.ExportInput(mask.GetInputPort("depth_measured"), "depth_measured")
        for index in range(posture.num_input_ports()):
            port = posture.get_input_port(index)
            builder.ExportInput(port, port.get_name())
        builder.ExportOutput(mask.get_output_port(), "robot_mask")
        builder.BuildInto(self)


def _posture(plant: MultibodyPlant, robots: Mapping[str, MaskedRobot]) -> RobotPosture:
    def indices(model: str, names: Iterable[str]) -> Ids:
        joints = [plant.GetJointByName(name, plant.GetModelInstanceByName(model)) for name in names]
        return np.array([joint.position_start() for joint in joints], dtype=int)

    q_open = plant.GetPositions(plant.CreateDefaultContext())
    q_closed = q_open.copy()
    arms, hands, measured = dict[str, Ids](), dict[str, Ids](), dict[str, Ids]()
    for name, robot in robots.items():
        arms[name] = indices(robot.arm, robot.arm_joints)
        hands[name] = indices(robot.hand, robot.hand_posture)
        measured[name] = indices(robot.hand, robot.hand_joints)
        postures = np.array(list(robot.hand_posture.values())).reshape(-1, 2)
        q_open[hands[name]], q_closed[hands[name]] = postures.T
    return RobotPosture(arms, hands, q_open, q_closed, measured)
