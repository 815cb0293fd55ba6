"""The configuration of the kinematic model."""

from dataclasses import dataclass, field

from crossmodal.maths.validation import number
from crossmodal.systems.kinematics.joint_filters_config import JointFiltersConfig
from crossmodal.systems.ticks import Ticked


@dataclass(kw_only=True)
class KinematicModelConfig(Ticked):
    """Configuration of `KinematicModel`.

    Attributes:
        filters: Of every pair.
        reference_age: How long before a body was first measured its reference may be.
        patience: How long a pair outlives its bodies' measurements.
        max_pairs: Most pairs that are updated in a tick. Those with the static environment always
            are; the others by a schedule.
        transfer_window: How long ago a body may have stood still last, for what is known of another
            one's joint to the environment to be transferred to the joint between the two.
        rest_walk: Standard deviation of how far a parent that is not measured any more has moved
            after one second, and turned by that over `filters.radius`; it is taken to rest for as
            long as it was followed.
        least_probability: Of a joint type, for its prediction to be sent down.
    """

    filters: JointFiltersConfig = field(default_factory=JointFiltersConfig)
    reference_age: float = number(1.0, at_least=1e-3, at_most=3600.0, unit="s")
    patience: float = number(1.0, at_least=0.0, at_most=3600.0, unit="s")
    max_pairs: int = number(10, at_least=1, at_most=100)
    transfer_window: float = number(3.0, at_least=1e-3, at_most=3600.0, unit="s")
    rest_walk: float = number(0.015, at_least=1e-9, at_most=10.0, unit="m")
    least_probability: float = number(0.01, at_least=0.0, at_most=1.0)
