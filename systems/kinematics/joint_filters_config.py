"""The configuration of the joint filters."""

from dataclasses import dataclass, field

from crossmodal.maths.validation import number, numbers
from crossmodal.systems.kinematics.keyframes.pose_keyframes import FIRST, RECENT
from crossmodal.systems.kinematics.measurement_errors import MeasurementErrorsConfig, is_correlated


@dataclass(kw_only=True)
class TypePriorsConfig:
    """Prior probabilities of the joint types, above zero; they need not sum to one.

    The defaults know next to nothing: all types are as likely, but a screw half as much.
    """

    prismatic: float = number(0.2, above=0.0, at_most=1000.0)  # Of a joint that slides.
    revolute: float = number(0.2, above=0.0, at_most=1000.0)  # Of a joint that turns.
    # Of a joint that turns and slides at once.
    screw: float = number(0.1, above=0.0, at_most=1000.0)
    rigid: float = number(0.2, above=0.0, at_most=1000.0)  # Of a joint that does not move.
    # Of bodies that no joint connects.
    disconnected: float = number(0.2, above=0.0, at_most=1000.0)


def common_joints() -> TypePriorsConfig:
    """What joints of furniture and tools are: few screws or far hinges; most things rest."""
    return TypePriorsConfig(revolute=0.1, screw=0.01, rigid=0.4)


@dataclass(kw_only=True)
class JointFiltersConfig:
    """Priors and memory of the joint filters.

    How jerky a joint's motion may be is not tuned: the configurations are smoothed with each
    density of `process_noise`, and the evidence of a joint type is averaged over them. Where the
    errors are correlated, the present configuration is followed with the density under which the
    newest keyframes are likeliest, so that an even motion is averaged over seconds and a stop is
    followed at once; with white noise it is that under which all keyframes are likeliest.

    Attributes:
        process_noise: Densities S of the child's white acceleration, dv = sqrt(S) dw; from a hand
            that guides slowly to a door that is thrown shut.
        jumps: Probability that the velocity jumps between two measurements: a motion begins and
            ends at once.
        radius: Of the child itself: a revolute joint at a distance d moves it by
            sqrt(radius^2 + d^2) per radian.
        speed: Standard deviation of the child's speed before anything was seen; as likely it is a
            fifth of that. A disconnected body wanders as far in the first second.
        axis_distance: Standard deviation of an axis' position from the body, per direction.
        hinge_pitch: Standard deviation of what a hinge climbs per radian and is still one.
            Correlated errors make one climb, too.
        outliers: Share of the measurements that are outliers; zero for none.
        type_priors: Of the joint types; what is reported holds for one who expects no type.
        ranking_priors: By which the likeliest type is chosen: of two that nothing measured can tell
            apart the commoner one. What is reported of it holds for them, too.
        errors: Of the measurements, correlated in time.
        memory: Keyframes kept.
    """

    process_noise: list[float] = numbers(
        [1e-7, 3e-6, 1e-4, 3e-3, 1e-1, 3.0],
        at_least=1e-15,
        at_most=1000.0,
        unit="m^2/s^3",
        shape=(range(1, 17),),
    )
    jumps: float = number(1e-3, at_least=0.0, at_most=0.5)
    radius: float = number(0.3, at_least=1e-6, at_most=100.0, unit="m")
    speed: float = number(0.1, at_least=1e-9, at_most=100.0, unit="m/s")
    axis_distance: float = number(0.6, at_least=1e-6, at_most=1000.0, unit="m")
    hinge_pitch: float = number(3e-4, above=0.0, at_most=1.0, unit="m/rad")
    outliers: float = number(0.02, at_least=0.0, at_most=0.5)
    type_priors: TypePriorsConfig = field(default_factory=TypePriorsConfig)
    ranking_priors: TypePriorsConfig = field(default_factory=common_joints)
    errors: MeasurementErrorsConfig = field(default_factory=MeasurementErrorsConfig)
    memory: int = number(24, at_least=FIRST + RECENT + 4, at_most=1000, unit="keyframes")

    @property
    def far_axes(self) -> bool:
        """Whether an axis may be some ten times farther away, where rotations are measured.

        Correlated errors turn a slide as a far hinge does, so that it may not with these.
        """
        return not is_correlated(self.errors)

    @property
    def jump_noise(self) -> float:
        """Density of the acceleration in a step in which the velocity jumps, [m^2/s^3]."""
        return 10.0 * max(self.process_noise)

    @property
    def unmeasured_process_noise(self) -> float:
        """Density of an acceleration that is not measured, at first and at last, [m^2/s^3]."""
        return sorted(self.process_noise)[len(self.process_noise) // 2]

    @property
    def coarseness(self) -> float:
        """Share of the motion's mean square that one keyframe may span: an even share."""
        return 1.0 / (self.memory - RECENT)
