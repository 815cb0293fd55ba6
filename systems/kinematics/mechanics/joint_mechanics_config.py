"""What is supposed of any joint's friction, weight and stops before it is sensed."""

from dataclasses import dataclass

from crossmodal.maths.validation import number
from crossmodal.systems.ticks import Ticked


@dataclass(kw_only=True)
class JointMechanicsConfig(Ticked):
    """Priors; forces are those at the hand, which a hinge's lever turns into torques.

    Attributes:
        friction: Prior standard deviation of Coulomb friction.
        damping: The same of the viscous coefficient.
        unevenness: Standard deviation of the friction along the path, as a share of the joint's.
        mass: Of what moves, against gravity.
        extent: How far its centre may be from the hand, across gravity.
        zero_force: Of a force sensor that was never read while the hand was free; of its torque it
            is that at a lever of `SENSOR_LEVER`.
        stiction: By how much static friction may exceed Coulomb friction, as a share of it.
        least_speed: Of the hand; a slower joint rests.
        slow: Speed of the hand up to which friction may be another one, by as much as the force.
        slack: Displacement at the hand by which a joint may go on at an end stop.
        smoothing: Time constant of a push. A joint has to move for three of them before and after
            an instant that counts.
        open_pressure: Gauge pressure of a chamber, below which the hand is open.
    """

    friction: float = number(20.0, above=0.0, at_most=1e4, unit="N")
    damping: float = number(30.0, above=0.0, at_most=1e5, unit="N s/m")
    unevenness: float = number(0.05, at_least=0.0, at_most=1.0)
    mass: float = number(5.0, at_least=0.0, at_most=1e3, unit="kg")
    extent: float = number(0.2, at_least=0.0, at_most=10.0, unit="m")
    zero_force: float = number(1.0, above=0.0, at_most=100.0, unit="N")
    stiction: float = number(0.2, at_least=0.0, at_most=10.0)
    least_speed: float = number(0.005, above=0.0, at_most=10.0, unit="m/s")
    slow: float = number(0.01, above=0.0, at_most=10.0, unit="m/s")
    slack: float = number(0.002, at_least=0.0, at_most=1.0, unit="m")
    smoothing: float = number(0.2, above=0.0, at_most=10.0, unit="s")
    open_pressure: float = number(5.0e3, at_least=0.0, at_most=1e6, unit="Pa")
