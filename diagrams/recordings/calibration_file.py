"""The calibration of a real robot as a YAML file: camera, the arm's base, noise of the sensors."""

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from pydrake.common.eigen_geometry import Quaternion
from pydrake.math import RigidTransform

from crossmodal.diagrams.run.calibration import (
    ArmCalibration,
    Calibration,
    CalibrationErrors,
    Camera,
    calibrated,
    pose_covariance,
    realistic_errors,
)
from crossmodal.diagrams.run.yaml_input.loader import read_yaml
from crossmodal.diagrams.run.yaml_input.schema import ScenarioError, load_typed
from crossmodal.maths.pinhole import Intrinsics
from crossmodal.maths.validation import check, number, numbers
from crossmodal.plants.robots.arm_with_hand import ArmWithHand, make_arm_with_load
from crossmodal.systems.recordings.camera_info import CameraFacts
from crossmodal.systems.shared_settings import SensorNoise

# x of the world is ahead of the camera, y on its left, z up.
_LOOKING_AHEAD = np.array([-0.5, 0.5, -0.5, 0.5])


@dataclass(kw_only=True)
class Placed:
    """A pose in the world W: a position, and a quaternion x, y, z, w."""

    position: np.ndarray = numbers(np.zeros(3), at_least=-100.0, at_most=100.0, unit="m")
    quaternion: np.ndarray = numbers(np.array([0.0, 0.0, 0.0, 1.0]), at_least=-1.0, at_most=1.0)

    def pose(self) -> RigidTransform:
        """X_W of it."""
        x, y, z, w = self.quaternion / np.linalg.norm(self.quaternion)
        return RigidTransform(Quaternion(w, x, y, z), self.position)


@dataclass(kw_only=True)
class RecordedCamera(Placed):
    """The colour camera, whose frame C has x right, y down and z forward.

    Intrinsics of zero are taken from the recording's camera info; so is the distortion.
    """

    quaternion: np.ndarray = numbers(_LOOKING_AHEAD, at_least=-1.0, at_most=1.0)
    width: int = number(0, at_least=0, at_most=8192, unit="px")
    height: int = number(0, at_least=0, at_most=8192, unit="px")
    focal_x: float = number(0.0, at_least=0.0, at_most=1e5, unit="px")
    focal_y: float = number(0.0, at_least=0.0, at_most=1e5, unit="px")
    center_x: float = number(0.0, at_least=-1e5, at_most=1e5, unit="px")
    center_y: float = number(0.0, at_least=-1e5, at_most=1e5, unit="px")
    distortion_model: str = "plumb_bob"  # As in ROS; also rational_polynomial, equidistant.
    distortion: list[float] = field(default_factory=list)  # Coefficients in OpenCV's order.
    depth_scale: float = number(1.0, above=0.0, at_most=1e3)  # Measured depth over true depth.
    # Shift of the depth image against the colour image.
    registration: np.ndarray = numbers(np.zeros(2), at_least=-1e3, at_most=1e3, unit="px")

    def facts(self) -> CameraFacts | None:
        """Intrinsics and distortion; None where the recording says them."""
        if not self.focal_x:
            return None
        intrinsics = Intrinsics(
            width=self.width,
            height=self.height,
            focal_x=self.focal_x,
            focal_y=self.focal_y or self.focal_x,
            center_x=self.center_x,
            center_y=self.center_y,
        )
        if not np.any(self.distortion):
            return CameraFacts(intrinsics=intrinsics)
        return CameraFacts(
            intrinsics=intrinsics,
            distortion_model=self.distortion_model,
            distortion=np.array(self.distortion),
        )


@dataclass(kw_only=True)
class RecordedArm(Placed):
    """The arm's base."""

    joint_offset: float = number(float(np.deg2rad(3.0)), at_least=0.0, at_most=3.2, unit="rad")


@dataclass(kw_only=True)
class RecordedRobot:
    """What is known of a robot's sensors.

    Attributes:
        camera: The colour camera.
        arm: Where its base is, and what its encoders are off by.
        errors: Standard deviations of what this may be off by.
        noise: Of the sensors.
        world: What streams of estimates call the frame in which camera and arm are placed.
    """

    camera: RecordedCamera = field(default_factory=RecordedCamera)
    arm: RecordedArm = field(default_factory=RecordedArm)
    errors: CalibrationErrors = field(default_factory=realistic_errors)
    noise: SensorNoise = field(default_factory=SensorNoise)
    world: str = "world"

    def calibration(
        self, intrinsics: Intrinsics, arm: str, robot: ArmWithHand, camera_frame: str = "camera"
    ) -> Calibration:
        """What the estimators believe of the robot.

        Args:
            intrinsics: Of the images as they are perceived.
            arm: The arm's name.
            robot: Its model.
            camera_frame: What streams of estimates call the camera's optical frame.
        """
        camera = Camera(
            intrinsics=intrinsics,
            X_PC=self.camera.pose(),
            depth_scale=self.camera.depth_scale,
            registration=self.camera.registration,
        )
        model = make_arm_with_load(robot, self.arm.pose())
        believed = ArmCalibration(
            model=model,
            X_WBase=self.arm.pose(),
            covariance=pose_covariance(self.errors.arm_rotation, self.errors.arm_translation),
            joint_offset_std=np.full(model.num_positions(), self.arm.joint_offset),
        )
        return Calibration(
            cameras={camera_frame: calibrated(camera, self.errors)},
            arms={arm: believed},
            noise=self.noise,
            world=self.world,
        )


def read_calibration(path: Path) -> RecordedRobot:
    """The calibration in a file.

    Raises:
        ScenarioError: for unknown keys and impossible values.
    """
    made = load_typed(RecordedRobot, read_yaml(path), str(path))
    try:
        check(made, str(path))
    except ValueError as error:
        raise ScenarioError(str(error)) from None
    for key, placed in (("camera", made.camera), ("arm", made.arm)):
        if not np.linalg.norm(placed.quaternion) > 1e-3:
            raise ScenarioError(f"{path}: {key}.quaternion: need x, y, z, w, not all zero")
    if not made.world.strip("/ "):
        raise ScenarioError(f"{path}: world = '{made.world}', need the name of a frame")
    camera = made.camera
    if camera.focal_x and not (camera.width and camera.height):
        raise ScenarioError(f"{path}: camera: focal_x needs width and height, [px]")
    return made


def as_yaml(facts: CameraFacts | None, width: int, height: int) -> str:
    """A draft to be completed by measuring.

    Args:
        facts: Of the camera; None where the recording does not say them.
        width: Of the images, [px].
        height: Likewise.
    """
    known = facts is not None
    inner = facts.intrinsics if facts is not None else None
    focal = (inner.focal_x, inner.focal_y) if inner else (0.8 * width, 0.8 * width)
    center = (inner.center_x, inner.center_y) if inner else (0.5 * width - 0.5, 0.5 * height - 0.5)
    said = "From the camera info." if known else "A guess: the recording does not say them."
    lines = [
        "camera:",
        "  # Where the camera's optical frame (x right, y down, z forward) is in the world whose z",
        "  # is up, [m]; as it stands here, x of the world is ahead of the camera.",
        "  position: [0, 0, 0]",
        "  quaternion: [-0.5, 0.5, -0.5, 0.5]  # x, y, z, w",
        f"  # {said}",
        f"  width: {width}  # [px]",
        f"  height: {height}",
        f"  focal_x: {focal[0]:.6g}",
        f"  focal_y: {focal[1]:.6g}",
        f"  center_x: {center[0]:.6g}",
        f"  center_y: {center[1]:.6g}",
    ]
    if facts is not None and len(facts.distortion):
        numbers_ = ", ".join(f"{value:.8g}" for value in facts.distortion)
        lines += [f"  distortion_model: {facts.distortion_model}", f"  distortion: [{numbers_}]"]
    lines += [
        "arm:  # Its base in the world.",
        "  position: [0, 0, 0]",
        "  quaternion: [0, 0, 0, 1]",
        "errors:  # Standard deviations of what is written above.",
        "  camera_rotation: 0.5 deg",
        "  camera_translation: 5 mm",
        "  focal_length: 0.005",
        "  depth_scale: 0.005",
        "  latency: 20 ms",
        "  arm_rotation: 0.3 deg",
        "  arm_translation: 3 mm",
    ]
    return "\n".join(lines) + "\n"
