"""How far the soft hand has bent since it closed, from the wrist's wrench and chamber pressures."""

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from pydrake.math import RollPitchYaw
from pydrake.systems.framework import Context

from crossmodal.maths import se3
from crossmodal.maths.arrays import Array
from crossmodal.maths.validation import check, number
from crossmodal.models import WEIGHTS_DIR
from crossmodal.systems.port_values import (
    UNKNOWN_END_EFFECTOR,
    UNKNOWN_LOAD,
    HandLoad,
    PoseBelief,
    SampleWindow,
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

    Attributes:
        reading: Of this tick (10,), None where there were no samples.
        reference: Reading (10,) at the first instant of the grasp, None before.
        last_reading: The latest (10,), None before the first.
        held: Time since the first instant of the grasp, [s].
        mean: (13,); the networks' error and the creep are in units of their standard deviation.
        covariance: (13, 13).
        load_variances: (6,), see `HandLoad`, of this tick's reading.
    """

    reading: Array | None
    reference: Array | None
    last_reading: Array | None
    held: float
    mean: Array
    covariance: Array
    load_variances: Array = field(default_factory=lambda: np.zeros(6))


def start_grasp() -> tuple[Array, Array]:
    """Mean (13,) and covariance (13, 13) at the first instant of the grasp, where H is E."""
    return np.zeros(13), np.diag(np.repeat([CERTAIN, 1.0], [6, 7]))


def predict_bending_state(
    mean: Array, covariance: Array, config: HandBendingConfig
) -> tuple[Array, Array]:
    """Constant bending with process noise; the networks' error fades slowly into another."""
    fading = np.exp(-config.period / config.hand.correlation_time)
    F = np.repeat([1.0, fading, 1.0], [6, 6, 1])
    rates = np.repeat([config.rotation_process_noise, config.translation_process_noise], 3)
    Q = np.concatenate([rates**2 * config.period, np.full(6, 1.0 - fading**2), [0.0]])
    return F * mean, F[:, None] * covariance * F + np.diag(Q)


def correct_bending_state(
    mean: Array, covariance: Array, measured: Array, deviation: Array, creep: Array, R: Array
) -> tuple[Array, Array]:
    """Corrects by z = log X_EH + deviation * error + creep * constant + white noise.

    Args:
        mean: Predicted state (13,), see `BendingState`.
        covariance: Its covariance (13, 13).
        measured: z (6,), what the networks read, [rad, m].
        deviation: Its standard deviation (6,).
        creep: Part of the bending that the sensors do not show (6,), one standard deviation.
        R: Covariance (6, 6) of the white noise, the sensors' through the network.
    """
    H = np.hstack([np.eye(6), np.diag(deviation), creep[:, None]])
    PHt = covariance @ H.T
    K = np.linalg.solve(H @ PHt + R, PHt.T).T
    remainder = np.eye(13) - K @ H
    posterior = remainder @ covariance @ remainder.T + K @ R @ K.T
    return mean + K @ (measured - H @ mean), 0.5 * (posterior + posterior.T)


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
        self._check(config)
        self._config = config
        self._network = network or load_network(Path(WEIGHTS_DIR, config.weights))
        self._R_ES = RollPitchYaw(*map(float, config.hand.rpy_ES)).ToRotationMatrix().matrix()
        self._p_S_com = np.asarray(config.hand.p_S_com, dtype=float)
        self._creep = config.creep * screw(*config.hand.grasping_axis)
        self._floor = np.repeat([config.rotation_floor, config.translation_floor], 3)
        pressure = _MEAN_PRESSURE * config.noise.pressure
        self._noise = np.append(config.noise.wrench, np.full(4, pressure))
        no_wrench = SampleWindow(times=np.zeros(0), values=np.zeros((0, 6)))
        no_pressure = SampleWindow(times=np.zeros(0), values=np.zeros((0, 4)))
        self._wrench = self._declare_value_input("wrench_window", no_wrench)
        self._pressure = self._declare_value_input("pressure_window", no_pressure)
        self._end_effector = self._declare_value_input(
            "end_effector_estimated", UNKNOWN_END_EFFECTOR
        )
        self._active = self.DeclareVectorInputPort("interaction_active", 1)
        mean, covariance = start_grasp()
        initial = BendingState(
            reading=None,
            reference=None,
            last_reading=None,
            held=0.0,
            mean=mean,
            covariance=covariance,
        )
        self._declare_recursion(initial, self._calc_bending, config.period)
        self._declare_estimated("hand_bending_estimated", bending_belief)
        self._declare_latest("hand_bending_latest", bending_belief)
        self._declare_estimated("hand_load_estimated", hand_load)

    @staticmethod
    def _check(config: HandBendingConfig) -> None:
        check(config, "HandBending")
        check_hand(config.hand, "HandBending")

    def _average(self, context: Context) -> Array | None:
        """This tick's reading (10,); None without samples."""
        wrench: SampleWindow = self._read(self._wrench, context)
        pressure: SampleWindow = self._read(self._pressure, context)
        if wrench.times.size == 0 or pressure.times.size == 0:
            return None
        R_WS = self._read(self._end_effector, context).X[:3, :3] @ self._R_ES
        return load_reading(wrench, pressure, R_WS, self._config.hand.mass, self._p_S_com)

    def _calc_bending(self, context: Context, state: BendingState) -> BendingState:
        reading = self._average(context)
        left: SampleWindow = self._read(self._wrench, context)
        variances = np.broadcast_to(left.variances, 6)
        last = state.last_reading if reading is None else reading
        if self._read(self._active, context)[0] <= 0.5:
            mean, covariance = start_grasp()
            return BendingState(
                reading=reading,
                reference=None,
                last_reading=last,
                held=0.0,
                mean=mean,
                covariance=covariance,
                load_variances=variances,
            )
        reference, held = state.reference, 0.0
        if reference is None:
            reference = last
            mean, covariance = start_grasp()
        else:
            held = state.held + self._config.period
            mean, covariance = predict_bending_state(state.mean, state.covariance, self._config)
            if reading is not None:
                noise = self._reading_noise(context)
                mean, covariance = self._correct(mean, covariance, reading, noise, reference, held)
        return BendingState(
            reading=reading,
            reference=reference,
            last_reading=last,
            held=held,
            mean=mean,
            covariance=covariance,
            load_variances=variances,
        )

    def _reading_noise(self, context: Context) -> Array:
        """Standard deviation of this tick's reading (10,), with that of what was taken out."""
        wrench: SampleWindow = self._read(self._wrench, context)
        pressure: SampleWindow = self._read(self._pressure, context)
        common = [np.broadcast_to(w.variances, w.values.shape[1]) for w in (wrench, pressure)]
        return np.asarray(np.hypot(self._noise, np.sqrt(np.concatenate(common))))

    def _correct(
        self,
        mean: Array,
        covariance: Array,
        reading: Array,
        noise: Array,
        reference: Array,
        held: float,
    ) -> tuple[Array, Array]:
        measured = predict_bending(self._network, reading, reference)
        deviation = np.hypot(predict_deviation(self._network, reading, reference), self._floor)
        creep = self._creep * np.sqrt(held)
        J = bending_jacobian(self._network, reading, reference) * noise
        R = J @ J.T + 1e-2 * np.diag(self._floor**2)
        return correct_bending_state(mean, covariance, measured, deviation, creep, R)
