"""Joint encoders on the motors' side of elastic cables."""

from dataclasses import dataclass

import numpy as np

from maths.arrays import Array
from maths.validation import require
from systems.sensors.randomness import WhiteNoise, make_generator
from systems.sensors.sampled_sensor import SampledSensor


@dataclass(kw_only=True)
class JointEncodersConfig:
    period: float = 0.005  # Between samples, [s].
    tick: float = 1.0 / 15.0  # Between the network's ticks, [s].
    offset_rotation: float = float(np.deg2rad(3.0))  # Of the end-effector, per axis, [rad].
    offset_translation: float = 0.01  # Of the end-effector, per axis, [m].
    offset_damping: float = 0.05  # Keeps joint offsets small near singular postures, [-].
    offset_limit: float = float(np.deg2rad(15.0))  # Of a single joint, [rad].
    stretch: float = 0.001  # Amplitude of the error that varies with the joint's angle, [rad].
    noise_position: float = 1e-4  # Standard deviation, [rad].
    noise_velocity: float = 0.005  # Standard deviation, [rad/s].


def draw_joint_offset(
    config: JointEncodersConfig, J_E: Array, rng: np.random.Generator, candidates: int = 256
) -> Array:
    """Joint offsets (n,) [rad] that put the end-effector off by a random pose error.

    delta_q = J^T (J J^T + damping^2)^-1 e with e ~ N(0, diag(rotation^2, translation^2)), redrawn
    while a joint is beyond the limit. If none of the candidates keeps the limit, the one that
    exceeds it least is scaled down to it.

    Args:
        config: Standard deviations, damping and limit.
        J_E: Jacobian (6, n) of the end-effector's spatial velocity at the nominal posture.
        rng: Source of randomness.
        candidates: Number of draws.
    """
    scale = np.repeat([config.offset_rotation, config.offset_translation], 3)
    gram = J_E @ J_E.T + config.offset_damping**2 * np.eye(6)
    errors = scale * rng.standard_normal((candidates, 6))
    offsets = errors @ np.linalg.solve(gram, J_E)
    largest = np.abs(offsets).max(axis=1)
    within = np.flatnonzero(largest <= config.offset_limit)
    if within.size:
        return np.asarray(offsets[within[0]])
    least = int(largest.argmin())
    return np.asarray(offsets[least] * config.offset_limit / largest[least])


class JointEncoders(SampledSensor):
    """Measures joint angles where the motors are, not where the links are.

    q_measured = q + offset + stretch sin(q + phase) + noise; offset and phase are constants that
    the seed draws once per episode, so that the end-effector's pose at the nominal posture is off
    by 1 cm and 3 deg (1 sigma per axis), as on an arm that is driven by cables. Velocities are
    noisy but carry no offset. The offsets of the wrist's joints are then 4 to 6 deg (1 sigma): a
    wrist that turns the hand by 3 deg about each axis has to.

    .. pydrake_system::

        name: JointEncoders
        input_ports:
        - joint_state
        output_ports:
        - joint_state_measured
        - joint_state_window

    - `joint_state`: (2 n,), q [rad] and qdot [rad/s].
    - `joint_state_measured`: (2 n,), the last sample, held.
    - `joint_state_window`: `SampleWindow` of the samples since the last tick, (K, 2 n).

    Frames: E nominal end-effector.

    Source: the offset is the paper's (Martín-Martín and Brock 2017, section VII).
    """

    def __init__(self, config: JointEncodersConfig, J_E_nominal: Array, seed: int) -> None:
        """Draws the episode's constants.

        Args:
            config: Noise and rates.
            J_E_nominal: Jacobian (6, n) of E's spatial velocity, rotation first, at the posture
                at which the offset has its covariance.
            seed: Of the offset and the noise.
        """
        c, name = config, "JointEncoders"
        require(0 < c.period < np.inf, name, c, "period", "> 0 s")
        require(c.period <= c.tick < np.inf, name, c, "tick", ">= period, in s")
        require(0 <= c.offset_rotation < np.inf, name, c, "offset_rotation", ">= 0 rad")
        require(0 <= c.offset_translation < np.inf, name, c, "offset_translation", ">= 0 m")
        require(0 < c.offset_damping < np.inf, name, c, "offset_damping", "> 0")
        require(0 < c.offset_limit < np.inf, name, c, "offset_limit", "> 0 rad")
        require(0 <= c.stretch < np.inf, name, c, "stretch", ">= 0 rad")
        require(0 <= c.noise_position < np.inf, name, c, "noise_position", ">= 0 rad")
        require(0 <= c.noise_velocity < np.inf, name, c, "noise_velocity", ">= 0 rad/s")
        joints = J_E_nominal.shape[1]
        super().__init__("joint_state", "joint_state", 2 * joints, c.period, c.tick)
        rng = make_generator(seed, "JointEncoders offset")
        self._joints = joints
        self._offset = draw_joint_offset(c, J_E_nominal, rng)
        self._phase = rng.uniform(0.0, 2.0 * np.pi, joints)
        self._stretch = c.stretch
        self._sigma = np.repeat([c.noise_position, c.noise_velocity], joints)
        self._noise = WhiteNoise(seed, "JointEncoders noise", 2 * joints)

    def measure(self, value: Array, index: int) -> Array:
        sample = value + self._sigma * self._noise(index)
        q = value[: self._joints]
        sample[: self._joints] += self._offset + self._stretch * np.sin(q + self._phase)
        return sample
