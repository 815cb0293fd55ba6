"""Synthetic streams of a body's noisy pose while it moves on a known joint.

The parent P is the sensor, at rest. The body's frame B starts 0.8 to 1.2 m from Po in a random
direction with a random orientation; the joint's axis is random. Door and lid: the axis is at the
given radius from Bo, in a random direction normal to it. The configuration grows linearly from zero
at the first frame. Every frame, the first included, is measured as X_PB exp(n), n white and
Gaussian, the same in all rotations and in all translations: the noise acts at the body.
"""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from crossmodal.maths import se3
from crossmodal.maths.arrays import Array
from crossmodal.systems.port_values import JointType

RATE = 15.0  # [Hz]


@dataclass(kw_only=True)
class StreamConfig:
    """One of the nine streams.

    Attributes:
        name: As the tables call it.
        joint_type: Prismatic or revolute.
        radius: From the axis to the body, [m]; without meaning for a prismatic joint.
        final_configuration: At the end of the stream, [m] or [rad].
        duration: [s].
        translation_noise: One standard deviation per direction, [m].
        rotation_noise: The same, [rad].
    """

    name: str
    joint_type: JointType
    radius: float
    final_configuration: float
    duration: float
    translation_noise: float
    rotation_noise: float

    @property
    def covariance(self) -> Array:
        """Of each frame (6, 6), in B."""
        return np.diag(np.repeat([self.rotation_noise**2, self.translation_noise**2], 3))


@dataclass(kw_only=True)
class Stream:
    """A stream and its truth.

    Attributes:
        times: (N,) [s].
        X_PB_measured: (N, 4, 4).
        configuration: (N,) [m] or [rad].
        axis_P: (3,) unit vector in the direction of growing configuration.
        p_PA: (3,) a point of a revolute axis, [m].
        X_PB_reference: (4, 4) true first pose.
    """

    times: Array
    X_PB_measured: Array
    configuration: Array
    axis_P: Array
    p_PA: Array
    X_PB_reference: Array


def stream_configs() -> list[StreamConfig]:
    """The nine streams of the table."""
    joints = [
        ("drawer", JointType.PRISMATIC, 0.0, 0.225, 11.25),
        ("door", JointType.REVOLUTE, 0.35, np.deg2rad(85.0), 30.0),
        ("lid", JointType.REVOLUTE, 0.15, np.deg2rad(100.0), 30.0),
    ]
    noises = [("1 mm", 1e-3, 0.3), ("3 mm", 3e-3, 1.0), ("1 cm", 1e-2, 3.0)]
    return [
        StreamConfig(
            name=f"{joint} {noise}",
            joint_type=joint_type,
            radius=radius,
            final_configuration=float(configuration),
            duration=duration,
            translation_noise=translation,
            rotation_noise=float(np.deg2rad(rotation)),
        )
        for joint, joint_type, radius, configuration, duration in joints
        for noise, translation, rotation in noises
    ]


def _unit_vector(rng: np.random.Generator) -> Array:
    v = rng.normal(size=3)
    return np.asarray(v / np.linalg.norm(v))


def joint_pose(joint_type: JointType, axis: Array, p_PA: Array, q: float) -> Array:
    """The motion (4, 4) of the child in P from configuration zero to q."""
    X = np.eye(4)
    if joint_type == JointType.PRISMATIC:
        X[:3, 3] = axis * q
        return X
    X[:3, :3] = Rotation.from_rotvec(axis * q).as_matrix()
    X[:3, 3] = p_PA - X[:3, :3] @ p_PA
    return X


def simulate_stream(config: StreamConfig, seed: int) -> Stream:
    """One stream, the same for the same seed."""
    rng = np.random.default_rng(seed)
    axis = _unit_vector(rng)
    X0 = np.eye(4)
    X0[:3, :3] = Rotation.random(random_state=rng).as_matrix()
    X0[:3, 3] = rng.uniform(0.8, 1.2) * _unit_vector(rng)
    normal = np.cross(axis, _unit_vector(rng))
    p_PA = X0[:3, 3] + config.radius * normal / np.linalg.norm(normal)
    count = round(config.duration * RATE) + 1
    times = np.arange(count) / RATE
    q = config.final_configuration * times / times[-1]
    scale = np.repeat([config.rotation_noise, config.translation_noise], 3)
    measured = [
        joint_pose(config.joint_type, axis, p_PA, x) @ X0 @ se3.exp(scale * rng.normal(size=6))
        for x in q
    ]
    return Stream(
        times=times,
        X_PB_measured=np.array(measured),
        configuration=q,
        axis_P=axis,
        p_PA=p_PA,
        X_PB_reference=X0,
    )
