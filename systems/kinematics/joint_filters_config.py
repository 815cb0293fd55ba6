"""The configuration of the joint filters."""

from dataclasses import dataclass, field

from crossmodal.maths.validation import number, numbers
from crossmodal.systems.kinematics.keyframes.pose_keyframes import FIRST, RECENT
from crossmodal.systems.kinematics.measurement_errors import MeasurementErrorsConfig


@dataclass(kw_only=True)
class TypePriorsConfig:
    """Prior probabilities of the joint types, above zero; they need not sum to one.

    The defaults know next to nothing: all types are as likely, but a screw half as much.
    """

    prismatic: float = number(0.2, above=0.0, at_most=1000.0)
    revolute: float = number(0.2, above=0.0, at_most=1000.0)
    screw: float = number(0.1, above=0.0, at_most=1000.0)
    rigid: float = number(0.2, above=0.0, at_most=1000.0)
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
        jump_noise: The density with which it does.
        unmeasured_process_noise: That of a motion of which nothing measured says how jerky it is:
            the first, and what comes after the last measurement.
        radius: Of the child itself: a revolute joint at a distance d moves it by
            sqrt(radius^2 + d^2) per radian.
        speed: Standard deviation of the child's speed before anything was seen; as likely it is a
            fifth of that.
        axis_distance: Standard deviation of an axis' position from the body, per direction.
        far_axes: Whether it may be up to some ten times farther, where rotations are measured. Not
            for errors that last: they turn a slide as a far hinge does.
        hinge_pitch: Standard deviation of what a hinge climbs per radian and is still one. An error
            that lasts makes one climb, too.
        walk_translation: Standard deviation of a disconnected body's random walk after one second,
            of the fastest of several walks.
        walk_rotation: The same in rotation.
        free_acceleration: Density S of the white acceleration of a disconnected body whose velocity
            is nearly constant, the largest of several; of its rotation it is S / radius^2.
        outliers: Share of the measurements that are outliers; zero for none.
        outlier_rotation: Standard deviation of what an outlier is off by, per direction.
        outlier_translation: The same in translation.
        type_priors: Of the joint types; what is claimed holds for one who expects no type.
        ranking_priors: By which the likeliest type is chosen: of two that nothing measured can tell
            apart the commoner one. What is claimed of it holds for them, too.
        errors: Of the measurements, correlated in time.
        memory: Keyframes kept.
        coarseness: Share of the motion's mean square that one keyframe may span.
    """

    process_noise: list[float] = numbers(
        [1e-7, 3e-6, 1e-4, 3e-3, 1e-1, 3.0],
        at_least=1e-15,
        at_most=1000.0,
        unit="m^2/s^3",
        shape=(range(1, 17),),
    )
    jumps: float = number(1e-3, at_least=0.0, at_most=0.5)
    jump_noise: float = number(30.0, at_least=1e-15, at_most=1e6, unit="m^2/s^3")
    unmeasured_process_noise: float = number(3e-3, at_least=1e-15, at_most=1000.0, unit="m^2/s^3")
    radius: float = number(0.3, at_least=1e-6, at_most=100.0, unit="m")
    speed: float = number(0.1, at_least=1e-9, at_most=100.0, unit="m/s")
    axis_distance: float = number(0.6, at_least=1e-6, at_most=1000.0, unit="m")
    far_axes: bool = True
    hinge_pitch: float = number(3e-4, above=0.0, at_most=1.0, unit="m/rad")
    walk_translation: float = number(0.1, at_least=1e-9, at_most=100.0, unit="m")
    walk_rotation: float = number(0.3, at_least=1e-9, at_most=100.0, unit="rad")
    free_acceleration: float = number(0.1, at_least=1e-12, at_most=1000.0, unit="m^2/s^3")
    outliers: float = number(0.02, at_least=0.0, at_most=0.5)
    outlier_rotation: float = number(1.0, at_least=1e-9, at_most=100.0, unit="rad")
    outlier_translation: float = number(0.3, at_least=1e-9, at_most=100.0, unit="m")
    type_priors: TypePriorsConfig = field(default_factory=TypePriorsConfig)
    ranking_priors: TypePriorsConfig = field(default_factory=common_joints)
    errors: MeasurementErrorsConfig = field(default_factory=MeasurementErrorsConfig)
    memory: int = number(24, at_least=FIRST + RECENT + 4, at_most=1000, unit="keyframes")
    coarseness: float = number(0.05, at_least=1e-6, below=1.0)
