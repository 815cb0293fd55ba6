"""Joint encoders on the motors' side of elastic cables."""

from dataclasses import dataclass

import numpy as np

from crossmodal.maths.arrays import Array
from crossmodal.maths.validation import check, number
from crossmodal.systems.sensors.randomness import WhiteNoise, make_generator
from crossmodal.systems.sensors.sampled_sensor import SampledSensor
from crossmodal.systems.ticks import NETWORK_PERIOD


@dataclass(kw_only=True)
class JointEncodersConfig:
    period: float = number(0.005, at_least=1e-4, at_most=1.0, unit="s")  # Between samples.
    # Of the end-effector, per axis.
    offset_rotation: float = number(float(np.deg2rad(3.0)), at_least=0.0, at_most=3.2, unit="rad")
    # Of the end-effector, per axis.
    offset_translation: float = number(0.01, at_least=0.0, at_most=10.0, unit="m")
    # Keeps joint offsets small near singular postures.
    offset_damping: float = number(0.05, at_least=1e-6, at_most=10.0)
    # Of a single joint.
    offset_limit: float = number(float(np.deg2rad(15.0)), above=0.0, at_most=3.2, unit="rad")
    # Amplitude of the error that varies with the joint's angle.
    stretch: float = number(0.001, at_least=0.0, at_most=1.0, unit="rad")
    # Standard deviation.
    noise_position: float = number(1e-4, at_least=0.0, at_most=1.0, unit="rad")
    # Standard deviation.
    noise_velocity: float = number(0.005, at_least=0.0, at_most=100.0, unit="rad/s")


def joint_side_encoders() -> JointEncodersConfig:
    """Of an arm that measures its joints behind the gears: what is left is how it was mastered."""
    return JointEncodersConfig(
        offset_rotation=float(np.deg2rad(0.05)),
        offset_translation=0.0005,
        stretch=5e-5,
        noise_position=2e-5,
        noise_velocity=0.002,
    )


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

    Input ports:
    - `joint_state`: (2 n,), q [rad] and qdot [rad/s].

    Output ports:
    - `joint_state_measured`: (2 n,), the last sample, held.
    - `joint_state_window`: `SampleWindow` of the samples since the last tick, (K, 2 n).

    Frames: E nominal end-effector.

    Source: the offset is the paper's (Martín-Martín and Brock 2017, section VII).
    """

    def __init__(
        self,
        config: JointEncodersConfig,
        J_E_nominal: Array,
        seed: int,
        tick: float = NETWORK_PERIOD,
    ) -> None:
        """Draws the episode's constants.

        Args:
            config: Noise and rates.
            J_E_nominal: Jacobian (6, n) of E's spatial velocity, rotation first, at the posture
                at which the offset has its covariance.
            seed: Of the offset and the noise.
            tick: Period of the network, [s].
        """
        c, name = config, "JointEncoders"
        check(c, name)
        joints = J_E_nominal.shape[1]
        super().__init__("joint_state", "joint_state", 2 * joints, c.period, tick)
        rng = make_generator(seed, "JointEncoders offset")
        self._joints = joints
        self._offset = draw_joint_offset(c, J_E_nominal, rng)
        self._phase = rng.uniform(0.0, 2.0 * np.pi, joints)
        self._stretch = c.stretch
        self._sigma = np.repeat([c.noise_position, c.noise_velocity], joints)
        self._noise = WhiteNoise(seed, "JointEncoders noise", 2 * joints)

    def as_read(self, q: Array) -> Array:
        """What they make of joints (n,) that stand still, [rad], in the first sample."""
        return self.measure(np.append(q, np.zeros(self._joints)), 0)[: self._joints]

    def where_read(self, q_measured: Array) -> Array:
        """Joints (n,) that are read as `q_measured` (n,) but for noise, [rad]."""
        # The stretch hardly differs over the offset's and its own length.
        return q_measured - self._error(q_measured - self._error(q_measured))

    def measure(self, value: Array, index: int) -> Array:
        sample = value + self._sigma * self._noise(index)
        sample[: self._joints] += self._error(value[: self._joints])
        return sample

    def _error(self, q: Array) -> Array:
        """By how much joints (n,) are read too large, [rad]."""
        return np.asarray(self._offset + self._stretch * np.sin(q + self._phase))
