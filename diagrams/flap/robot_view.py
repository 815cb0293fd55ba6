"""The two robots as their camera should see them."""

from pydrake.multibody.plant import MultibodyPlant

from crossmodal.diagrams.flap.robot_config import (
    FINGER,
    FINGER_ARM,
    FINGERTIP,
    HOLDER,
    HOLDER_ARM,
    HOLDER_HAND,
    ROBOTS,
)
from crossmodal.diagrams.run.calibration import Calibration
from crossmodal.plants.camera_view import renderer_intrinsics
from crossmodal.plants.robots.arm_with_hand import add_robot
from crossmodal.plants.robots.lwr import ARM_JOINTS
from crossmodal.systems.registration.robot_view import ArmChain, RobotView

CHAINS = {
    HOLDER: ArmChain(HOLDER_ARM, ARM_JOINTS, HOLDER_HAND),
    FINGER: ArmChain(FINGER_ARM, ARM_JOINTS, FINGERTIP),
}


def add_believed_robots(plant: MultibodyPlant, calibration: Calibration) -> None:
    """Adds both robots where they believe to stand."""
    for chain in CHAINS.values():
        X_WBase = calibration.arms[chain.model].X_WBase
        add_robot(plant, ROBOTS[chain.model], X_WBase, chain.model, chain.hand)


def make_robot_view(calibration: Calibration) -> RobotView:
    """Renders both robots where they believe to stand, from where they believe the camera."""
    camera, intrinsics = calibration.camera, renderer_intrinsics(calibration.camera.intrinsics)

    def build(plant: MultibodyPlant) -> None:
        add_believed_robots(plant, calibration)

    return RobotView(build, intrinsics, camera.X_PC, CHAINS)
