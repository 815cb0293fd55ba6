"""What a camera should see of a robot, by the robot's model of itself at given joints."""

from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from pydrake.math import RigidTransform
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import Frame, JacobianWrtVariable
from pydrake.systems.sensors import CameraInfo

from crossmodal.maths.arrays import Array, Mask
from crossmodal.systems.sensors.robot_camera import RobotCamera

Labels = npt.NDArray[np.int16]


class ArmChain(NamedTuple):
    """An arm by the names in the robot's model.

    Attributes:
        model: Model instance.
        joints: Names of its joints, in the order of its encoders.
        hand: Model instance of what it carries.
        end_effector: Name of the frame E in the hand's model.
    """

    model: str
    joints: Sequence[str]
    hand: str
    end_effector: str = "end_effector"


class RobotImage(NamedTuple):
    """A rendered image of the robot.

    Attributes:
        depth: (h, w), inf where the robot is not, [m].
        body: Index of the body that is seen (h, w).
        rays_C: (h, w, 3) with z = 1, of the pixels' centres.
    """

    depth: Array
    body: Labels
    rays_C: Array


class Joints(NamedTuple):
    """Where the joints of an arm are, and what they move.

    Attributes:
        p_WE: Of the end-effector (3,), [m].
        jacobian: (6, n), rotation first: velocity of E's body at E, in W.
    """

    p_WE: Array
    jacobian: Array

    def displacements(self, p_W: Array) -> Array:
        """Of points (N, 3) fixed to E's body, per radian of each joint (N, 3, n), [m]."""
        omega, v = self.jacobian[:3], self.jacobian[3:]
        arm = np.cross(omega.T[None], (p_W - self.p_WE)[:, None]).transpose(0, 2, 1)
        return np.asarray(v + arm)


class RobotView:
    """Renders the robot's own model, with nothing else in the scene.

    It holds no state between two calls. A body that other joints move than an arm's, as those of
    a gripper, is not the arm's: nothing says where these are.

    Args:
        build_robot: Adds the robots to a plant, fixed in the world where they believe to stand.
        full: The camera's intrinsics as a renderer takes them.
        X_WC: The camera's believed pose; x right, y down, z forward.
        reduction: The image is smaller by this factor, which divides width and height.
        depth_range: Nearest and farthest surface, [m].

    Raises:
        ValueError: for a factor that does not divide the image's size.
    """

    def __init__(
        self,
        build_robot: Callable[[MultibodyPlant], object],
        full: CameraInfo,
        X_WC: RigidTransform,
        arms: Mapping[str, ArmChain],
        reduction: int = 2,
        depth_range: tuple[float, float] = (0.2, 4.0),
    ) -> None:
        if full.width() % reduction or full.height() % reduction:
            raise ValueError(
                f"RobotView: reduction = {reduction} does not divide the image,"
                f" {full.width()} x {full.height()} px"
            )
        camera = CameraInfo(
            full.width() // reduction,
            full.height() // reduction,
            full.focal_x() / reduction,
            full.focal_y() / reduction,
            full.center_x() / reduction,
            full.center_y() / reduction,
        )
        self._camera = RobotCamera(build_robot, camera, X_WC, depth_range)
        plant = self._plant = self._camera.plant
        self._context = self._camera.CreateDefaultContext()
        self._plant_context = plant.CreateDefaultContext()
        self._rays = _pixel_rays(camera)
        self._chains = {name: _chain(plant, arm) for name, arm in arms.items()}
        self.X_WC = X_WC.GetAsMatrix4()

    def bodies(self, arm: str) -> Mask:
        """Which bodies of the robot's model (b,) are an arm's."""
        return self._chains[arm].bodies

    def carried(self, arm: str) -> Mask:
        """Which bodies are carried by which of an arm's joints (b, n)."""
        return self._chains[arm].carried

    def Pose(self, joints: Mapping[str, Array]) -> dict[str, Joints]:
        """End-effectors and Jacobians.

        Args:
            joints: Positions (n,) of each arm, [rad].
        """
        plant, context = self._plant, self._plant_context
        self._set(joints)
        poses = {}
        for name, chain in self._chains.items():
            J = plant.CalcJacobianSpatialVelocity(
                context,
                JacobianWrtVariable.kV,
                chain.frame,
                np.zeros(3),
                plant.world_frame(),
                plant.world_frame(),
            )
            p_WE = chain.frame.CalcPoseInWorld(context).translation()
            poses[name] = Joints(p_WE, np.asarray(J)[:, chain.velocities])
        return poses

    def Render(self, joints: Mapping[str, Array]) -> RobotImage:
        """What the camera should see; joints of the hands are at zero.

        Args:
            joints: Positions (n,) of each arm, [rad].
        """
        self._set(joints)
        positions = self._plant.GetPositions(self._plant_context)
        self._camera.GetInputPort("positions").FixValue(self._context, positions)
        depth, body = (
            self._camera.GetOutputPort(name).Eval(self._context).data[:, :, 0]
            for name in ("depth_image", "label_image")
        )
        return RobotImage(depth.astype(float), body.copy(), self._rays)

    def _set(self, joints: Mapping[str, Array]) -> None:
        positions = np.zeros(self._plant.num_positions())
        for name, chain in self._chains.items():
            positions[chain.positions] = joints[name]
        self._plant.SetPositions(self._plant_context, positions)


class _Chain(NamedTuple):
    frame: Frame
    positions: list[int]
    velocities: list[int]
    bodies: Mask
    carried: Mask


def _chain(plant: MultibodyPlant, arm: ArmChain) -> _Chain:
    instance = plant.GetModelInstanceByName(arm.model)
    hand = plant.GetModelInstanceByName(arm.hand)
    joints = [plant.GetJointByName(name, instance) for name in arm.joints]
    bodies = np.zeros(plant.num_bodies(), dtype=bool)
    for model in (instance, hand):
        bodies[[int(body) for body in plant.GetBodyIndices(model)]] = True
    carried = np.zeros((plant.num_bodies(), len(joints)), dtype=bool)
    own = {joint.index(): k for k, joint in enumerate(joints)}
    for index in plant.GetJointIndices():
        if plant.get_joint(index).num_velocities() == 0:
            continue
        moved = [int(body) for body in plant.GetBodiesKinematicallyAffectedBy([index])]
        if index in own:
            carried[moved, own[index]] = True
        else:
            bodies[moved] = False
    return _Chain(
        frame=plant.GetFrameByName(arm.end_effector, hand),
        positions=[joint.position_start() for joint in joints],
        velocities=[joint.velocity_start() for joint in joints],
        bodies=bodies,
        carried=carried,
    )


def _pixel_rays(camera: CameraInfo) -> Array:
    """Rays (h, w, 3) through the pixels' centres, which lie at halves for a renderer."""
    u, v = np.meshgrid(np.arange(camera.width()) + 0.5, np.arange(camera.height()) + 0.5)
    x = (u - camera.center_x()) / camera.focal_x()
    y = (v - camera.center_y()) / camera.focal_y()
    return np.dstack([x, y, np.ones_like(x)])
