"""What the joint filters of one pair of bodies know at one measurement."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property

from crossmodal.maths.arrays import Array
from crossmodal.maths.immutable import Immutable
from crossmodal.systems.kinematics.goodness_of_fit import reduced_chi_square
from crossmodal.systems.kinematics.joint_solver.joint_models import Models
from crossmodal.systems.kinematics.joint_solver.noise_correlation import (
    NoiseCorrelation,
    correlations,
)
from crossmodal.systems.kinematics.joint_solver.noise_scale import (
    NoiseScale,
    own_scale,
)
from crossmodal.systems.kinematics.joint_solver.path_floor import FLOORS
from crossmodal.systems.kinematics.joint_solver.pose_keyframes import (
    Keyframes,
)
from crossmodal.systems.kinematics.pose_checks import (
    SkipReason,
)
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
        updates: Measurements seen.
        models: Parameters, configuration and evidence of each model.
        keyframes: The measurements, averaged.
        noise: By how much the claimed covariances are wrong.
        correlation: How alike neighbouring measurements err.
        scale: (6,) standard deviations of the keyframes by those that were claimed.
        claim: Covariance (6, 6), in B, that measurements claim, their harmonic mean.
        floor_index: In `path_floor.FLOORS` of what the keyframes have.
        strays_index: The same of how large smooth strays are (`smooth_strays`).
        covariance: (J, N, N) of each model's theta, strays smooth or independent.
        W_zero: See `read_configuration`.
        reference_noise: Covariance (6, 6), in B, of the measured reference.
        offset: Covariance (6, 6), in B, of the poses' constant error since the last reset.
        zero_variance: (4,) by how far the child may have moved before the reference, by each model
            of a joint.
        reset_count: Of parent and child together (`BodyMotion`).
        skipped: How many measurements were not used, by reason.
        probabilities: Of each type, given all measurements.
    """

    parent_id: int
    child_id: int
    X_PF: Array
    time: float
    updates: int
    models: Models
    keyframes: Keyframes
    noise: NoiseScale
    correlation: NoiseCorrelation
    scale: Array
    claim: Array
    floor_index: int
    strays_index: int
    covariance: Array
    W_zero: Array
    reference_noise: Array
    offset: Array
    zero_variance: Array
    reset_count: int = 0
    skipped: Mapping[SkipReason, int] = field(default_factory=dict)
    probabilities: Mapping[JointType, float] = field(default_factory=dict)

    @cached_property
    def fit(self) -> JointFit:
        """How well the most probable type fits the measurements."""
        m, kf, size = self.models, self.keyframes, int(self.keyframes.size[0])
        kind = max(range(len(TYPES)), key=lambda k: self.probabilities[TYPES[k]])
        value, bounds, degrees = reduced_chi_square(kind, m, kf, self.noise)
        scale = own_scale(self.noise)
        undecided = float(kf.open[:size] @ (1.0 - m.inlier[kind, :size]))
        return JointFit(
            reduced_chi_square=value,
            bounds=bounds,
            degrees=degrees,
            outlier_share=(float(kf.outliers[0]) + undecided) / (self.updates + 1),
            noise_scale=(float(scale[0]), float(scale[3])),
            noise_correlation=float(correlations(self.correlation, self.noise.variance).max()),
            path_floor=FLOORS[self.floor_index],
        )


def skip(state: JointFiltersState, reason: SkipReason) -> JointFiltersState:
    """The same state with one more measurement that was not used."""
    skipped = {**state.skipped, reason: state.skipped.get(reason, 0) + 1}
    return replace(state, skipped=skipped)
