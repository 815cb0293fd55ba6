"""The parts of a station, put together for two arms and two cameras, one of them on a wrist."""

from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.framework import Context, Diagram, DiagramBuilder

from controllers.arm.impedance import ImpedanceConfig
from controllers.arm.kinematics import ArmModel
from diagrams.run.calibration import Camera
from diagrams.run.scenario import CameraConfig, Disturbances, looking_at
from diagrams.stations.add_arm import add_encoders, add_impedance_control, add_wrist_wrench
from diagrams.stations.add_rgbd_camera import add_renderers, add_rgbd_camera, add_robot_mask
from models import SDF_DIR
from plants.hands.soft_hand import CLOSED_POSTURE
from plants.robots.arm_with_hand import add_robot, make_arm_with_load
from plants.robots.wam import ARM_JOINTS, WAM_WITH_SOFT_HAND
from plants.scene import ManipulationScene, ObjectPlacement, PlantConfig, add_manipulation_scene
from systems.sensors.joint_encoders import JointEncodersConfig
from systems.sensors.rgbd_camera import CameraNoiseConfig
from systems.sensors.robot_mask import MaskedRobot, RobotMaskConfig
from systems.sensors.wrist_wrench import WristWrenchConfig

SIDES = {"left": 0.4, "right": -0.4}
Q = np.array([-0.6, 0.9, 0.45, 1.5, -3.65, 0.7, 0.1])
DIRECTIVES = "directives:\n" + "".join(
    f"""
- add_model: {{name: {side}_arm, file: package://crossmodal/wam_arm.sdf}}
- add_model: {{name: {side}_hand, file: package://crossmodal/soft_hand.sdf}}
- add_weld: {{parent: world, child: {side}_arm::base, X_PC: {{translation: [0, {y}, 0.7]}}}}
- add_weld: {{parent: {side}_arm::tool_plate, child: {side}_hand::wrist}}
"""
    for side, y in SIDES.items()
)
INTRINSICS = (
    CameraConfig(width=64, height=48, horizontal_angle=float(np.rad2deg(1.0))).camera().intrinsics
)
# Nearly perfect, so that the mask can be compared with what is there.
ENCODERS = JointEncodersConfig(offset_rotation=1e-6, offset_translation=1e-6, stretch=0.0)
CAMERAS = {
    "fixed": Camera(
        intrinsics=INTRINSICS, X_PC=looking_at(np.array([-0.6, 1.2, 1.6]), np.array([0.6, 0, 1]))
    ),
    "wrist": Camera(
        intrinsics=INTRINSICS,
        X_PC=RigidTransform(RotationMatrix.MakeXRotation(-0.5), [0.0, -0.15, -0.05]),
        base_frame="right_arm::tool_plate",
    ),
}


def build_robots(plant: MultibodyPlant) -> None:
    for side, y in SIDES.items():
        X_WBase = RigidTransform([0, y, 0.7])
        add_robot(plant, WAM_WITH_SOFT_HAND, X_WBase, f"{side}_arm", f"{side}_hand")


class Built:
    """The station and where its arms are put."""

    def __init__(self, folder: Path) -> None:
        path = folder / "two.dmd.yaml"
        path.write_text(DIRECTIVES)
        builder = DiagramBuilder()
        drawer = ObjectPlacement(
            model=SDF_DIR / "chest_drawer.sdf", X_WO=RigidTransform([3.0, 0, 0.9])
        )
        self.scene: ManipulationScene = add_manipulation_scene(
            builder,
            PlantConfig(scene=str(path)),
            {"drawer": drawer},
            [(f"{side}_arm", f"{side}_hand") for side in SIDES],
        )
        plant, scene_graph = self.scene.plant, self.scene.scene_graph
        encoders = {}
        for side in SIDES:
            arm, hand = (self.scene.model(f"{side}_{part}") for part in ("arm", "hand"))
            alone = make_arm_with_load(WAM_WITH_SOFT_HAND, self.scene.pose("base", f"{side}_arm"))
            encoders[side] = add_encoders(builder, plant, arm, alone, Q, ENCODERS, 3, side)
            sensor = plant.GetFrameByName("sensor", hand)
            add_wrist_wrench(builder, plant, sensor, WristWrenchConfig(), 3, side)
            add_impedance_control(
                builder, plant, arm, encoders[side], ArmModel(alone), ImpedanceConfig(), Q, side
            )
        postures = {joint: (0.0, closed) for joint, closed in CLOSED_POSTURE.items()}
        robots = {
            side: MaskedRobot(
                arm=f"{side}_arm",
                arm_joints=ARM_JOINTS,
                hand=f"{side}_hand",
                hand_posture=postures,
            )
            for side in SIDES
        }
        add_renderers(scene_graph)
        for name, camera in CAMERAS.items():
            noise = CameraNoiseConfig(exposure_period=1e3)
            add_rgbd_camera(
                builder, plant, scene_graph, camera, noise, Disturbances(), 3, 1.0 / 15.0, name
            )
            config = RobotMaskConfig(margin=0.01, reduction=1, range_min=0.1)
            mask = add_robot_mask(builder, build_robots, camera, robots, config, name)
            for side in SIDES:
                port = mask.GetInputPort(f"{side}_joint_state_measured")
                builder.Connect(encoders[side].GetOutputPort("joint_state_measured"), port)
        self.diagram: Diagram = builder.Build()

    def at(self, **q: np.ndarray) -> Context:
        """The station as it is initialized with its arms there."""
        root = self.diagram.CreateDefaultContext()
        plant = self.scene.plant
        context = plant.GetMyMutableContextFromRoot(root)
        for side in SIDES:
            plant.SetPositions(context, self.scene.model(f"{side}_arm"), q[side])
        self.diagram.ExecuteInitializationEvents(root)
        return root

    def mask(self, root: Context, camera: str) -> np.ndarray:
        port = self.diagram.GetOutputPort(f"{camera}_robot_mask")
        return np.array(port.Eval(root).data[:, :, 0]) == 255

    def true_depth(self, root: Context, camera: str) -> np.ndarray:
        sensor = self.diagram.GetSubsystemByName(f"{camera}_rgbd_sensor")
        image = sensor.depth_image_32F_output_port().Eval(sensor.GetMyContextFromRoot(root))
        return np.array(image.data[:, :, 0])


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> Built:
    return Built(tmp_path_factory.mktemp("two"))


def test_each_arm_and_each_camera_has_ports_of_its_own(built: Built) -> None:
    for side in SIDES:
        for port in ("joint_state_window", "wrench_window"):
            assert built.diagram.HasOutputPort(f"{side}_{port}")
    for camera in CAMERAS:
        for port in ("color_measured", "depth_measured", "robot_mask"):
            assert built.diagram.HasOutputPort(f"{camera}_{port}")


def test_two_sensors_of_a_kind_do_not_err_alike(built: Built) -> None:
    root = built.at(left=Q, right=Q)
    left, right = (
        built.diagram.GetOutputPort(f"{side}_joint_state_window").Eval(root).values[0]
        for side in SIDES
    )
    assert np.all(left != right)
    assert_allclose(left[:7], Q, atol=1e-2)
    assert_allclose(right[:7], Q, atol=1e-2)


def test_a_camera_on_the_wrist_goes_with_it_and_so_does_the_mask_of_its_hand(built: Built) -> None:
    moved = Q + np.array([0.4, -0.3, 0.2, 0.3, 0.5, -0.2, 0.3])
    depths = []
    for q in (Q, moved):
        root = built.at(left=Q, right=q)
        depth = built.true_depth(root, "wrist")
        hand = depth < 0.25
        assert 0.02 < hand.mean() < 0.9
        assert built.mask(root, "wrist")[hand].all()
        depths.append(np.where(hand, depth, np.inf))
    assert_allclose(depths[0], depths[1], atol=1e-3)


def test_the_fixed_camera_sees_both_robots_move(built: Built) -> None:
    masks = [
        built.mask(built.at(left=left, right=right), "fixed")
        for left, right in ((Q, Q), (Q + 0.3, Q), (Q, Q + 0.3))
    ]
    assert all(mask.any() for mask in masks)
    assert (masks[0] != masks[1]).any()
    assert (masks[0] != masks[2]).any()
