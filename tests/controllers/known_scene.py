"""The scene with two arms that the tests of planned motions share."""

from functools import cache

import numpy as np
from pydrake.math import RigidTransform, RotationMatrix

from crossmodal.controllers.arm.kinematics import ArmModel
from crossmodal.controllers.arm.motion_planner import MotionPlanner, MotionPlannerConfig
from crossmodal.maths.arrays import Array
from crossmodal.plants.planning_scene import planning_scene
from crossmodal.plants.robots.arm_with_hand import make_arm_with_load
from crossmodal.plants.robots.panda import PANDA_AWAY, PANDA_WITH_CAMERA
from crossmodal.plants.robots.ur5 import UR5_HOME, UR5_WITH_GRIPPER

SCENE = "pose_scene.dmd.yaml"
BASE = RigidTransform(RotationMatrix.MakeZRotation(np.pi), [1.1, 0.0, 0.0])
CAMERA_AWAY = {"camera_arm": PANDA_AWAY}
TOUCH_HOME = {"touch_arm": UR5_HOME}


@cache
def touch_arm() -> ArmModel:
    return ArmModel(make_arm_with_load(UR5_WITH_GRIPPER, BASE))


@cache
def camera_arm() -> ArmModel:
    return ArmModel(make_arm_with_load(PANDA_WITH_CAMERA, RigidTransform()))


def touch_planner(**config: float) -> MotionPlanner:
    planner = MotionPlanner(
        touch_arm(),
        planning_scene(SCENE),
        ("touch_arm", "gripper"),
        MotionPlannerConfig(**config),  # type: ignore[arg-type]
    )
    planner.look_at(CAMERA_AWAY)
    return planner


def camera_planner() -> MotionPlanner:
    robot = ("camera_arm", "camera_hand")
    planner = MotionPlanner(camera_arm(), planning_scene(SCENE), robot)
    planner.look_at(TOUCH_HOME)
    return planner


def pose_at(arm: ArmModel, q: Array) -> Array:
    """X_WE (4, 4)."""
    return arm.Evaluate(np.append(q, np.zeros_like(q))).X_WE.copy()
