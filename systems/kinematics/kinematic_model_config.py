"""The configuration of the kinematic model."""

from dataclasses import dataclass, field

from maths.validation import require, require_fields
from systems.kinematics.joint_filters_config import JointFiltersConfig


@dataclass(kw_only=True)
class KinematicModelConfig:
    """Configuration of `KinematicModel`.

    Attributes:
        period: Of the ticks, [s].
        filters: Of every pair.
        reference_age: How long before a body was first measured its reference may be, [s].
        patience: How long a pair outlives its bodies' measurements, [s].
        max_pairs: Most pairs at a time; pairs with the static environment come first.
        transfer_window: How long ago a body may have stood still last, for what is known of another
            one's joint to the environment to be transferred to the joint between the two, [s].
        rest_rotation: Standard deviation of how far a parent that is not measured any more has
            turned after one second, [rad]; it is taken to rest for as long as it was followed.
        rest_translation: The same in translation, [m].
        least_probability: Of a joint type, for its prediction to be sent down.
    """

    period: float = 1.0 / 15.0
    filters: JointFiltersConfig = field(default_factory=JointFiltersConfig)
    reference_age: float = 1.0
    patience: float = 1.0
    max_pairs: int = 10
    transfer_window: float = 3.0
    rest_rotation: float = 0.05
    rest_translation: float = 0.01
    least_probability: float = 0.01


def check_kinematic_model_config(config: KinematicModelConfig, owner: str) -> None:
    """Raises ValueError, naming `owner` and the field, where a value is impossible."""
    for unit, names in {
        "s": ("period", "reference_age", "transfer_window"),
        "rad": ("rest_rotation",),
        "m": ("rest_translation",),
    }.items():
        require_fields(owner, config, names, f"> 0 {unit}", lambda value: value > 0.0)
    require(config.patience >= 0.0, owner, config, "patience", ">= 0 s")
    require(config.max_pairs >= 1, owner, config, "max_pairs", ">= 1")
    probable = 0.0 <= config.least_probability <= 1.0
    require(probable, owner, config, "least_probability", "from 0 to 1")
