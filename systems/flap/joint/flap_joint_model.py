"""What the joint filters know of a flap, and how they are configured for it."""

from dataclasses import dataclass, field

import numpy as np

from crossmodal.maths.arrays import Array
from crossmodal.maths.immutable import Immutable
from crossmodal.maths.validation import check, number
from crossmodal.systems.depth_camera import DepthCamera
from crossmodal.systems.flap.flap_geometry import turned_normal
from crossmodal.systems.flap.hinge.hinge_keyframes import Keyframe
from crossmodal.systems.flap.hinge.hinge_limits import HingeLimitsConfig
from crossmodal.systems.kinematics.joint_filters import JointFilters, JointFiltersState
from crossmodal.systems.kinematics.joint_filters_config import JointFiltersConfig, TypePriorsConfig
from crossmodal.systems.kinematics.measurement_errors import MeasurementErrorsConfig
from crossmodal.systems.port_values import (
    DisplacementBelief,
    JointModelBelief,
    JointType,
)
from crossmodal.systems.ticks import Ticked


def _filters() -> JointFiltersConfig:
    return JointFiltersConfig(
        radius=0.1,
        axis_distance=0.1,
        type_priors=TypePriorsConfig(screw=0.02, rigid=0.4),
        ranking_priors=TypePriorsConfig(screw=0.02, rigid=0.4),
        errors=MeasurementErrorsConfig(declared_time=3.0),
    )


@dataclass(kw_only=True)
class FlapJointConfig(Ticked):
    """Configuration of `FlapJoint`."""

    filters: JointFiltersConfig = field(default_factory=_filters)
    # How far the contact wanders on the flap, across its edge and radially.
    contact_spread: float = number(0.002, at_least=1e-6, at_most=1.0, unit="m")
    # Rotation about the normal: the axis lies in the flap, but for what its first normal errs.
    twist: float = number(0.02, at_least=1e-6, at_most=10.0, unit="rad")
    # Direction of a normal that is not seen.
    unseen_normal: float = number(0.5, at_least=1e-6, at_most=10.0, unit="rad")
    # Error of a normal that stays for seconds: faces are not flat.
    flatness: float = number(1e-3, at_least=0.0, at_most=1.0, unit="rad")
    # Images whose average is the reference, from the first touch on.
    reference_images: int = number(15, at_least=1, at_most=1000)
    # Path of the contact after which no more of them are waited for.
    at_rest: float = number(0.002, at_least=0.0, at_most=1.0, unit="m")


@dataclass(frozen=True, kw_only=True)
class FlapJointState(Immutable):
    """What is known at one tick.

    Attributes:
        displacements: Of camera, holder and finger about the first contact, as they were known
            then, by which all is corrected; None before.
        reference: What was seen and touched at first; None before.
        moved: How far what is touched has moved since (3,), while the reference grows, [m].
        reference_moved: Mean of that over the reference (3,), [m].
        filters: None before the reference is complete.
        n_W: Normal (3,) of the front that was seen last.
        n0_W: Normal (3,) of the front at the reference.
        n0_noise: (3, 3), of the images that it is the mean of.
        model: Of the revolute joint at this tick; None before.
        sign: 1 or -1: of the joint's axis for a positive angle.
        p_WC: Last contact (3,), [m].
        measured: Whether the flap was seen at this tick.
    """

    displacements: DisplacementBelief | None = None
    reference: Keyframe | None = None
    moved: Array = field(default_factory=lambda: np.zeros(3))
    reference_moved: Array = field(default_factory=lambda: np.zeros(3))
    filters: JointFiltersState | None = None
    n_W: Array = field(default_factory=lambda: np.full(3, np.nan))
    n0_W: Array = field(default_factory=lambda: np.full(3, np.nan))
    n0_noise: Array = field(default_factory=lambda: np.full((3, 3), np.nan))
    model: JointModelBelief | None = None
    sign: float = 1.0
    p_WC: Array = field(default_factory=lambda: np.full(3, np.nan))
    measured: bool = False


class FlapJointModel:
    """What of a `FlapJoint` stays as it is.

    Args:
        limits: Of what is believed.
        camera: Whose planes these are, as it is calibrated.

    Raises:
        ValueError: for an impossible config value.
    """

    def __init__(
        self, config: FlapJointConfig, limits: HingeLimitsConfig, camera: DepthCamera
    ) -> None:
        check(config, "FlapJoint")
        check(limits, "FlapJoint")
        self.config, self.limits, self.camera = config, limits, camera
        self.filters = JointFilters(config.filters, owner="FlapJoint")

    def now(self, state: JointFiltersState, time: float) -> JointModelBelief:
        """The revolute joint at a time [s]."""
        return self.filters.belief(state, time).models[JointType.REVOLUTE]

    def is_axis_known(self, model: JointModelBelief) -> bool:
        """Whether the axis is known well enough to turn a normal about it."""
        limit = self.limits.largest_direction**2
        return bool(np.trace(model.axis_covariance) < limit)  # NaN is not.


def expected_normal(state: FlapJointState, m: JointModelBelief, model: FlapJointModel) -> Array:
    """The front's normal (3,) by the joint; the one that was seen last while it has no axis."""
    if not model.is_axis_known(m):
        return state.n_W
    return turned_normal(m.axis_P, state.n0_W, float(m.configuration[0]))
