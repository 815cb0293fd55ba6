"""How far the soft hand has bent since it closed, from the wrist's wrench and chamber pressures."""

from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from pydrake.math import RollPitchYaw
from pydrake.systems.framework import Context

from crossmodal.maths import se3
from crossmodal.maths.arrays import Array
from crossmodal.maths.gaussian import joseph_update
from crossmodal.maths.validation import check, number
from crossmodal.models import WEIGHTS_DIR
from crossmodal.systems.port_values import (
    UNKNOWN_END_EFFECTOR,
    UNKNOWN_LOAD,
    HandLoad,
    PoseBelief,
    SampleWindow,
    no_samples,
)
from crossmodal.systems.proprioception.bending_network import (
    BendingNetwork,
    bending_jacobian,
    load_network,
    predict_bending,
    predict_deviation,
)
from crossmodal.systems.proprioception.bent_hand import screw
from crossmodal.systems.proprioception.hand_config import HandConfig, check_hand
from crossmodal.systems.recursive_filter import RecursiveFilter
from crossmodal.systems.shared_settings import SensorNoise
from crossmodal.systems.ticks import Ticked

GRAVITY = 9.81  # [m/s^2]
CERTAIN = 1e-12  # Variance of a pose that is known by definition, [rad^2, m^2].

# Noise of a tick's mean pressure, as a share of a sample's.
_MEAN_PRESSURE = 0.5


@dataclass(kw_only=True)
class HandBendingConfig(Ticked):
    weights: str = "hand_bending.npz"  # File in models/weights, or an absolute path.
    noise = SensorNoise()
    hand = HandConfig()
    # Random walk of the bending.
    rotation_process_noise: float = number(0.05, at_least=1e-9, at_most=10.0, unit="rad/s^0.5")
    # The same for the translation.
    translation_process_noise: float = number(0.01, at_least=1e-9, at_most=10.0, unit="m/s^0.5")
    # Turning of the hand on the bar that no sensor shows.
    creep: float = number(0.015, at_least=0.0, at_most=10.0, unit="rad/s^0.5")
    # Least standard deviation of the networks.
    rotation_floor: float = number(2.0e-3, at_least=1e-9, at_most=1.0, unit="rad")
    # The same for the translation.
    translation_floor: float = number(3.0e-4, at_least=1e-9, at_most=1.0, unit="m")


def hand_weight(R_WS: Array, mass: float, p_S_com: Array) -> Array:
    """Spatial force F_So_S (6,) of the hand's weight on the sensor, torque then force.

    Args:
        R_WS: Orientation of the sensor (3, 3).
        mass: [kg].
        p_S_com: Centre of mass (3,), [m].
    """
    f_S = R_WS.T @ np.array([0.0, 0.0, -mass * GRAVITY])
    return np.concatenate([np.cross(p_S_com, f_S), f_S])


def load_reading(
    wrench: SampleWindow, pressure: SampleWindow, R_WS: Array, mass: float, p_S_com: Array
) -> Array:
    """Mean wrench without the hand's weight, then mean pressures (10,); the networks' input.

    The sensors' biases are in it.
    """
    load = wrench.values.mean(axis=0) - hand_weight(R_WS, mass, p_S_com)
    return np.append(load, pressure.values.mean(axis=0))


@dataclass(kw_only=True)
class BendingState:
    """The filter's state: log X_EH (6,), the networks' error (6,) and the creep, with covariance.

    It begins at the first instant of the grasp, where H is E.

    Attributes:
        reading: Of this tick (10,), None where there were no samples.
        reference: Reading (10,) at the first instant of the grasp, None before.
        last_reading: The latest (10,), None before the first.
        held: Time since the first instant of the grasp, [s].
        mean: (13,); the networks' error and the creep are in units of their standard deviation.
        covariance: (13, 13).
        load_variances: (6,), see `HandLoad`, of this tick's reading.
    """

    reading: Array | None = None
    reference: Array | None = None
    last_reading: Array | None = None
    held: float = 0.0
    mean: Array = field(default_factory=lambda: np.zeros(13))
    covariance: Array = field(default_factory=lambda: np.diag(np.repeat([CERTAIN, 1.0], [6, 7])))
    load_variances: Array = field(default_factory=lambda: np.zeros(6))


def predict_bending_state(
    mean: Array, covariance: Array, config: HandBendingConfig
) -> tuple[Array, Array]:
    """Constant bending with process noise; the networks' error fades slowly into another."""
    fading = np.exp(-config.period / config.hand.correlation_time)
    F = np.repeat([1.0, fading, 1.0], [6, 6, 1])
    rates = np.repeat([config.rotation_process_noise, config.translation_process_noise], 3)
    Q = np.concatenate([rates**2 * config.period, np.full(6, 1.0 - fading**2), [0.0]])
    return F * mean, F[:, None] * covariance * F + np.diag(Q)


def bending_belief(state: BendingState) -> PoseBelief:
    """X_EH with its covariance in H."""
    J = se3.right_jacobian(state.mean[:6])
    return PoseBelief(X=se3.exp(state.mean[:6]), covariance=J @ state.covariance[:6, :6] @ J.T)


def hand_load(state: BendingState) -> HandLoad:
    """What was read at the state's tick."""
    if state.reading is None:
        return UNKNOWN_LOAD
    return HandLoad(
        F_S=state.reading[:6], pressures=state.reading[6:], variances=state.load_variances
    )


class HandBending(RecursiveFilter):
    """Recursive estimate of the pose of the bent hand relative to the nominal end-effector.

    The hand bends relative to the first instant of the grasp, so there X_EH is the identity by
    definition, whatever the preload that closing has left; until then it stays there. Prediction:
    X_EH constant with process noise. Measurement: two networks, z = f(u - u_0) - f(0) for the
    reading u after u_0 at that instant, with the standard deviation sigma(u - u_0). What the
    networks get wrong at a load they get wrong again at the next tick, so their error is a state
    that fades slowly, z = log X_EH + sigma n + sensor noise: many ticks do not average it away.
    Under a steady pull the fingers also creep: the hand turns on the bar while no reading changes.
    Its variance grows in proportion to time; in sign and size it is a constant of the grasp.

    The reading is the load on the hand, the wrist's wrench without the hand's weight, which turns
    with the hand. A constant bias of the sensors is in u_0 as much as in u, and cancels.

    Input ports:
    - `wrench_window`: `SampleWindow` of F_So_S (6,), torque [N m] then force [N]: what hand and
      object exert on the sensor. A free hand at rest reads its weight and the bias.
    - `pressure_window`: `SampleWindow` of (4,) gauge pressures, [Pa].
    - `end_effector_estimated`: `EndEffectorBelief`, for the direction of the weight.
    - `interaction_active`: (1,) above 0.5 from the instant at which the hand has closed.

    Output ports:
    - `hand_bending_estimated`: `PoseBelief` X_EH, posterior of this tick.
    - `hand_bending_latest`: `PoseBelief` X_EH, posterior of the last tick, from the state alone.
    - `hand_load_estimated`: `HandLoad` of this tick, also while nothing is held.

    Frames: W world, E nominal end-effector, H bent end-effector, S wrist sensor.

    Source: Martín-Martín and Brock, IROS 2017, section IV-B.
    """

    def __init__(self, config: HandBendingConfig, network: BendingNetwork | None = None) -> None:
        super().__init__()
        check(config, "HandBending")
        check_hand(config.hand, "HandBending")
        self._config = config
        self._network = network or load_network(Path(WEIGHTS_DIR, config.weights))
        self._R_ES = RollPitchYaw(*map(float, config.hand.rpy_ES)).ToRotationMatrix().matrix()
        self._p_S_com = np.asarray(config.hand.p_S_com, dtype=float)
        self._creep = config.creep * screw(*config.hand.grasping_axis)
        self._floor = np.repeat([config.rotation_floor, config.translation_floor], 3)
        pressure = _MEAN_PRESSURE * config.noise.pressure
        self._noise = np.append(config.noise.wrench, np.full(4, pressure))
        self._wrench = self._declare_value_input("wrench_window", no_samples(6))
        self._pressure = self._declare_value_input("pressure_window", no_samples(4))
        self._end_effector = self._declare_value_input(
            "end_effector_estimated", UNKNOWN_END_EFFECTOR
        )
        self._active = self.DeclareVectorInputPort("interaction_active", 1)
        self._declare_recursion(BendingState(), self._calc_bending, config.period)
        self._declare_estimated("hand_bending_estimated", bending_belief)
        self._declare_latest("hand_bending_latest", bending_belief)
        self._declare_estimated("hand_load_estimated", hand_load)

    def _calc_bending(self, context: Context, state: BendingState) -> BendingState:
        wrench: SampleWindow = self._read(self._wrench, context)
        pressure: SampleWindow = self._read(self._pressure, context)
        reading = None
        if wrench.times.size > 0 and pressure.times.size > 0:
            R_WS = self._read(self._end_effector, context).X[:3, :3] @ self._R_ES
            mass = self._config.hand.mass
            reading = load_reading(wrench, pressure, R_WS, mass, self._p_S_com)
        last = state.last_reading if reading is None else reading
        variances = np.broadcast_to(wrench.variances, 6)
        now = BendingState(reading=reading, last_reading=last, load_variances=variances)
        if self._read(self._active, context)[0] <= 0.5:
            return now
        if state.reference is None:
            return replace(now, reference=last)
        held = state.held + self._config.period
        mean, covariance = predict_bending_state(state.mean, state.covariance, self._config)
        if reading is not None:
            # With that of what was taken out of the samples.
            common = np.append(variances, np.broadcast_to(pressure.variances, 4))
            noise = np.hypot(self._noise, np.sqrt(common))
            reference = state.reference
            mean, covariance = self._correct(mean, covariance, reading, noise, reference, held)
        return replace(now, reference=state.reference, held=held, mean=mean, covariance=covariance)

    def _correct(
        self,
        mean: Array,
        covariance: Array,
        reading: Array,
        noise: Array,
        reference: Array,
        held: float,
    ) -> tuple[Array, Array]:
        """Corrects by z = log X_EH + deviation * error + creep * constant + white noise.

        The networks read z with a standard deviation that may be the same error at all ticks; the
        creep does not show in the sensors, whose noise passes the network.
        """
        measured = predict_bending(self._network, reading, reference)
        deviation = np.hypot(predict_deviation(self._network, reading, reference), self._floor)
        creep = self._creep * np.sqrt(held)
        J = bending_jacobian(self._network, reading, reference) * noise
        R = J @ J.T + 1e-2 * np.diag(self._floor**2)
        H = np.hstack([np.eye(6), np.diag(deviation), creep[:, None]])
        correction, posterior = joseph_update(covariance, H, R, measured - H @ mean)
        return mean + correction, posterior
