"""What filters are given of cameras and arms, as the robot's calibration has them."""

from crossmodal.diagrams.run.calibration import Calibration
from crossmodal.systems.arm_pose import ArmPose
from crossmodal.systems.depth_camera import DepthCamera, with_shift
from crossmodal.systems.registration.registration_solver import CalibratedArm


def depth_camera(calibration: Calibration) -> DepthCamera:
    """The only camera; its pose is that in what carries it, which may be the world."""
    camera = calibration.camera
    return DepthCamera(
        intrinsics=camera.intrinsics,
        X_WC=camera.X_PC.GetAsMatrix4(),
        pose_covariance=with_shift(
            camera.pose_covariance, camera.intrinsics, camera.registration_std
        ),
        registration_std=camera.registration_std,
        depth_scale_std=camera.depth_scale_std,
        focal_length_std=camera.focal_length_std,
        latency_std=camera.latency_std,
    )


def arm_pose(calibration: Calibration, name: str) -> ArmPose:
    """Where an arm's end-effector is by its joints."""
    arm = calibration.arms[name]
    return ArmPose(arm.model, arm.covariance, arm.joint_offset_std)


def calibrated_arm(calibration: Calibration, name: str) -> CalibratedArm:
    """An arm whose surface a camera may see."""
    arm = calibration.arms[name]
    return CalibratedArm(
        X_WBase=arm.X_WBase.GetAsMatrix4(),
        base_covariance=arm.covariance,
        joint_offset_std=arm.joint_offset_std,
    )
