"""Times, pressures, gains and limits of a manipulation."""

from dataclasses import dataclass

from crossmodal.maths.validation import number, numbers


@dataclass(kw_only=True)
class GraspSequenceConfig:
    period: float = number(0.01, at_least=1e-4, at_most=1.0, unit="s")  # Update period.
    # Length of the straight approach along z of E.
    approach_distance: float = number(0.10, at_least=0.0, at_most=10.0, unit="m")
    # Duration of the approach.
    approach_time: float = number(3.0, at_least=1e-3, at_most=3600.0, unit="s")
    # Share of it for which the arm stands still and tares what it carries, before friction of its
    # joints and what touches the fingers would be tared as well.
    standing: float = number(1.0 / 3.0, above=0.0, below=1.0)
    # Time for the hand to close.
    close_time: float = number(1.5, at_least=1e-3, at_most=3600.0, unit="s")
    # Time after which exploration ends at the latest.
    explore_time_limit: float = number(25.0, above=0.0, at_most=86400.0, unit="s", infinite=True)
    # Displacement of the hand after which exploration ends at the latest.
    travel: float = number(0.24, above=0.0, at_most=100.0, unit="m", infinite=True)
    # Time for which the hand holds still at the end.
    stop_time: float = number(1.0, at_least=0.0, at_most=3600.0, unit="s")
    # Gauge pressure of index, middle, ring and little, thumb when closed.
    closing_pressure: list[float] = numbers(
        [6.0e4, 6.0e4, 6.0e4, 8.0e4], at_least=0.0, at_most=1e6, unit="Pa", shape=(range(1, 101),)
    )
    # Stiffness about each axis, of approach and closing.
    stiff_rotation: float = number(30.0, at_least=0.0, at_most=1e4, unit="N m/rad")
    # Stiffness along each axis, of approach and closing.
    stiff_translation: float = number(2000.0, at_least=0.0, at_most=1e6, unit="N/m")
    # Damping about each axis, of approach and closing.
    stiff_rotation_damping: float = number(1.0, at_least=0.0, at_most=1e4, unit="N m s/rad")
    # Damping along each axis, of approach and closing.
    stiff_translation_damping: float = number(80.0, at_least=0.0, at_most=1e5, unit="N s/m")
    # Stiffness of exploration, in all but the pulling direction (paper, section VII-A).
    compliant_stiffness: float = number(0.1, at_least=0.0, at_most=1e4, unit="N m/rad or N/m")
    # Damping of exploration, in all but the pulling direction.
    compliant_damping: float = number(1.0, at_least=0.0, at_most=1e4, unit="N m s/rad or N s/m")
    # Stiffness of exploration, in the pulling direction.
    pull_stiffness: float = number(400.0, at_least=0.0, at_most=1e6, unit="N/m")
    # Damping of exploration, in the pulling direction.
    pull_damping: float = number(200.0, at_least=0.0, at_most=1e5, unit="N s/m")
    # Inertia that the hand seems to have, about and along each axis.
    mass: float = number(1.0, at_least=0.0, at_most=1000.0, unit="kg m^2 or kg")
    # Delay from the joint's motion to the hand's stop, by which the goal is anticipated.
    anticipation: float = number(0.1, at_least=0.0, at_most=60.0, unit="s")
    # Displacement of the hand from the joint's start, as perceived, at which the return ends.
    return_tolerance: float = number(0.002, above=0.0, at_most=10.0, unit="m")
    # Longest delay of the return after its planned end.
    return_patience: float = number(3.0, at_least=0.0, at_most=3600.0, unit="s")
    # A grasp is in doubt while it is believed to have failed and the hand is not where the
    # perceived joint would have taken it. It is then given up, but a return is finished first.
    # Duration of the doubt after which the grasp is given up.
    doubt_time: float = number(1.0, at_least=0.0, at_most=3600.0, unit="s")
    # Least probability of a grasp that has failed.
    failure_probability: float = number(0.5, at_least=0.0, at_most=1.0)
    # Least distance between the hand and where the joint would have it.
    slip: float = number(0.06, above=0.0, at_most=10.0, unit="m", infinite=True)
    # A hand that holds nothing curls up: the grasp is lost once the sealed pressure in every
    # chamber has fallen to this share of what it was around the handle. Around a bar it stays above
    # 0.88; a hand that curls past an edge and pushes it falls to 0.7, as an empty one does.
    empty_pressure: float = number(0.8, above=0.0, below=1.0)
    # Most force with which an arm pulls an empty hand.
    empty_pull: float = number(3.0, above=0.0, at_most=1e4, unit="N")
    # Number of times that a lost grasp is tried again.
    retries: int = number(2, at_least=0, at_most=100)
    # Largest distance to the handle for another try.
    retry_distance: float = number(0.12, at_least=0.0, at_most=10.0, unit="m")
    # Time to open, back off and go before the handle again.
    release_time: float = number(4.0, at_least=1e-3, at_most=3600.0, unit="s")
    # Whether a lost grasp is tried again in other ways, without a perceived joint where it was:
    # first closer, then also turned by 90 deg about the approach.
    other_grasps: bool = False
    # How much closer.
    closer: float = number(0.015, at_least=0.0, at_most=1.0, unit="m")
    # Time after which a hand that holds on and has gone less than `give` stops: nothing moves.
    stuck_time: float = number(float("inf"), above=0.0, at_most=3600.0, unit="s", infinite=True)
    # Displacement by which the hand itself gives.
    give: float = number(0.03, at_least=0.0, at_most=1.0, unit="m")
    comply: bool = True  # Whether the gains become compliant once the hand has closed.
