"""What robots know of their surroundings agrees with what they know of themselves."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from pydrake.math import RigidTransform, RotationMatrix

from crossmodal.plants.planning_scene import planning_scene
from crossmodal.plants.robots.arm_with_hand import ArmWithHand, make_arm_with_load
from crossmodal.plants.robots.panda import PANDA_AWAY, PANDA_WITH_CAMERA
from crossmodal.plants.robots.ur5 import UR5_HOME, UR5_WITH_GRIPPER

FACING = RigidTransform(RotationMatrix.MakeZRotation(np.pi), [1.1, 0.0, 0.0])
ROBOTS = [
    ("camera_arm", "camera_hand", PANDA_WITH_CAMERA, RigidTransform(), PANDA_AWAY),
    ("touch_arm", "gripper", UR5_WITH_GRIPPER, FACING, UR5_HOME),
]


@pytest.mark.parametrize(("arm", "hand", "robot", "X_WBase", "q"), ROBOTS, ids=["camera", "touch"])
def test_hands_are_in_the_scene_where_the_arms_alone_have_them(
    arm: str, hand: str, robot: ArmWithHand, X_WBase: RigidTransform, q: np.ndarray
) -> None:
    scene = planning_scene("pose_scene.dmd.yaml")
    plant = scene.plant()
    context = plant.CreateDefaultContext()
    plant.SetPositions(context, plant.GetModelInstanceByName(arm), q)
    E = plant.GetFrameByName("end_effector", plant.GetModelInstanceByName(hand))
    alone = make_arm_with_load(robot, X_WBase)
    own = alone.CreateDefaultContext()
    alone.SetPositions(own, q)
    expected = alone.GetFrameByName("end_effector").CalcPoseInWorld(own)
    assert_allclose(E.CalcPoseInWorld(context).GetAsMatrix4(), expected.GetAsMatrix4(), atol=1e-9)
    assert plant.HasModelInstanceNamed("table")
