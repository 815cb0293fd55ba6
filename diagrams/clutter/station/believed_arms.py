"""What both robots know of their own arms, and how they plan motions by it."""

from collections.abc import Mapping
from dataclasses import dataclass

from crossmodal.controllers.arm.kinematics import ArmModel
from crossmodal.controllers.arm.motion_planner import MotionPlanner
from crossmodal.diagrams.clutter.robot_config import CAMERA_ARM, CAMERA_HAND, GRIPPER, TOUCH_ARM
from crossmodal.diagrams.clutter.station.robot_sensors import RobotSensors
from crossmodal.diagrams.clutter.station.wiring import StationWiring
from crossmodal.maths.arrays import Array
from crossmodal.plants.planning_scene import planning_scene

_ROBOTS = {CAMERA_ARM: (CAMERA_ARM, CAMERA_HAND), TOUCH_ARM: (TOUCH_ARM, GRIPPER)}


@dataclass(frozen=True, kw_only=True)
class BelievedArms:
    """By the names of the arms.

    Attributes:
        arms: The robots' own models.
        planners: Of their motions.
        q_home: Postures in which they begin and end (n,), as their encoders read them, [rad].
    """

    arms: Mapping[str, ArmModel]
    planners: Mapping[str, MotionPlanner]
    q_home: Mapping[str, Array]


def believed_arms(
    wiring: StationWiring, sensors: RobotSensors, homes: Mapping[str, Array]
) -> BelievedArms:
    """What the robots know.

    Args:
        sensors: Of the robots.
        homes: Postures in which the arms begin and end (n,), by their names, [rad].
    """
    scenario = wiring.scenario
    arms = {name: ArmModel(arm.model) for name, arm in wiring.calibration.arms.items()}
    planners = {
        name: MotionPlanner(
            arms[name], planning_scene(scenario.plant.scene), robot, scenario.control.planner
        )
        for name, robot in _ROBOTS.items()
    }
    q_home = {name: sensors.encoders[name].as_read(q) for name, q in homes.items()}
    return BelievedArms(arms=arms, planners=planners, q_home=q_home)
