"""What goes on when the child's pose gets a constant error: axes and types, not keyframes."""

import numpy as np

from crossmodal.maths.gaussian import symmetric
from crossmodal.systems.kinematics.joint_solver.axis_prior import axis_prior
from crossmodal.systems.kinematics.joint_solver.joint_geometry import (
    MOVING,
    PARAMETERS,
    SCREW,
    dimension,
    turns,
)
from crossmodal.systems.kinematics.joint_solver.joint_linearisation import embedding
from crossmodal.systems.kinematics.joint_solver.joint_models import (
    AXIS_SPREAD,
    Models,
    initial_models,
)
from crossmodal.systems.kinematics.joint_solver.joint_pitch import WIDEST, pitch_evidence
from crossmodal.systems.kinematics.joint_solver.pose_keyframes import MEMORY


def keep_axes(old: Models, axis_distance: float, far: bool) -> Models:
    """Models with what `old` know of axes and types as a prior, before anything is measured anew.

    The prior of axis, point and pitch stands beside the vague one that every solution has; together
    they are the posterior of `old`, normalised so that evidence stays comparable.

    Args:
        old: At their newest keyframe; not changed.
        axis_distance: See `Priors`.
        far: Whether an axis may be farther away.
    """
    new = initial_models(old.q.shape[1])
    for name in ("covariance", "signed", "process_noise", "log_evidence"):
        getattr(new, name)[:] = getattr(old, name)
    for name in ("Y", "a", "c", "pitch"):
        getattr(new, name)[:] = getattr(old, name)
        getattr(new, f"prior_{name}")[:] = getattr(old, name)
    new.state[:, 0] = old.state[:, 0]
    E = np.empty((PARAMETERS, PARAMETERS + 2))
    for kind in MOVING:
        n, c = dimension(kind), old.c[kind]
        density, of_place = axis_prior(float(c @ c), axis_distance, far)
        density = density if turns(kind) else 0.0
        vague = np.array([AXIS_SPREAD**-2.0] * 2 + [of_place] * 2 + [WIDEST**-2.0])[: n - 6]
        information = symmetric(np.asarray(np.linalg.inv(old.covariance[kind, 6:n, 6:n]), float))
        embedding(old.a[kind], E)
        new.prior_information[kind] = E[6:n].T @ (information - np.diag(vague)) @ E[6:n]
        # The vague one is about Fo and no pitch.
        new.prior_vector[kind, 9:12] = c * of_place
        new.prior_vector[kind, 12] = old.pitch[kind] / WIDEST**2
        others = np.log(np.delete(vague, slice(2, 4))).sum()
        gain = np.linalg.slogdet(information)[1] - others + (old.pitch[kind] / WIDEST) ** 2
        new.prior_value[kind] = 0.5 * gain - density
    evidence = old.log_evidence.copy()
    # What the pitch is worth is added anew by each solution.
    evidence[SCREW] -= pitch_evidence(old.pitch[SCREW], old.covariance[SCREW, 10, 10])
    new.marginal_evidence[:] = np.maximum(evidence - evidence.max(), -MEMORY)
    return new
