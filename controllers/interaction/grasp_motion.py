"""How the hand moves and gives way around a grasp."""

import numpy as np

from crossmodal.controllers.arm.impedance import DesiredMotion, ImpedanceGains
from crossmodal.controllers.arm.minimum_jerk import minimum_jerk
from crossmodal.controllers.interaction.grasp_sequence_config import GraspSequenceConfig
from crossmodal.maths import se3
from crossmodal.maths.arrays import Array


def exploration_gains(config: GraspSequenceConfig, direction_E: Array) -> ImpedanceGains:
    """Compliant in all directions, stiff in the pulling direction (3,) of E."""
    direction = direction_E / np.linalg.norm(direction_E)
    pull = np.zeros((6, 6))
    pull[3:, 3:] = np.outer(direction, direction)
    free = np.eye(6) - pull
    return ImpedanceGains(
        stiffness=config.compliant_stiffness * free + config.pull_stiffness * pull,
        damping=config.compliant_damping * free + config.pull_damping * pull,
        mass=config.mass * np.eye(6),
    )


def stiff_gains(config: GraspSequenceConfig) -> ImpedanceGains:
    """Holds the pose while the hand approaches and closes."""
    stiffness = config.stiff_rotation, config.stiff_translation
    damping = config.stiff_rotation_damping, config.stiff_translation_damping
    return ImpedanceGains(
        stiffness=np.diag(np.repeat(stiffness, 3)),
        damping=np.diag(np.repeat(damping, 3)),
        mass=config.mass * np.eye(6),
    )


def approach_motion(X_WE_grasp: Array, back: Array, s: float, duration: float) -> DesiredMotion:
    """The approach at progress `s` in [0, 1], from `back` (6,), a twist in E, to the grasp."""
    blend, rate, acceleration = minimum_jerk(s)
    return DesiredMotion(
        X_WE=X_WE_grasp @ se3.exp((1.0 - blend) * back),
        V_WE_E=-back * rate / duration,
        A_WE_E=-back * acceleration / duration**2,
    )


def release_motion(X_WE: Array, X_WE_next: Array, back: Array, s: float) -> DesiredMotion:
    """Waits for the hand to open, backs off, then goes straight to the next pose.

    Args:
        X_WE: Where the hand is opened (4, 4).
        X_WE_next: Where the next approach begins (4, 4).
        back: Twist (6,) in E of the way back.
        s: Progress in [0, 1], a third for each part.
    """
    X_back = X_WE @ se3.exp(back)
    X = X_WE @ se3.exp(minimum_jerk(3 * s - 1)[0] * se3.log(se3.inverse(X_WE) @ X_back))
    X = X @ se3.exp(minimum_jerk(3 * s - 2)[0] * se3.log(se3.inverse(X_back) @ X_WE_next))
    return DesiredMotion(X_WE=X, V_WE_E=np.zeros(6), A_WE_E=np.zeros(6))
