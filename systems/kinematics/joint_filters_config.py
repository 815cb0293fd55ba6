"""The configuration of the joint filters."""

from dataclasses import dataclass, field

import numpy as np

from maths.validation import require, require_fields
from systems.kinematics.joint_solver.pose_keyframes import FIRST, RECENT
from systems.kinematics.measurement_errors import (
    MeasurementErrorsConfig,
    check_measurement_errors_config,
)


@dataclass(kw_only=True)
class TypePriorsConfig:
    """Prior probabilities of the joint types, above zero; they need not sum to one."""

    prismatic: float = 0.2
    revolute: float = 0.2
    rigid: float = 0.4
    disconnected: float = 0.2


@dataclass(kw_only=True)
class JointFiltersConfig:
    """Priors and memory of the joint filters.

    How jerky a joint's motion may be is not tuned: the configurations are smoothed with each
    density of `process_noise`, and the evidence of a joint type is averaged over them. Where the
    errors are correlated, the present configuration is followed with the density under which the
    newest keyframes are likeliest, so that an even motion is averaged over seconds and a stop is
    followed at once; with white noise it is that under which all keyframes are likeliest.

    Attributes:
        process_noise: Densities S of the child's white acceleration, dv = sqrt(S) dw, [m^2/s^3].
        radius: Of the child itself, [m]: a revolute joint at a distance d moves it by
            sqrt(radius^2 + d^2) per radian.
        speed: Standard deviation of the child's speed before anything was seen, [m/s].
        axis_distance: Standard deviation of an axis' position from the body, per direction, [m].
        walk_translation: Standard deviation of a disconnected body's random walk after one second,
            [m].
        walk_rotation: The same in rotation, [rad].
        type_priors: Of the four joint types.
        errors: Of the measurements, correlated in time.
        memory: Keyframes kept, at least 12.
        coarseness: Share of the motion's mean square that one keyframe may span, in (0, 1).
    """

    process_noise: list[float] = field(default_factory=lambda: [1e-7, 3e-6, 1e-4, 3e-3])
    radius: float = 0.3
    speed: float = 0.1
    axis_distance: float = 0.6
    walk_translation: float = 0.1
    walk_rotation: float = 0.3
    type_priors: TypePriorsConfig = field(default_factory=TypePriorsConfig)
    errors: MeasurementErrorsConfig = field(default_factory=MeasurementErrorsConfig)
    memory: int = 24
    coarseness: float = 0.05


def check_joint_filters_config(config: JointFiltersConfig, owner: str) -> None:
    """Raises ValueError, naming `owner` and the field, where a value is impossible."""
    for unit, names in {
        "m": ("radius", "axis_distance", "walk_translation"),
        "m/s": ("speed",),
        "rad": ("walk_rotation",),
    }.items():
        require_fields(owner, config, names, f"> 0 {unit}", lambda value: value > 0.0)
    types = ("prismatic", "revolute", "rigid", "disconnected")
    priors = config.type_priors
    require_fields(f"{owner}: type_priors", priors, types, "> 0", lambda value: value > 0.0)
    check_measurement_errors_config(config.errors, f"{owner}: errors")
    densities = config.process_noise
    positive = bool(densities) and all(S > 0.0 and np.isfinite(S) for S in densities)
    allowed = "all > 0 m^2/s^3, finite, at least one"
    require(positive, owner, config, "process_noise", allowed)
    least = FIRST + RECENT + 4
    require(config.memory >= least, owner, config, "memory", f">= {least} keyframes")
    require(0.0 < config.coarseness < 1.0, owner, config, "coarseness", "> 0 and < 1")
