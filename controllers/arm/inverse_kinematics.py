"""Postures of an arm that put its end-effector somewhere."""

from collections.abc import Iterator, Sequence

import numpy as np
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.inverse_kinematics import InverseKinematics
from pydrake.multibody.plant import MultibodyPlant
from pydrake.solvers import Solve

from crossmodal.maths.arrays import Array

_ALIKE = 0.05  # Postures whose joints differ by less are one, [rad].


def inverse_kinematics(arm: MultibodyPlant, X_WE: RigidTransform, q_guess: Array) -> Array:
    """Joint positions (n,) that put E at `X_WE`, far from the joints' limits.

    Args:
        arm: A finalized plant with one arm alone and its frame `end_effector`.
        X_WE: Pose of its end-effector.
        q_guess: Joint positions (n,) nearby, [rad].

    Raises:
        ValueError: if the pose is out of reach.
    """
    for q in all_inverse_kinematics(arm, X_WE, [q_guess], restarts=8, spread=0.2):
        return q
    direction = X_WE.rotation().col(2).round(2).tolist()
    at = X_WE.translation().round(3).tolist()
    raise ValueError(f"the arm does not reach {at} m along {direction}")


def all_inverse_kinematics(
    arm: MultibodyPlant,
    X_WE: RigidTransform,
    guesses: Sequence[Array],
    restarts: int,
    spread: float,
) -> Iterator[Array]:
    """Joint positions (n,) that put E at `X_WE`, each once, [rad].

    The solver stops short of a pose here and there; then another start may get to it.

    Args:
        arm: A finalized plant with one arm alone and its frame `end_effector`.
        X_WE: Pose of its end-effector.
        guesses: Joint positions (n,) from which it starts, [rad].
        restarts: How often it starts from around the first of them after that.
        spread: How far around it, per joint; the standard deviation, [rad].
    """
    lower, upper = arm.GetPositionLowerLimits(), arm.GetPositionUpperLimits()
    solver = InverseKinematics(arm)
    E, world = arm.GetFrameByName("end_effector"), arm.world_frame()
    p = X_WE.translation()
    solver.AddPositionConstraint(E, np.zeros(3), world, p - 1e-4, p + 1e-4)
    solver.AddOrientationConstraint(world, X_WE.rotation(), E, RotationMatrix(), 1e-3)
    weight = np.diag(1.0 / (upper - lower) ** 2)
    solver.prog().AddQuadraticErrorCost(weight, 0.5 * (lower + upper), solver.q())
    offsets = np.random.default_rng(0).normal(0.0, spread, (restarts, arm.num_positions()))
    found = list[Array]()
    for guess in [*guesses, *(guesses[0] + offsets)]:
        result = Solve(solver.prog(), guess)
        q = np.asarray(result.GetSolution(solver.q()))
        if result.is_success() and all(np.abs(q - other).max() > _ALIKE for other in found):
            found.append(q)
            yield q
