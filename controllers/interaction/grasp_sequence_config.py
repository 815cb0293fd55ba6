"""Times, pressures, gains and limits of a manipulation."""

from dataclasses import dataclass, field

import numpy as np

from maths.validation import require, require_not_negative, require_positive


@dataclass(kw_only=True)
class GraspSequenceConfig:
    period: float = 0.01  # Update period, [s].
    approach_distance: float = 0.10  # Length of the straight approach along z of E, [m].
    approach_time: float = 2.0  # Duration of the approach, [s].
    close_time: float = 1.5  # Time for the hand to close, [s].
    explore_time_limit: float = 25.0  # Time after which exploration ends at the latest, [s].
    travel: float = 0.24  # Way of the hand after which exploration ends at the latest, [m].
    stop_time: float = 1.0  # Time for which the hand holds still at the end, [s].
    # Gauge pressure of index, middle, ring and little, thumb when closed, [Pa].
    closing_pressure: list[float] = field(default_factory=lambda: [6.0e4, 6.0e4, 6.0e4, 8.0e4])
    # Gains of approach and closing.
    stiff_rotation: float = 30.0  # [N m/rad]
    stiff_translation: float = 2000.0  # [N/m]
    stiff_rotation_damping: float = 1.0  # [N m s/rad]
    stiff_translation_damping: float = 80.0  # [N s/m]
    # Gains of exploration: compliant but in the pulling direction (paper, section VII-A).
    compliant_stiffness: float = 0.1  # [N m/rad], [N/m]
    compliant_damping: float = 1.0  # [N m s/rad], [N s/m]
    pull_stiffness: float = 400.0  # [N/m]
    pull_damping: float = 200.0  # [N s/m]
    mass: float = 1.0  # [kg m^2], [kg]
    # Delay from the joint's motion to the hand's stop, by which the goal is anticipated, [s].
    anticipation: float = 0.1
    # Way of the hand from the joint's start, as perceived, at which the return ends, [m].
    return_tolerance: float = 0.002
    return_patience: float = 3.0  # Longest delay of the return after its planned end, [s].
    # A grasp is in doubt while it is believed to have failed and the hand is not where the
    # perceived joint would have taken it. It is then given up, but a return is finished first.
    doubt_time: float = 1.0  # Duration of the doubt after which the grasp is given up, [s].
    failure_probability: float = 0.5  # Least probability of a grasp that has failed.
    slip: float = 0.06  # Least distance between the hand and where the joint would have it, [m].
    # A hand that holds nothing curls up: the grasp is lost once the sealed pressure in every
    # chamber has fallen to this share of what it was around the handle. Around a bar it stays above
    # 0.88; a hand that curls past an edge and pushes it falls to 0.7, as an empty one does.
    empty_pressure: float = 0.8
    retries: int = 2  # Number of times that a lost grasp is tried again.
    retry_distance: float = 0.12  # Largest distance to the handle for another try, [m].
    release_time: float = 4.0  # Time to open, back off and go before the handle again, [s].
    comply: bool = True  # Whether the gains become compliant once the hand has closed.


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
