"""What goes on when the child's pose gets a constant error: axes and types, not keyframes."""

import numpy as np

from maths.gaussian import symmetric
from systems.kinematics.joint_solver.joint_geometry import PRISMATIC, REVOLUTE, dimension
from systems.kinematics.joint_solver.joint_linearisation import embedding
from systems.kinematics.joint_solver.joint_models import AXIS_SPREAD, Models, initial_models
from systems.kinematics.joint_solver.joint_update import MEMORY


def keep_axes(old: Models, axis_distance: float) -> Models:
    """Models with what `old` know of axes and types as a prior, before anything is measured anew.

    The prior of axis and point stands beside the vague one that every solution has; together they
    are the posterior of `old`, normalised so that evidence stays comparable.

    Args:
        old: At their newest keyframe; not changed.
        axis_distance: See `Priors`.
    """
    new = initial_models(old.q.shape[1])
    same = ("Y", "a", "c", "covariance", "signed", "process_noise", "prior_Y", "prior_a", "prior_c")
    for name in same:
        getattr(new, name)[:] = getattr(old, name.removeprefix("prior_"))
    new.state[:, 0] = old.state[:, 0]
    E = np.empty((10, 12))
    for kind in (PRISMATIC, REVOLUTE):
        n = dimension(kind)
        vague = np.diag([AXIS_SPREAD**-2.0] * 2 + [axis_distance**-2.0] * 2)[: n - 6, : n - 6]
        information = symmetric(np.asarray(np.linalg.inv(old.covariance[kind, 6:n, 6:n]), float))
        embedding(old.a[kind], E)
        new.prior_information[kind] = E[6:n].T @ (information - vague) @ E[6:n]
        new.prior_vector[kind, 9:] = old.c[kind] / axis_distance**2  # The vague one is about Fo.
        new.prior_value[kind] = 0.5 * (
            np.linalg.slogdet(information)[1]
            - np.linalg.slogdet(vague)[1]
            + float(old.c[kind] @ old.c[kind]) / axis_distance**2
        )
    new.marginal_evidence[:] = np.maximum(old.log_evidence - old.log_evidence.max(), -MEMORY)
    return new
