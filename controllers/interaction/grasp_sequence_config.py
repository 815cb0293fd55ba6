"""Times, pressures, gains and limits of a manipulation."""

from dataclasses import dataclass, field

import numpy as np

from maths.validation import require, require_not_negative, require_positive


@dataclass(kw_only=True)
class GraspSequenceConfig:
    period: float = 0.01  # Update period, [s].
    approach_distance: float = 0.10  # Length of the straight approach along z of E, [m].
    approach_time: float = 2.0  # [s]
    close_time: float = 1.5  # [s]
    explore_time_limit: float = 25.0  # [s]
    travel: float = 0.24  # Way of the hand after which exploration stops, [m].
    stop_time: float = 1.0  # [s]
    # Gauge pressure of index, middle, ring and little, thumb when closed, [Pa].
    closing_pressure: list[float] = field(default_factory=lambda: [6.0e4, 6.0e4, 6.0e4, 8.0e4])
    # While the hand is guided and closed: stiff. Rotation [N m/rad], translation [N/m].
    stiff_rotation: float = 30.0
    stiff_translation: float = 2000.0
    stiff_rotation_damping: float = 1.0  # [N m s/rad]
    stiff_translation_damping: float = 80.0  # [N s/m]
    # While exploring (crossmodal paper, section VII-A): compliant but in the pulling direction.
    compliant_stiffness: float = 0.1  # [N m/rad], [N/m]
    compliant_damping: float = 1.0  # [N m s/rad], [N s/m]
    pull_stiffness: float = 400.0  # [N/m]
    pull_damping: float = 200.0  # [N s/m]
    mass: float = 1.0  # [kg m^2], [kg]
    anticipation: float = 0.1  # Between the joint's motion and the hand's stop for it, [s].
    # The return ends once the perceived joint is as near as this to its start, as way of the hand.
    return_tolerance: float = 0.002  # [m]
    return_patience: float = 3.0  # How long after the planned end it may still be late, [s].
    # A grasp is given up once it has been doubted so long: when it is believed to have failed and
    # the hand is not where the perceived joint would have taken it. The return is finished first.
    doubt_time: float = 1.0  # [s]
    failure_probability: float = 0.5
    slip: float = 0.06  # [m]
    # A hand that holds nothing curls up: once the sealed pressure in every chamber has fallen to
    # this share of what it was around the handle, the grasp is lost. Around a bar it keeps 0.88 and
    # more; a hand that curls past an edge and pushes it falls to 0.7, as an empty one does.
    empty_pressure: float = 0.8
    retries: int = 2  # How often a lost grasp is tried again,
    retry_distance: float = 0.12  # where the hand is still as near to the handle as this, [m].
    release_time: float = 4.0  # For opening the hand, backing off and going before the handle, [s].
    comply: bool = True  # Whether to switch to the compliant gains once the hand has closed.


def check_grasp_sequence(config: GraspSequenceConfig) -> None:
    """Refuses impossible values.

    Raises:
        ValueError: with the first impossible one.
    """
    name = "GraspSequence"
    times = ("period", "approach_time", "close_time", "release_time")
    require_positive(name, config, dict.fromkeys(times, "s") | {"return_tolerance": "m"})
    for limit, unit in (("explore_time_limit", "s"), ("travel", "m"), ("slip", "m")):
        # Infinite means no limit.
        require(getattr(config, limit) > 0, name, config, limit, f"> 0 {unit}")
    later = ("stop_time", "anticipation", "return_patience", "doubt_time")
    require_not_negative(name, config, dict.fromkeys(later, "s"))
    require_not_negative(name, config, {"approach_distance": "m", "retry_distance": "m"})
    gains = {
        "stiff_rotation": "N m/rad",
        "stiff_translation": "N/m",
        "stiff_rotation_damping": "N m s/rad",
        "stiff_translation_damping": "N s/m",
        "compliant_stiffness": "N/m",
        "compliant_damping": "N s/m",
        "pull_stiffness": "N/m",
        "pull_damping": "N s/m",
        "mass": "kg",
    }
    require_not_negative(name, config, gains | {"retries": ""})
    probability = 0 <= config.failure_probability <= 1
    require(probability, name, config, "failure_probability", "from 0 to 1")
    require(0 < config.empty_pressure < 1, name, config, "empty_pressure", "between 0 and 1")
    pressure = np.asarray(config.closing_pressure)
    possible = pressure.size > 0 and bool(np.all(np.isfinite(pressure) & (pressure >= 0)))
    require(possible, name, config, "closing_pressure", "one gauge pressure a chamber, >= 0 Pa")
