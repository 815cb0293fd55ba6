"""What the robot believes of its cameras and arms, and how a simulation draws the truth around it.

A calibration is a measurement: it is made from a scenario, or for a real robot by hand, never from
the simulation. In a simulation the calibration stands still and the truth varies: per seed, each
camera and each arm is drawn around what is believed of it, with the standard deviations of
`CalibrationConfig.errors`, and nobody who perceives or controls knows.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from pydrake.math import RigidTransform
from pydrake.multibody.plant import MultibodyPlant

from crossmodal.maths import se3
from crossmodal.maths.arrays import Array
from crossmodal.maths.pinhole import Intrinsics
from crossmodal.maths.validation import number
from crossmodal.systems.sensors.randomness import make_generator
from crossmodal.systems.shared_settings import SensorNoise


@dataclass(kw_only=True)
class CalibrationErrors:
    """Standard deviations of what a calibration may be off by; zero is perfect.

    Attributes:
        camera_rotation: Of a camera, about each of its axes.
        camera_translation: Of a camera, along each of its axes.
        focal_length: As a share of it.
        depth_scale: Of all depths, as a share of them.
        registration: Between depth and colour image, along u and v each.
        latency: By how much later than at its stamp an image shows the world. It is drawn from
            the half of a normal distribution: no image is of the future.
        arm_rotation: Of an arm's base, about each of its axes.
        arm_translation: Of an arm's base, along each of its axes.
    """

    camera_rotation: float = number(0.0, at_least=0.0, at_most=0.5, unit="rad")
    camera_translation: float = number(0.0, at_least=0.0, at_most=1.0, unit="m")
    focal_length: float = number(0.0, at_least=0.0, below=0.2)
    depth_scale: float = number(0.0, at_least=0.0, below=0.2)
    registration: float = number(0.0, at_least=0.0, at_most=100.0, unit="px")
    latency: float = number(0.0, at_least=0.0, at_most=1.0, unit="s")
    arm_rotation: float = number(0.0, at_least=0.0, at_most=0.5, unit="rad")
    arm_translation: float = number(0.0, at_least=0.0, at_most=1.0, unit="m")


def realistic_errors() -> CalibrationErrors:
    """What a careful laboratory achieves."""
    return CalibrationErrors(
        camera_rotation=float(np.deg2rad(0.5)),
        camera_translation=0.005,
        focal_length=0.005,
        depth_scale=0.005,
        registration=1.0,
        latency=0.02,
        arm_rotation=float(np.deg2rad(0.3)),
        arm_translation=0.003,
    )


@dataclass(kw_only=True)
class CalibrationConfig:
    """How good the calibration is, and how good the robot takes it to be.

    Attributes:
        errors: With which the simulated truth is drawn around what the robot believes.
        spread: By up to this share each of them is larger or smaller for a seed: what a robot
            takes them to be is never quite right.
        believed: What the robot takes these to be: the covariances of its `Calibration`.
        noise: What the robot takes the noise of its sensors to be.
    """

    errors: CalibrationErrors = field(default_factory=CalibrationErrors)
    spread: float = number(0.0, at_least=0.0, at_most=1.0)
    believed: CalibrationErrors = field(default_factory=realistic_errors)
    noise: SensorNoise = field(default_factory=SensorNoise)

    def drawn_errors(self, seed: int) -> CalibrationErrors:
        """The standard deviations from which a seed's true cameras and arms are drawn."""
        draws = make_generator(seed, "calibration errors").uniform(
            -1.0, 1.0, len(vars(self.errors))
        )
        sizes = zip(vars(self.errors).items(), 1.0 + self.spread * draws, strict=True)
        return CalibrationErrors(**{name: std * size for (name, std), size in sizes})


@dataclass(frozen=True, kw_only=True)
class Camera:
    """A camera as it is, or as it is believed to be.

    Attributes:
        intrinsics: Of the colour image.
        base_frame: `world`, or the scoped name of the frame P that carries the camera.
        X_PC: Pose of C in P; x right, y down, z forward.
        depth_scale: Measured depth over true depth.
        registration: Shift (2,) of the depth image against the colour image, [px].
        latency: How much later than at its stamp an image is delivered, [s].
    """

    intrinsics: Intrinsics
    base_frame: str = "world"
    X_PC: RigidTransform = field(default_factory=RigidTransform)
    depth_scale: float = 1.0
    registration: Array = field(default_factory=lambda: np.zeros(2))
    latency: float = 0.0

    @property
    def is_fixed(self) -> bool:
        """Whether the camera is fixed in the world, so that P is W."""
        return self.base_frame == "world"

    def project(self, p_PF: Array) -> Array:
        """Pixels (N, 2) of points (N, 3) in the frame P; NaN behind the camera."""
        return self.intrinsics.project(self.X_PC.inverse().multiply(np.atleast_2d(p_PF).T).T)


@dataclass(frozen=True, kw_only=True)
class CameraCalibration(Camera):
    """What is believed of a camera, and how well that is known.

    Attributes:
        pose_covariance: (6, 6) of xi in X_PC exp(xi), rotation first, [rad, m].
        focal_length_std: As a share of it.
        depth_scale_std: As a share of it.
        registration_std: [px]
        latency_std: [s]
    """

    pose_covariance: Array = field(default_factory=lambda: np.zeros((6, 6)))
    focal_length_std: float = 0.0
    depth_scale_std: float = 0.0
    registration_std: float = 0.0
    latency_std: float = 0.0


@dataclass(frozen=True, kw_only=True)
class ArmCalibration:
    """What is believed of an arm.

    Attributes:
        model: Finalized plant of the arm alone, the hand a rigid load, its base where it is
            believed to be: the robot's own model, not the simulated plant.
        X_WBase: Where that is.
        covariance: (6, 6) of xi in X_WBase exp(xi), rotation first, [rad, m].
        joint_offset_std: Of each encoder's constant offset (n,), [rad].
    """

    model: MultibodyPlant
    X_WBase: RigidTransform
    covariance: Array
    joint_offset_std: Array


@dataclass(frozen=True, kw_only=True)
class Calibration:
    """What a robot believes of itself: by name its cameras and arms, and its sensors' noise.

    `world` is what viewers are to call the frame in which these stand.
    """

    cameras: Mapping[str, CameraCalibration] = field(default_factory=dict)
    arms: Mapping[str, ArmCalibration] = field(default_factory=dict)
    noise: SensorNoise = field(default_factory=SensorNoise)
    world: str = "world"

    @property
    def camera(self) -> CameraCalibration:
        """The only camera."""
        (camera,) = self.cameras.values()
        return camera

    def camera_of(self, port: str) -> CameraCalibration | None:
        """The camera whose images a port gives; None if no camera is known that may be it.

        It is the only camera, or the one with whose name and `_` the port's name begins.
        """
        if len(self.cameras) == 1:
            return self.camera
        names = [name for name in self.cameras if port.startswith(f"{name}_")]
        return self.cameras[max(names, key=len)] if names else None

    @property
    def arm(self) -> ArmCalibration:
        """The only arm."""
        (arm,) = self.arms.values()
        return arm


def pose_covariance(rotation: float, translation: float) -> Array:
    """(6, 6), rotation first, of standard deviations per axis, [rad] and [m]."""
    return np.diag(np.repeat([rotation, translation], 3) ** 2)


def calibrated(camera: Camera, believed: CalibrationErrors) -> CameraCalibration:
    """What a robot that takes its errors to be `believed` makes of a camera."""
    return CameraCalibration(
        **vars(camera),
        pose_covariance=pose_covariance(believed.camera_rotation, believed.camera_translation),
        focal_length_std=believed.focal_length,
        depth_scale_std=believed.depth_scale,
        registration_std=believed.registration,
        latency_std=believed.latency,
    )


def draw_camera(name: str, believed: Camera, errors: CalibrationErrors, seed: int) -> Camera:
    """The true camera of a seed, drawn around what is believed of it.

    A camera's numbers depend on its name and the seed alone; without errors it is what is believed.
    """
    n = make_generator(seed, f"calibration camera {name}").standard_normal(11)
    focal = 1.0 + errors.focal_length * n[6]
    intrinsics = believed.intrinsics
    return Camera(
        intrinsics=replace(
            intrinsics, focal_x=intrinsics.focal_x * focal, focal_y=intrinsics.focal_y * focal
        ),
        base_frame=believed.base_frame,
        X_PC=_disturbed(believed.X_PC, errors.camera_rotation, errors.camera_translation, n[:6]),
        depth_scale=believed.depth_scale * (1.0 + errors.depth_scale * n[7]),
        registration=believed.registration + errors.registration * n[8:10],
        latency=believed.latency + errors.latency * abs(n[10]),
    )


def draw_base(
    name: str, X_WBase: RigidTransform, errors: CalibrationErrors, seed: int
) -> RigidTransform:
    """Where an arm's base truly stands, likewise."""
    n = make_generator(seed, f"calibration arm {name}").standard_normal(6)
    return _disturbed(X_WBase, errors.arm_rotation, errors.arm_translation, n)


def _disturbed(X: RigidTransform, rotation: float, translation: float, n: Array) -> RigidTransform:
    """X exp(xi) with xi = (rotation n[:3], translation n[3:]); X itself where both are zero."""
    xi = np.repeat([rotation, translation], 3) * n
    if not np.any(xi):
        return X
    return X @ RigidTransform(se3.exp(xi))
