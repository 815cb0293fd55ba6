"""The soft hand's pneumatics: four chambers of air whose pressure bends the fingers.

A chamber's volume grows as its joints curl, V = V_0 + sum_j r_j theta_j, so its gauge pressure p
acts on joint j as the torque p r_j (virtual work). While the valve is open, a regulator fills the
chamber towards the commanded pressure; once sealed, its air obeys P V = const (isothermal), so that
bending a finger from outside changes the pressure that the sensor reads.
"""

from dataclasses import dataclass

import numpy as np
from pydrake.systems.framework import BasicVector, Context, DiscreteValues, LeafSystem

from crossmodal.maths.arrays import Array
from crossmodal.maths.validation import check, number, numbers

ATMOSPHERE = 101_325.0  # [Pa]


@dataclass(kw_only=True)
class PneumaticHandConfig:
    period: float = number(0.005, at_least=1e-4, at_most=1.0, unit="s")  # Update period.
    # Time constant of the pressure regulator.
    fill_time: float = number(0.15, at_least=1e-3, at_most=60.0, unit="s")
    # Of one straight finger.
    finger_volume: float = number(2.5e-5, at_least=1e-9, at_most=0.1, unit="m^3")
    # Of the straight thumb.
    thumb_volume: float = number(4.0e-5, at_least=1e-9, at_most=0.1, unit="m^3")
    # Volume per angle of a finger's three joints, proximal first.
    finger_rates: list[float] = numbers(
        [3.0e-6, 4.0e-6, 3.0e-6], at_least=0.0, at_most=0.01, unit="m^3/rad"
    )
    # Volume per angle of the thumb's three joints, proximal first.
    thumb_rates: list[float] = numbers(
        [1.2e-5, 9.0e-6, 6.0e-6], at_least=0.0, at_most=0.01, unit="m^3/rad"
    )


def chamber_rates(config: PneumaticHandConfig) -> Array:
    """Volume per joint angle (4, 15), [m^3/rad].

    Chambers: index, middle, ring with little, thumb; joints: index to little, thumb.
    """
    rates = np.zeros((4, 15))
    for finger, chamber in enumerate((0, 1, 2, 2)):
        rates[chamber, 3 * finger : 3 * finger + 3] = config.finger_rates
    rates[3, 12:15] = config.thumb_rates
    return rates


class PneumaticHand(LeafSystem):
    """Chamber pressures and joint torques of the soft hand.

    Input ports:
    - `hand_state`: (30,) angles [rad] and rates [rad/s] of the fifteen finger joints (true).
    - `pressure_commanded`: (4,) gauge pressure that the regulator seeks, [Pa].
    - `sealed`: (1,) above 0.5 the valves are closed.
    - `leaking`: (1,) above 0.5 the air escapes from all chambers; may stay unconnected.

    Output ports:
    - `joint_torques`: (15,) [N m].
    - `cheat_pressure`: (4,) true gauge pressure, [Pa]; the pressure sensor adds its noise.

    State: the product P V of each chamber [J], proportional to its mass of air.
    """

    def __init__(self, config: PneumaticHandConfig) -> None:
        super().__init__()
        check(config, "PneumaticHand")
        self._rates = chamber_rates(config)
        chambers, self._joints = self._rates.shape
        single, thumb = config.finger_volume, config.thumb_volume
        self._volume_straight = np.array([single, single, 2 * single, thumb])
        self._gain = 1.0 - np.exp(-config.period / config.fill_time)
        self._hand_state = self.DeclareVectorInputPort("hand_state", 2 * self._joints)
        self._commanded = self.DeclareVectorInputPort("pressure_commanded", chambers)
        self._sealed = self.DeclareVectorInputPort("sealed", 1)
        self._leaking = self.DeclareVectorInputPort("leaking", 1)
        self.DeclareDiscreteState(ATMOSPHERE * self._volume_straight)
        self._cache = self.DeclareVectorOutputPort(
            "cheat_pressure",
            chambers,
            self._calc_pressure,
            {self.xd_ticket(), self.input_port_ticket(self._hand_state.get_index())},
        )
        self.DeclareVectorOutputPort(
            "joint_torques",
            self._joints,
            self._calc_torques,
            {self.xd_ticket(), self.input_port_ticket(self._hand_state.get_index())},
        )
        self.DeclarePeriodicDiscreteUpdateEvent(config.period, 0.0, self._fill)

    def _volume(self, context: Context) -> Array:
        theta = np.asarray(self._hand_state.Eval(context))[: self._joints]
        return np.maximum(self._volume_straight + self._rates @ theta, 0.2 * self._volume_straight)

    def _calc_pressure(self, context: Context, output: BasicVector) -> None:
        air = np.asarray(context.get_discrete_state_vector().value())
        output.SetFromVector(air / self._volume(context) - ATMOSPHERE)

    def _calc_torques(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(self._rates.T @ np.asarray(self._cache.Eval(context)))

    def _fill(self, context: Context, next_state: DiscreteValues) -> None:
        air = np.asarray(context.get_discrete_state_vector().value())
        leaking = self._leaking.HasValue(context) and self._leaking.Eval(context)[0] > 0.5
        if leaking or np.asarray(self._sealed.Eval(context))[0] < 0.5:
            pressure = 0.0 if leaking else np.asarray(self._commanded.Eval(context))
            air = air + self._gain * ((pressure + ATMOSPHERE) * self._volume(context) - air)
        next_state.get_mutable_vector().SetFromVector(air)
