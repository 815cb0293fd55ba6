"""The joint models at a new reference: what they know of axes and types goes on, packets do not.

Frames: F the old reference, G the new one.
"""

import numpy as np
import numpy.typing as npt

from maths import se3
from maths.gaussian import symmetric
from systems.kinematics.joint_geometry import PRISMATIC, REVOLUTE, dimension, tangent_basis
from systems.kinematics.joint_linearisation import embedding
from systems.kinematics.joint_models import AXIS_SPREAD, Models
from systems.kinematics.joint_update import MEMORY

Array = npt.NDArray[np.float64]


def hand_over(
    old: Models, new: Models, X_FG: Array, dt: float, axis_distance: float
) -> tuple[Array, Array]:
    """Gives the models `new`, started at G, the axes, types and signs of `old`, in place.

    Axis and point become a prior, normalised so that evidence stays comparable.

    Args:
        old: At their newest packet.
        new: Just started.
        X_FG: (4, 4).
        dt: From the newest packet to the new reference, [s].
        axis_distance: See `Priors`.

    Returns:
        Configurations (2,) at the new reference, prismatic and revolute, and their variances (2,).
    """
    q, variance = np.zeros(2), np.zeros(2)
    X_GF = se3.inverse(X_FG)
    for kind in (PRISMATIC, REVOLUTE):
        n = dimension(kind)
        time = np.array([1.0, dt])
        gain = time @ old.gain[kind][:, :n]
        q[kind] = time @ old.state[kind]
        variance[kind] = time @ old.P[kind] @ time + gain @ old.covariance[kind, :n, :n] @ gain
        a, J = _seen_from(old.a[kind], X_GF)
        c = X_GF[:3, :3] @ old.c[kind] + X_GF[:3, 3]
        along = float(a @ c)
        new.a[kind], new.c[kind] = a, c - along * a if kind == REVOLUTE else 0.0
        T = np.eye(n - 6)
        T[:2, :2] = J
        if kind == REVOLUTE:  # A tilt moves the point that is nearest to Go.
            T[2:, :2], T[2:, 2:] = along * J, J
        covariance = symmetric(T @ old.covariance[kind, 6:n, 6:n] @ T.T)
        information = np.linalg.inv(covariance)
        vague = np.diag([AXIS_SPREAD**-2.0] * 2 + [axis_distance**-2.0] * 2)[: n - 6, : n - 6]
        E = np.empty((10, 12))
        embedding(a, E)
        new.prior_information[kind] = E[6:n].T @ information @ E[6:n]
        new.prior_a[kind], new.prior_c[kind] = a, new.c[kind]
        new.prior_value[kind] = 0.5 * (
            np.linalg.slogdet(vague + information)[1] - np.linalg.slogdet(vague)[1]
        )
        new.covariance[kind, 6:n, 6:n] = covariance
        new.state[kind, 1], new.density[kind] = old.state[kind, 1], old.density[kind]
        new.signed[kind] = 1.0
    new.carried[:] = np.maximum(old.log_evidence - old.log_evidence.max(), -MEMORY)
    new.log_evidence[:] += new.carried
    return q, variance


def _seen_from(a_F: Array, X_GF: Array) -> tuple[Array, Array]:
    """The axis (3,) in G, and its tangent coordinates there per those in F (2, 2)."""
    a_G = X_GF[:3, :3] @ a_F
    a_G /= np.linalg.norm(a_G)
    B_F, B_G = np.empty((2, 3)), np.empty((2, 3))
    tangent_basis(a_F, B_F)
    tangent_basis(a_G, B_G)
    return a_G, B_G @ X_GF[:3, :3] @ B_F.T
