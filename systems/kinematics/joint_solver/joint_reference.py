"""What goes on when the child's pose gets a constant error: axes and types, not keyframes."""

import numpy as np

from maths.gaussian import symmetric
from systems.kinematics.joint_solver.joint_geometry import MOVING, PARAMETERS, SCREW, dimension
from systems.kinematics.joint_solver.joint_linearisation import embedding
from systems.kinematics.joint_solver.joint_models import AXIS_SPREAD, Models, initial_models
from systems.kinematics.joint_solver.joint_pitch import WIDEST, pitch_evidence
from systems.kinematics.joint_solver.joint_update import MEMORY


def keep_axes(old: Models, axis_distance: float) -> Models:
    """Models with what `old` know of axes and types as a prior, before anything is measured anew.

    The prior of axis, point and pitch stands beside the vague one that every solution has; together
    they are the posterior of `old`, normalised so that evidence stays comparable.

    Args:
        old: At their newest keyframe; not changed.
        axis_distance: See `Priors`.
    """
    new = initial_models(old.q.shape[1])
    for name in ("covariance", "signed", "process_noise", "log_evidence"):
        getattr(new, name)[:] = getattr(old, name)
    for name in ("Y", "a", "c", "pitch"):
        getattr(new, name)[:] = getattr(old, name)
        getattr(new, f"prior_{name}")[:] = getattr(old, name)
    new.state[:, 0] = old.state[:, 0]
    E = np.empty((PARAMETERS, PARAMETERS + 2))
    spread = [AXIS_SPREAD] * 2 + [axis_distance] * 2 + [WIDEST]
    for kind in MOVING:
        n = dimension(kind)
        vague = np.diag(np.array(spread[: n - 6]) ** -2.0)
        information = symmetric(np.asarray(np.linalg.inv(old.covariance[kind, 6:n, 6:n]), float))
        embedding(old.a[kind], E)
        new.prior_information[kind] = E[6:n].T @ (information - vague) @ E[6:n]
        # The vague one is about Fo and no pitch.
        new.prior_vector[kind, 9:12] = old.c[kind] / axis_distance**2
        new.prior_vector[kind, 12] = old.pitch[kind] / WIDEST**2
        new.prior_value[kind] = 0.5 * (
            np.linalg.slogdet(information)[1]
            - np.linalg.slogdet(vague)[1]
            + float(old.c[kind] @ old.c[kind]) / axis_distance**2
            + (old.pitch[kind] / WIDEST) ** 2
        )
    evidence = old.log_evidence.copy()
    # What the pitch is worth is added anew by each solution.
    evidence[SCREW] -= pitch_evidence(old.pitch[SCREW], old.covariance[SCREW, 10, 10])
    new.marginal_evidence[:] = np.maximum(evidence - evidence.max(), -MEMORY)
    return new
