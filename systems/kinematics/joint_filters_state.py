"""What the joint filters of one pair of bodies know at one measurement, and at the first one."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from crossmodal.maths.arrays import Array
from crossmodal.maths.immutable import Immutable
from crossmodal.systems.kinematics.evidence.covariance_floor import FLOORS
from crossmodal.systems.kinematics.evidence.goodness_of_fit import reduced_chi_square
from crossmodal.systems.kinematics.evidence.type_evidence import NO_GAIN
from crossmodal.systems.kinematics.evidence.wander import NONE, Wander
from crossmodal.systems.kinematics.joint_filters_config import JointFiltersConfig
from crossmodal.systems.kinematics.keyframes.measurement_noise import (
    MeasurementNoise,
    correlations,
    estimated_scale,
    initial_noise,
    observe,
)
from crossmodal.systems.kinematics.keyframes.pose_keyframes import (
    Keyframes,
    append,
    empty_keyframes,
)
from crossmodal.systems.kinematics.measurement_errors import is_correlated, white_equivalent
from crossmodal.systems.kinematics.pose_checks import (
    SkipReason,
)
from crossmodal.systems.kinematics.solver.free_motion import free_motion
from crossmodal.systems.kinematics.solver.joint_geometry import (
    JOINTS,
    PRISMATIC,
    RIGID,
    dimension,
)
from crossmodal.systems.kinematics.solver.joint_models import (
    AXIS_SPREAD,
    Models,
    initial_models,
)
from crossmodal.systems.kinematics.solver.joint_solver import Priors
from crossmodal.systems.kinematics.solver.joint_start import keep_axes
from crossmodal.systems.kinematics.solver.parameter_priors import WIDEST, may_be_far
from crossmodal.systems.port_values import JointFit, JointType

TYPES = (
    JointType.PRISMATIC,
    JointType.REVOLUTE,
    JointType.SCREW,
    JointType.RIGID,
    JointType.DISCONNECTED,
)


@dataclass(kw_only=True)
class JointFiltersState(Immutable):
    """What the filters of one pair know at one measurement.

    Attributes:
        parent_id: See `JointBelief`.
        child_id: See `JointBelief`.
        X_PF: Measured reference pose (4, 4).
        time: Of the last measurement, [s].
        clock: What is added to measurements' times to get the keyframes', [s]; not zero once their
            clock has jumped.
        suspect: Time of the measurement before the next that was far off the last; NaN for none.
        usual: Step between two measurements where they come seldom, [s]; else zero.
        updates: Measurements seen.
        models: Parameters, configuration and evidence of each model.
        keyframes: The measurements, averaged.
        noise: How large the measurements' noise is, and how correlated.
        scale: (6,) standard deviations of the keyframes by those that were reported.
        reported: Covariance (6, 6), in B, that measurements report, their harmonic mean.
        floor_index: In `covariance_floor.FLOORS` of what the keyframes have.
        deviations_index: The same of how large smooth deviations are (`type_evidence`).
        wander: The likeliest smooth error of the rotations; `NONE` if nobody has looked.
        wander_gain: See `type_evidence`.
        believed: The models with the likeliest of the smooth errors that there may be.
        W_zero: See `read_configuration`.
        reference_noise: Covariance (6, 6), in B, of the measured reference.
        zero_time: When q was zero, by the keyframes' clock, [s].
        offset: Covariance (6, 6), in B, of the poses' constant error; not in the keyframes' noise.
        zero_variance: (4,) by how far the child may have moved before the reference, and by how
            many turns while nothing was measured, by each model of a joint.
        reset_count: Of parent and child together (`BodyMotion`).
        skipped: How many measurements were not used, by reason.
        probabilities: Of each type, given all measurements.
    """

    parent_id: int
    child_id: int
    X_PF: Array
    time: float
    models: Models
    keyframes: Keyframes
    noise: MeasurementNoise
    believed: Models
    W_zero: Array
    reference_noise: Array
    zero_time: float
    zero_variance: Array
    clock: float = 0.0
    suspect: float = np.nan
    usual: float = 0.0
    updates: int = 0
    scale: Array = field(default_factory=lambda: np.ones(6))
    reported: Array = field(default_factory=lambda: np.zeros((6, 6)))
    floor_index: int = 0
    deviations_index: int = 0
    wander: Wander = NONE
    wander_gain: Array = field(default_factory=NO_GAIN.copy)
    offset: Array = field(default_factory=lambda: np.zeros((6, 6)))
    reset_count: int = 0
    skipped: Mapping[SkipReason, int] = field(default_factory=dict)
    probabilities: Mapping[JointType, float] = field(default_factory=dict)

    @cached_property
    def fit(self) -> JointFit:
        """How well the most probable type fits the measurements."""
        m, kf, size = self.models, self.keyframes, int(self.keyframes.size[0])
        kind = max(range(len(TYPES)), key=lambda k: self.probabilities[TYPES[k]])
        value, bounds, degrees = reduced_chi_square(kind, m, kf, self.noise)
        scale = estimated_scale(self.noise)
        undecided = float(kf.undecided[:size] @ (1.0 - m.inlier[kind, :size]))
        return JointFit(
            reduced_chi_square=value,
            bounds=bounds,
            degrees=degrees,
            outlier_share=(float(kf.outliers[0]) + undecided) / (self.updates + 1),
            noise_scale=(float(scale[0]), float(scale[3])),
            noise_correlation=float(correlations(self.noise).max()),
            path_floor=FLOORS[self.floor_index],
            wander=float(np.sqrt(kf.wander[0])),
        )


def skip(state: JointFiltersState, reason: SkipReason) -> JointFiltersState:
    """The same state with one more measurement that was not used."""
    skipped = {**state.skipped, reason: state.skipped.get(reason, 0) + 1}
    return replace(state, skipped=skipped)


_FAR = 10.0  # Step of the time that is believed at once, [s],
_SLOWER = 10.0  # or so many times what is usual where poses come seldom.
_MOST = 100.0  # Time that is taken to pass at most while nothing is measured, [s].


def follow_clock(
    state: JointFiltersState, time: float
) -> tuple[JointFiltersState, SkipReason | None]:
    """The state at which a measurement's time follows the last; or with it skipped, and why.

    A single time that is far off is wrong. Where the next one goes on from it, nothing was measured
    for long, or the clock has jumped, which nobody can tell apart: then as much time has passed as
    the clock says, but never more than `_MOST`, by which all is uncertain that may turn.
    """
    if not np.isfinite(time):
        return skip(state, SkipReason.TIME_NOT_FINITE), SkipReason.TIME_NOT_FINITE
    step = time - state.time
    far = max(_FAR, _SLOWER * state.usual) if step > 0.0 else _FAR
    if 0.0 <= step <= far:
        return replace(state, suspect=np.nan), None
    is_far, before = abs(step) > far, state.suspect - state.time  # NaN is on neither side.
    if is_far and before * step > 0.0 and time > state.suspect:
        since = time - state.suspect
        passed = min(step if step > 0.0 else 2.0 * since, _MOST)
        clock = state.clock + passed - step
        found = replace(state, time=time - passed, clock=clock, suspect=np.nan)
        # Where even these two are far from each other, poses come seldom.
        return (replace(found, usual=min(since, _MOST)) if since > far else found), None
    reason = SkipReason.TIME_AHEAD if step > 0.0 else SkipReason.TIME_BACKWARDS
    skipped = skip(state, reason)
    return (replace(skipped, suspect=time) if is_far else skipped), reason


_NO_OUTLIERS = np.zeros(7)
_OUTLIER = np.repeat([1.0, 0.3], 3)  # An outlier may be off by anything: [rad], [m].
_FREE_TURN = 0.3  # Standard deviation of a free body's rotation after one second, [rad].
LEAST_NOISE = 1e-10  # Variance up to which a measurement is exact, [rad^2, m^2].


def solver_priors(config: JointFiltersConfig) -> Priors:
    """The configuration as the compiled solver has it."""
    walk = np.repeat([_FREE_TURN, config.speed], 3)
    velocity = np.repeat([config.speed / config.radius, config.speed], 3) ** 2
    # A free body may change its velocity by its speed within a tenth of a second; or smoothly, so
    # that it begins to move, or changes how it does, within half a second.
    first, noise = [velocity, velocity / 0.5**2], [walk**2, velocity / 0.1, velocity / 0.5**3]
    return Priors(
        process_noise=np.array(config.process_noise),
        jump_noise=config.jump_noise,
        jumps=config.jumps,
        speed=config.speed,
        radius=config.radius,
        axis_distance=config.axis_distance,
        far_axes=config.far_axes,
        hinge_pitch=config.hinge_pitch,
        free=free_motion(np.array(noise), np.array(first)),
        outliers=np.concatenate([[config.outliers], _OUTLIER**2]),
        coarseness=config.coarseness,
        white_share=1.0,
        correlated_share=0.0,
    )


def _per_metre(config: JointFiltersConfig) -> Array:
    """Squared units of q (J,) by which the child moves a metre, by each model; zero if rigid."""
    squares = np.full(JOINTS, config.radius**-2.0)
    squares[[PRISMATIC, RIGID]] = 1.0, 0.0
    return squares


def _rate_variance(config: JointFiltersConfig) -> Array:
    return config.speed**2 * _per_metre(config)


def _initial_models(R: Array, config: JointFiltersConfig) -> Models:
    models = initial_models(config.memory)
    spread = np.array([AXIS_SPREAD] * 2 + [config.axis_distance] * 2 + [WIDEST])
    for kind in range(JOINTS):
        n = dimension(kind)
        models.covariance[kind, :6, :6] = R
        models.covariance[kind, 6:n, 6:n] = np.diag(spread[: n - 6] ** 2)
    models.P[:, 1, 1] = _rate_variance(config)
    models.process_noise[:] = config.unmeasured_process_noise * _per_metre(config)
    return models


def initial_state(
    X_PF: Array,
    covariance: Array,
    error: Array,
    time: float,
    pair: tuple[int, int],
    delay: float,
    config: JointFiltersConfig,
    priors: Priors,
) -> JointFiltersState:
    """The state at the reference; see `JointFilters.start`. The probabilities are still missing.

    Args:
        X_PF: Measured reference (4, 4).
        covariance: Of it (6, 6), finite.
        error: Of all later measurements relative to it (6, 6), finite.
        time: [s].
        pair: Ids of parent and child.
        delay: For so long the child may have moved before, [s].
    """
    keyframes = empty_keyframes(config.memory, priors.free.order.size)
    noise: Array = white_equivalent(covariance, 0.0, config.errors, error)
    R = noise + error
    measured = bool(covariance.max() > LEAST_NOISE)
    keyframes.reference_deviates[0] = float(measured)
    append(keyframes, np.eye(4), R, time, priors.outliers if measured else _NO_OUTLIERS)
    scale = initial_noise()
    observe(scale, np.eye(4), R, time, is_correlated(config.errors))
    models = _initial_models(R, config)
    models.log_evidence[:] = 0.5 * keyframes.log_det[0]
    return JointFiltersState(
        parent_id=pair[0],
        child_id=pair[1],
        X_PF=X_PF.copy(),
        time=time,
        models=models,
        keyframes=keyframes,
        noise=scale,
        believed=models,
        W_zero=np.asarray(np.linalg.inv(R)) if error.any() else np.zeros((6, 6)),
        reference_noise=noise,
        zero_time=time - delay,
        zero_variance=models.P[:, 1, 1] * delay**2,
    )


def rebased_state(
    state: JointFiltersState,
    time: float,
    offset: Array,
    reference_error: Array,
    config: JointFiltersConfig,
) -> JointFiltersState:
    """The state once poses have got a constant error; see `JointFilters.rebase`.

    The probabilities are still those of before.
    """
    noise = state.reference_noise * np.outer(state.scale, state.scale)
    R = noise + offset + reference_error
    keyframes = empty_keyframes(config.memory, state.keyframes.free.size)
    keyframes.outliers[:] = state.keyframes.outliers
    append(keyframes, np.eye(4), R, float(state.keyframes.time[0]), _NO_OUTLIERS)
    wanders = state.keyframes.wander[0] > 0.0
    far = config.far_axes and not wanders and may_be_far(state.keyframes)
    models = keep_axes(state.models, config.axis_distance, far)
    models.P[:, 1, 1] = _rate_variance(config)
    return replace(
        state,
        time=time,
        models=models,
        keyframes=keyframes,
        # The step to the next pose is not due to noise.
        noise=state.noise._replace(seen=np.zeros(1)),
        floor_index=0,
        deviations_index=0,
        wander=NONE,
        wander_gain=NO_GAIN,
        W_zero=np.asarray(np.linalg.inv(R)),
        offset=offset,
    )
