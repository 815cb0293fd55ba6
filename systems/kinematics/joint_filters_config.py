"""The configuration of the joint filters, and what it says of the measurements' errors."""

from dataclasses import dataclass, field, replace

import numpy as np

from maths.arrays import Array
from systems.checks import require, require_fields
from systems.kinematics.joint_solver.pose_keyframes import FIRST, RECENT

_LEAST_NEW = 1e-2  # Of a measurement's variance: whatever of it stays, something is new.
_FLOOR = 1e-12 * np.eye(6)  # [rad^2, m^2], for covariances given as exact.


@dataclass(kw_only=True)
class JointFiltersConfig:
    """Priors and memory of the joint filters.

    The accelerations that a joint may show are not tuned: the filters choose among
    `acceleration_densities` by evidence, so that a smooth motion is averaged over seconds and a
    jerky one is followed.

    A measurement that is another filter's posterior errs alike for a while, so that averaging n of
    them gains less than n. Two settings say so, both off by default (white noise):
    `correlation_time` tau multiplies the covariance of each by (1 + r) / (1 - r), r = exp(-dt/tau),
    which is what an average over much longer than tau is worth; `slow_rotation` and
    `slow_translation` add an error of their own that lasts `slow_time`, as from a biased
    calibration, as 2 slow_time / dt times its covariance. Both make the configuration's covariance
    honest or too large, never too small.

    Attributes:
        acceleration_densities: Of the child, S in dv = sqrt(S) dw, each above zero, [m^2/s^3].
        radius: Of the child itself, [m]: a revolute joint at a distance d moves it by
            sqrt(radius^2 + d^2) per radian.
        speed: Standard deviation of the child's speed before anything was seen, [m/s].
        axis_distance: Standard deviation of an axis' position from the body, per direction, [m].
        walk_translation: Of a disconnected body's free walk after one second, [m].
        walk_rotation: The same in rotation, [rad].
        prior_prismatic: Prior probability, not normalised; likewise the other three.
        prior_revolute: See `prior_prismatic`.
        prior_rigid: See `prior_prismatic`.
        prior_disconnected: See `prior_prismatic`.
        correlation_time: Of the measurements' errors, [s]; zero for white noise.
        slow_rotation: Standard deviation of a slow error in rotation, [rad].
        slow_translation: The same in translation, [m].
        slow_time: How long the slow error lasts, [s].
        lasting_time: How long what a measurement itself calls lasting does, [s]; zero to take it
            for white.
        memory: Keyframes kept, at least 12.
        coarseness: Share of the motion's mean square that one keyframe may span, in (0, 1).
    """

    acceleration_densities: list[float] = field(default_factory=lambda: [1e-7, 3e-6, 1e-4, 3e-3])
    radius: float = 0.3
    speed: float = 0.1
    axis_distance: float = 0.6
    walk_translation: float = 0.1
    walk_rotation: float = 0.3
    prior_prismatic: float = 0.2
    prior_revolute: float = 0.2
    prior_rigid: float = 0.4
    prior_disconnected: float = 0.2
    correlation_time: float = 0.0
    slow_rotation: float = 0.0
    slow_translation: float = 0.0
    slow_time: float = 1.0
    lasting_time: float = 0.0
    memory: int = 24
    coarseness: float = 0.05


def check_joint_filters_config(config: JointFiltersConfig, owner: str) -> None:
    """Raises ValueError, naming `owner` and the field, where a value is impossible."""
    for unit, names in {
        " m": ("radius", "axis_distance", "walk_translation"),
        " m/s": ("speed",),
        " rad": ("walk_rotation",),
        " s": ("slow_time",),
        "": ("prior_prismatic", "prior_revolute", "prior_rigid", "prior_disconnected"),
    }.items():
        require_fields(owner, config, names, f"> 0{unit}", lambda value: value > 0.0)
    for unit, names in {
        "s": ("correlation_time", "lasting_time"),
        "rad": ("slow_rotation",),
        "m": ("slow_translation",),
    }.items():
        require_fields(owner, config, names, f">= 0 {unit}", lambda value: value >= 0.0)
    densities = config.acceleration_densities
    positive = bool(densities) and all(S > 0.0 and np.isfinite(S) for S in densities)
    allowed = "all > 0 m^2/s^3, finite, at least one"
    require(positive, owner, config, "acceleration_densities", allowed)
    least = FIRST + RECENT + 4
    require(config.memory >= least, owner, config, "memory", f">= {least} keyframes")
    require(0.0 < config.coarseness < 1.0, owner, config, "coarseness", "> 0 and < 1")


def has_slow_error(config: JointFiltersConfig) -> bool:
    """Whether the measurements carry a slow error of their own."""
    return config.slow_rotation > 0.0 or config.slow_translation > 0.0


def frame_covariance(
    covariance: Array, dt: float, config: JointFiltersConfig, lasting: Array | None = None
) -> Array:
    """The covariance (6, 6) that one of a stream of measurements `dt` apart counts with.

    Args:
        covariance: Of the measurement (6, 6).
        dt: Since the last one, [s].
        config: Says how long errors stay.
        lasting: The part (6, 6) of the covariance whose error stays for `lasting_time`.
    """
    R = covariance + _FLOOR
    if dt <= 0.0:
        return R
    if config.correlation_time > 0.0:
        r = np.exp(-dt / config.correlation_time)
        R = R * ((1.0 + r) / (1.0 - r))
    if has_slow_error(config):
        slow = np.repeat([config.slow_rotation**2, config.slow_translation**2], 3)
        R = R + np.diag(slow) * max(1.0, 2.0 * config.slow_time / dt)
    if lasting is not None:
        R = R + lasting * max(0.0, 2.0 * config.lasting_time / dt - 1.0)
    return R


def _without_slow_error(config: JointFiltersConfig) -> JointFiltersConfig:
    return replace(config, slow_rotation=0.0, slow_translation=0.0)


def error_shares(
    covariance: Array,
    R: Array,
    dt: float,
    config: JointFiltersConfig,
    lasting: Array | None = None,
) -> tuple[float, float]:
    """Of R from `frame_covariance`: the share that is new at each measurement, and the slow one."""
    if dt <= 0.0:
        return 1.0, 0.0

    def share(part: Array) -> float:
        return float(np.trace(np.linalg.solve(R, part))) / 6.0

    given = share(frame_covariance(covariance, dt, _without_slow_error(config)))
    r = np.exp(-dt / config.correlation_time) if config.correlation_time > 0.0 else 0.0
    stays = max(config.slow_time if has_slow_error(config) else 0.0, config.lasting_time)
    slow = (1.0 - given) * min(1.0, 0.5 * dt / stays) if stays > 0.0 else 0.0
    new = given
    if lasting is not None and config.lasting_time > 0.0:
        new = max(given - share(lasting), _LEAST_NEW * given)
    return new * (1.0 - r) ** 2 / (1.0 + r), given * r * (1.0 - r) / (1.0 + r) + slow
