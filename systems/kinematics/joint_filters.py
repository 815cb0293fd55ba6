"""The joint models of one pair of bodies: prismatic, revolute, screw, rigid and disconnected.

A smoother over pose keyframes rather than a plain recursive filter. Each update finds, for every
model, the maximum a posteriori estimate of the joint's parameters and of its configurations at all
keyframes, linearised anew around the last solution, and the model's evidence by Laplace's
approximation. Measurements are averaged into a bounded number of keyframes; where averaging would
lose what the motion has shown, an old keyframe is marginalised, and leaves a Gaussian prior of the
parameters and its share of the evidence.

The reported covariance of the measurements is a prior. How large their noise is, and whether it is
correlated in time, follows from the stream itself (`measurement_noise`). Errors that do not average
out, and how far the path is from an ideal joint's, follow from the evidence (`covariance_floor`);
so do rotations that err smoothly by more than is reported (`wander`). A
measurement that is far off is an outlier with a probability (`outliers`). Where no joint explains
the motion, a free one wins (`free_motion`), and the distance of the measurements from its path
limits the probability of a joint (`goodness_of_fit.largest_probability`).

The filters work without Drake:

    filters = JointFilters(JointFiltersConfig())
    state = filters.start(X_PB, covariance, time)
    for X_PB, covariance, time in measurements:
        state = filters.update(state, X_PB, covariance, time)
    belief = filters.belief(state)
    print(belief.type, belief.probabilities[belief.type], belief.model.configuration)

`start` takes the first pose as the reference, where the configuration is zero. A state is never
changed in place. `predict` is where a model expects the child next; `rebase` goes on when the
child's pose has got a constant error.

A measurement that cannot be true, as with NaN, a covariance that is none or a time before the last,
is skipped: the state stays as it was, and `skipped` of state and belief counts it by its reason.
Two measurements of one instant are fine unless they are the same. A tracker that is read more often
than it measures sends the same pose again and again, which is one measurement. An array of another
shape is a `ValueError`, and so is a bad first measurement.

Frames: P parent, B child, F the child's measured reference pose. All covariances of poses are right
perturbations in B, rotation [rad] before translation [m].
"""

from dataclasses import replace

import numpy as np

from crossmodal.maths import se3
from crossmodal.maths.arrays import Array
from crossmodal.maths.validation import check
from crossmodal.systems.kinematics.evidence.covariance_floor import (
    covariance_floor,
    with_likelier_floor,
)
from crossmodal.systems.kinematics.evidence.goodness_of_fit import (
    largest_probability,
    reported_probabilities,
)
from crossmodal.systems.kinematics.evidence.likelier_errors import (
    likelier_deviations,
    likelier_wander,
)
from crossmodal.systems.kinematics.evidence.type_evidence import type_evidence
from crossmodal.systems.kinematics.evidence.wander import COUNT, SIZES
from crossmodal.systems.kinematics.joint_filters_config import JointFiltersConfig, TypePriorsConfig
from crossmodal.systems.kinematics.joint_filters_state import (
    LEAST_NOISE,
    TYPES,
    JointFiltersState,
    follow_clock,
    initial_state,
    rebased_state,
    skip,
    solver_priors,
)
from crossmodal.systems.kinematics.keyframes.measurement_noise import (
    MEASURED,
    MeasurementNoise,
    correlations,
    estimated_scale,
    inflation,
    mean_covariance,
    observe,
)
from crossmodal.systems.kinematics.keyframes.pose_keyframes import (
    copy_keyframes,
    rescale,
)
from crossmodal.systems.kinematics.measurement_errors import (
    EXACT,
    correlated_shares,
    error_shares,
    is_correlated,
    white_equivalent,
)
from crossmodal.systems.kinematics.pose_checks import (
    SkipReason,
    covariance_array,
    covariance_fault,
    finite,
    pose_array,
    pose_fault,
    time_fault,
)
from crossmodal.systems.kinematics.solver.free_motion import explain_pending
from crossmodal.systems.kinematics.solver.joint_geometry import (
    FREE,
    MOVING,
    PRISMATIC,
    REVOLUTE,
    SCREW,
    turns,
)
from crossmodal.systems.kinematics.solver.joint_models import Models
from crossmodal.systems.kinematics.solver.joint_readout import (
    nearest,
    predict_pose,
    predicted_configuration,
    read_moving,
)
from crossmodal.systems.kinematics.solver.joint_update import update as update_models
from crossmodal.systems.kinematics.solver.parameter_priors import pitch_posterior
from crossmodal.systems.port_values import JointBelief, JointModelBelief, JointType, PoseBelief

_WELL_KNOWN = 0.1  # Standard deviation above which each update tries a fresh start, [rad].
_RESTART_EVERY = 16  # Updates between fresh starts where the axis is better known than that.
_ALL_MODELS_EVERY = 4  # Updates between solutions of all models (`joint_update.solve_all`).
_OFTEN = 24  # A floor is tried at each of so many such solutions, later at every third.
_CERTAIN = 0.9  # Probability that is only reported of models that have all been solved for it.
_RESCALE = 0.05  # Relative change of the noise's scale from which the keyframes follow it.
_UNSEEN = 1.0  # Shorter steps are never lost by a turn, [s].
_HALF_A_TURN = 0.5 * np.pi  # Standard deviation from which on a rate predicts nothing, [rad].
_TELLING = 3.0  # Standard deviations by which a screw climbs per turn if that is seen.
_SAME_POSE = 1e-12  # Largest difference between two copies of one measurement.


def _log_prior(p: TypePriorsConfig) -> Array:
    return np.log([p.prismatic, p.revolute, p.screw, p.rigid, p.disconnected])


class JointFilters:
    """Starts, updates and reads the joint models of any number of pairs; see the module.

    It holds constants only; a pair's keyframes and models are in its `JointFiltersState`.

    Args:
        owner: Named in errors about it.
    """

    def __init__(self, config: JointFiltersConfig, owner: str = "JointFilters") -> None:
        check(config, owner)
        self.config = config
        self._owner = owner
        self._priors = solver_priors(config)
        self._correlated = is_correlated(config.errors)
        self._may_wander = config.errors.wander > 0.0 and not self._correlated
        odds = config.errors.wander / (1.0 - config.errors.wander) / COUNT
        self._wander_odds = float(np.log(odds)) if self._may_wander else -np.inf
        self._log_prior = _log_prior(config.ranking_priors)
        self._log_prior_of_reports = _log_prior(config.type_priors)

    def start(
        self,
        X_PB_reference: Array,
        covariance: Array,
        time: float,
        parent_id: int = 0,
        child_id: int = 1,
        reference_error: Array | None = None,
        delay: float = 0.0,
    ) -> JointFiltersState:
        """The state at the reference, where q is zero.

        Args:
            X_PB_reference: Measured (4, 4).
            covariance: Of that measurement (6, 6), in B; zero where it is exact, infinite on the
                diagonal where nothing was measured, as a rotation.
            time: Of the reference, [s].
            reference_error: Covariance (6, 6), in B, of a constant error of all later measurements
                relative to the reference, as from a grip that settles; none if None. It displaces
                the path; q is still counted from the measured reference.
            delay: For so long the child may have moved before, [s]; q is zero up to that.

        Raises:
            ValueError: for arrays of other shapes, and for what cannot be true.
        """
        owner = f"{self._owner}.start"
        X_PF = pose_array(X_PB_reference, "X_PB_reference", owner)
        covariance = covariance_array(covariance, "covariance", owner)
        reference_error = np.zeros((6, 6)) if reference_error is None else reference_error
        error = covariance_array(reference_error, "reference_error", owner)
        fault = pose_fault(X_PF) or covariance_fault(covariance) or covariance_fault(error)
        if not (np.isfinite(time) and np.isfinite(delay)):
            fault = fault or SkipReason.TIME_NOT_FINITE
        if fault is not None:
            raise ValueError(f"{owner}: {fault}; start at the first measurement without a fault")
        state = initial_state(
            X_PF,
            finite(covariance),
            finite(error),
            float(time),
            (parent_id, child_id),
            delay,
            self.config,
            self._priors,
        )
        return self._with_probabilities(state)

    def rebase(
        self, state: JointFiltersState, time: float, offset: Array, reference_error: Array
    ) -> JointFiltersState:
        """The state once the child's pose has got a constant error, as from new landmarks.

        The motion from then on is a screw about the same axis, displaced from the reference by that
        error: what was measured since the reference is marginalised, the reference is less certain.

        Args:
            state: The last one; not changed.
            time: Of the first measurement with that error, [s]; what else is wrong with the next
                ones has nothing in common with earlier errors.
            offset: Covariance (6, 6), in B, of the constant error that came since the reference.
            reference_error: What counts of that of `start` from now on.

        Raises:
            ValueError: for arrays of other shapes, what is no covariance, and a time before that of
                the last measurement.
        """
        owner = f"{self._owner}.rebase"
        offset = covariance_array(offset, "offset", owner)
        reference_error = covariance_array(reference_error, "reference_error", owner)
        fault = covariance_fault(offset) or covariance_fault(reference_error)
        if fault := fault or time_fault(time, state.time):
            raise ValueError(f"{owner}: {fault}")
        rebased = rebased_state(state, float(time), offset, reference_error, self.config)
        return self._with_probabilities(rebased)

    def update(
        self,
        state: JointFiltersState,
        X_PB: Array,
        covariance: Array,
        time: float,
        correlated: Array | None = None,
    ) -> JointFiltersState:
        """The state after one measurement of the child's pose.

        Args:
            state: The last one; not changed.
            X_PB: Measured (4, 4).
            covariance: Of the measurement (6, 6), in B; see `start`.
            time: Of the measurement, [s], not before the last.
            correlated: The part (6, 6) of the covariance whose error is correlated in time, see
                `BodyMotion`; none if None.

        Returns:
            The new state; the last one with its `skipped` counted up for what cannot be true.

        Raises:
            ValueError: for arrays of other shapes.
        """
        owner = f"{self._owner}.update"
        X_PB = pose_array(X_PB, "X_PB", owner)
        covariance = covariance_array(covariance, "covariance", owner)
        correlated = np.zeros((6, 6)) if correlated is None else correlated
        correlated = covariance_array(correlated, "correlated", owner)
        fault = pose_fault(X_PB) or covariance_fault(covariance)
        if fault := fault or covariance_fault(correlated):
            return skip(state, fault)
        before, fault = follow_clock(state, float(time))
        if fault is not None:
            return before
        if _is_repeated(before, X_PB, covariance, time):
            return replace(skip(before, SkipReason.REPEATED), time=float(time))
        try:
            # What overflows is found below, whether compiled functions or NumPy's computed it.
            with np.errstate(all="ignore"):
                updated = self._updated(before, X_PB, covariance, float(time), correlated)
                if self._may_wander and _is_news(before, updated):
                    updated = self._updated(
                        before, X_PB, covariance, float(time), correlated, thorough=True
                    )
        except np.linalg.LinAlgError:
            return skip(state, SkipReason.NO_SOLUTION)
        if not np.isfinite(updated.models.log_evidence).all():
            return skip(state, SkipReason.NO_SOLUTION)
        return updated

    def _updated(
        self,
        state: JointFiltersState,
        X_PB: Array,
        covariance: Array,
        time: float,
        correlated: Array,
        thorough: bool = False,
    ) -> JointFiltersState:
        """The next state; `thorough` if all models are solved for it, and wanders compared."""
        covariance, correlated = finite(covariance), finite(correlated)
        models = Models(*[x.copy() for x in state.models])
        keyframes = copy_keyframes(state.keyframes)
        dt = time - state.time
        R_reported = white_equivalent(covariance, dt, self.config.errors, correlated)
        priors = self._priors
        if self._correlated:
            white, rest = error_shares(covariance, R_reported, dt, self.config.errors, correlated)
            priors = priors._replace(white_share=white, correlated_share=rest)
        X_FB = se3.inverse(state.X_PF) @ X_PB
        if np.diagonal(covariance)[:3].min() > MEASURED:
            # An unmeasured rotation must not bend the path between positions.
            X_FB[:3, :3] = keyframes.Z[keyframes.size[0] - 1, :3, :3]
        noise, scale = MeasurementNoise(*[x.copy() for x in state.noise]), state.scale
        now = time + state.clock
        observe(noise, X_FB, R_reported, now, self._correlated)
        zero_variance = self._with_turns(state, models, covariance, dt)
        estimated, r = estimated_scale(noise), correlations(noise)
        target = estimated
        if r.max() > 0.0:
            target = estimated * np.sqrt(np.repeat(inflation(r), 3))
            white, rest = correlated_shares(float(r.max()))
            priors = priors._replace(white_share=white, correlated_share=rest)
        reported = mean_covariance(state.reported, state.updates, covariance + EXACT)
        if np.abs(np.log(target / scale)).max() > _RESCALE:
            explain_pending(keyframes, priors.free, priors.outliers, models.inlier[FREE])
            independent = covariance_floor(state.floor_index, reported, estimated)
            rescale(keyframes, target / scale, independent, priors.outliers)
            scale = target
        R = R_reported * np.outer(scale, scale)
        updates, index, deviations = state.updates + 1, state.floor_index, state.deviations_index
        rounds = updates // _ALL_MODELS_EVERY
        all_models = thorough or updates % _ALL_MODELS_EVERY == 0
        fresh, log_prior = _wants_restart(state), self._log_prior
        update_models(models, keyframes, X_FB, R, now, priors, log_prior, fresh, all_models)
        tries = rounds if rounds <= _OFTEN else rounds // 3
        tries_others = updates % _ALL_MODELS_EVERY == 0 and (rounds <= _OFTEN or rounds % 3 == 0)
        if tries_others:
            models, keyframes, index = with_likelier_floor(
                models, keyframes, index, tries, reported, estimated, priors, log_prior
            )
        if all_models:
            deviations = likelier_deviations(
                models,
                keyframes,
                deviations,
                rounds,
                reported,
                estimated,
                priors,
                log_prior,
                state.wander,
            )
        wander, gain = state.wander, state.wander_gain
        smallest = int(np.searchsorted(SIZES, np.sqrt(np.diagonal(reported)[:3].max())))
        if (thorough or tries_others) and self._may_wander and smallest < len(SIZES):
            models, keyframes, wander, gain = likelier_wander(
                models,
                keyframes,
                wander,
                smallest,
                covariance_floor(deviations, reported, estimated),
                tries,
                priors,
                log_prior,
                self._wander_odds,
            )
        updated = replace(
            state,
            time=time,
            updates=updates,
            zero_variance=zero_variance,
            models=models,
            keyframes=keyframes,
            noise=noise,
            scale=scale,
            reported=reported,
            floor_index=index,
            deviations_index=deviations,
            wander=wander,
            wander_gain=gain,
        )
        return self._with_probabilities(updated)

    def _with_turns(self, state: JointFiltersState, models: Models, R: Array, dt: float) -> Array:
        """`zero_variance` once it is not known by how many turns a joint has gone on unseen.

        It is taken to have gone on by the fewest, from where it was in `models`.
        """
        variances = state.zero_variance.copy()
        for kind in (REVOLUTE, SCREW) if dt > _UNSEEN else ():
            climb = 2.0 * np.pi * abs(models.pitch[kind]) if kind == SCREW else 0.0
            if climb > _TELLING * np.sqrt(np.trace(R[3:, 3:])):
                continue  # Its height tells the turns.
            S = _unmeasured_noise(state, kind, self.config)
            P = predicted_configuration(models.state[kind], models.P[kind], S, dt)[1]
            variances[kind] += _turn_variance(P[0, 0])
            if P[0, 0] > _HALF_A_TURN**2:
                models.state[kind, 1] = 0.0
        return variances

    def probabilities(self, state: JointFiltersState) -> dict[JointType, float]:
        """Of each type, given all measurements.

        What the likeliest type loses where it does not fit goes to `DISCONNECTED`, which means that
        the motion is none of the others.
        """
        return dict(state.probabilities)

    def _with_probabilities(self, state: JointFiltersState) -> JointFiltersState:
        m, kf = state.models, state.keyframes
        deviations = covariance_floor(
            state.deviations_index, state.reported, estimated_scale(state.noise)
        )
        evidence, believed = type_evidence(
            m,
            kf,
            self._priors,
            deviations,
            state.wander,
            state.wander_gain,
            self._wander_odds,
        )
        p, likeliest = reported_probabilities(
            evidence + self._log_prior_of_reports, evidence + self._log_prior
        )
        most = largest_probability(likeliest, m, kf, state.noise, state.reported)
        lost = p[likeliest] * (1.0 - most)
        p[likeliest] -= lost
        p[FREE] += lost
        probabilities = dict(zip(TYPES, p.tolist(), strict=True))
        return replace(state, probabilities=probabilities, believed=believed)

    def belief(self, state: JointFiltersState, time: float | None = None) -> JointBelief:
        """The belief about the pair's joint.

        Args:
            time: For which the configuration is predicted, [s]; by default, and before the last
                measurement, that of the last measurement.
        """
        dt = 0.0 if time is None else max(0.0, time - state.time)
        return JointBelief(
            parent_id=state.parent_id,
            child_id=state.child_id,
            probabilities=self.probabilities(state),
            models={
                TYPES[kind]: _moving_joint(state, kind, dt, self.config)
                if kind in MOVING
                else JointModelBelief(log_evidence=float(state.models.log_evidence[kind]))
                for kind in range(len(TYPES))
            },
            updates=state.updates,
            skipped={str(reason): count for reason, count in state.skipped.items()},
            fit=state.fit,
            reference_age=dt + state.time + state.clock - state.zero_time,
        )

    def configuration_at(
        self, state: JointFiltersState, joint_type: JointType, X_PB: Array, covariance: Array
    ) -> float:
        """The configuration at that point of a type's path which is nearest to a pose.

        It counts as that of the belief, from the reference, [m or rad].

        Args:
            joint_type: One that moves.
            X_PB: Pose (4, 4) of the child.
            covariance: Of it (6, 6), in B: by what is near measured.

        Raises:
            ValueError: for arrays of other shapes, and for what cannot be true.
        """
        owner = f"{self._owner}.configuration_at"
        X_PB = pose_array(X_PB, "X_PB", owner)
        covariance = covariance_array(covariance, "covariance", owner)
        if fault := pose_fault(X_PB) or covariance_fault(covariance):
            raise ValueError(f"{owner}: {fault}")
        W = np.asarray(np.linalg.inv(finite(covariance) + EXACT))
        kind, m, by = TYPES.index(joint_type), state.models, np.empty(6)
        q = nearest(kind, m, se3.inverse(state.X_PF) @ X_PB, W, by)
        if state.W_zero[0, 0] > 0.0:
            q -= nearest(kind, m, np.eye(4), state.W_zero, by)
        return q

    def predict(self, state: JointFiltersState, joint_type: JointType, dt: float) -> PoseBelief:
        """Where one model expects the child `dt` [s] after the last measurement: X_PB, in B."""
        if joint_type == JointType.DISCONNECTED:
            kf = state.keyframes
            last = kf.size[0] - 1
            return PoseBelief(
                X=state.X_PF @ kf.Z[last],
                covariance=kf.R[last] + kf.floor + np.diag(self._priors.free.noise[0]) * dt,
            )
        X_PB, covariance = predict_pose(TYPES.index(joint_type), state.models, state.X_PF, dt)
        return PoseBelief(X=X_PB, covariance=covariance)


def _is_repeated(state: JointFiltersState, X_PB: Array, covariance: Array, time: float) -> bool:
    """Whether a measurement is the last one, sent twice or held until the next.

    Where there is noise, no two measurements are the same to the last digit.
    """
    last, kf = state.noise, state.keyframes
    if np.abs(se3.inverse(state.X_PF) @ X_PB - last.Z[-1]).max() >= _SAME_POSE:
        return False
    if time + state.clock == last.time[-1]:
        return True
    differed = np.abs(kf.Z[: kf.size[0]] - kf.Z[0]).max() >= _SAME_POSE
    has_noise = np.diagonal(covariance).min() > LEAST_NOISE
    return bool(differed and has_noise and np.allclose(covariance, last.R[-1], 1e-6, 1e-11))


def _is_news(before: JointFiltersState, after: JointFiltersState) -> bool:
    """Whether a type is certain that was not before."""
    kind = max(after.probabilities, key=lambda t: after.probabilities[t])
    return after.probabilities[kind] > _CERTAIN > before.probabilities[kind]


def _wants_restart(state: JointFiltersState) -> bool:
    """Whether the moving models may sit in a wrong minimum, which a fresh start would leave."""
    m = state.models
    if m.prior_information[0, 0, 0] > 0.0:
        return False
    unknown = m.covariance[PRISMATIC, 6, 6] + m.covariance[PRISMATIC, 7, 7] > _WELL_KNOWN**2
    return bool(unknown) or (state.updates + 1) % _RESTART_EVERY == 0


def _turn_variance(predicted: float) -> float:
    """Of whole turns [rad^2], where an angle is known up to these and predicted so well."""
    if predicted > (2.0 * np.pi) ** 2:
        return predicted  # Its limit.
    squares = (2.0 * np.pi * np.arange(1, 5)) ** 2
    weights = 2.0 * np.exp(-0.5 * squares / max(predicted, 1e-3))  # To both sides.
    return float(weights @ squares / (1.0 + weights.sum()))


def _unmeasured_noise(state: JointFiltersState, kind: int, config: JointFiltersConfig) -> float:
    """Density of a joint's acceleration while nothing is measured, [m^2/s^3] or [rad^2/s^3]."""
    m, S = state.models, config.unmeasured_process_noise
    if turns(kind):
        S /= config.radius**2 + float(m.c[kind] @ m.c[kind]) + float(m.pitch[kind]) ** 2
    return S


def _moving_joint(
    state: JointFiltersState, kind: int, dt: float, config: JointFiltersConfig
) -> JointModelBelief:
    """What is believed of one kind of moving joint, predicted dt [s] ahead."""
    m, S = state.believed, _unmeasured_noise(state, kind, config)
    wanders = state.keyframes.wander[0] > 0.0
    vectors, axis, point, configuration, covariance = read_moving(
        kind,
        m,
        m.covariance[kind],
        m.covariance[kind] if wanders else state.models.covariance[kind],
        state.X_PF,
        config.axis_distance,
        state.W_zero,
        state.reference_noise + state.offset,
        float(state.zero_variance[kind]),
        S,
        dt,
    )
    pitch = np.full((1, 3), np.nan)
    if kind == SCREW:
        pitch = pitch_posterior(m.pitch[kind], m.covariance[kind, 10, 10])
    return JointModelBelief(
        log_evidence=float(state.models.log_evidence[kind]),
        axis_P=vectors[0],
        axis_covariance=axis,
        p_PA=vectors[1],
        p_PA_covariance=point,
        configuration=configuration,
        configuration_covariance=covariance,
        pitch_mixture=pitch,
    )
