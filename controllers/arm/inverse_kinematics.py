"""Postures of an arm that put its end-effector somewhere."""

import numpy as np
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.inverse_kinematics import InverseKinematics
from pydrake.multibody.plant import MultibodyPlant
from pydrake.solvers import Solve

from crossmodal.maths.arrays import Array


def inverse_kinematics(
    arm: MultibodyPlant, X_WE: RigidTransform, q_guess: Array, restarts: int = 8
) -> Array:
    """Joint positions (n,) that put E at `X_WE`, far from the joints' limits.

    The solver stops short of a pose here and there; then it starts again from around `q_guess`.

    Args:
        arm: A finalized plant with one arm alone and its frame `end_effector`.
        X_WE: Pose of its end-effector.
        q_guess: Joint positions (n,) nearby, [rad].
        restarts: How often it starts again.

    Raises:
        ValueError: if the pose is out of reach.
    """
    lower, upper = arm.GetPositionLowerLimits(), arm.GetPositionUpperLimits()
    solver = InverseKinematics(arm)
    E, world = arm.GetFrameByName("end_effector"), arm.world_frame()
    p = X_WE.translation()
    solver.AddPositionConstraint(E, np.zeros(3), world, p - 1e-4, p + 1e-4)
    solver.AddOrientationConstraint(world, X_WE.rotation(), E, RotationMatrix(), 1e-3)
    weight = np.diag(1.0 / (upper - lower) ** 2)
    solver.prog().AddQuadraticErrorCost(weight, 0.5 * (lower + upper), solver.q())
    n = arm.num_positions()
    around = np.random.default_rng(0).normal(0.0, 0.2, (restarts, n))
    for guess in q_guess + np.vstack([np.zeros(n), around]):
        result = Solve(solver.prog(), guess)
        if result.is_success():
            return np.asarray(result.GetSolution(solver.q()))
    direction = X_WE.rotation().col(2).round(2).tolist()
    raise ValueError(f"the arm does not reach {p.round(3).tolist()} m along {direction}")
