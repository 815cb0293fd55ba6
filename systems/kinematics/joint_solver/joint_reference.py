"""The transfer of priors to a new reference: axes and types go on, keyframes do not.

Frames: F the old reference, G the new one.
"""

from dataclasses import dataclass

import numpy as np

from maths import se3
from maths.arrays import Array
from maths.gaussian import symmetric
from maths.tangent_plane import normal_basis
from systems.kinematics.joint_solver.joint_geometry import (
    PRISMATIC,
    REVOLUTE,
    dimension,
)
from systems.kinematics.joint_solver.joint_linearisation import embedding
from systems.kinematics.joint_solver.joint_models import AXIS_SPREAD, Models
from systems.kinematics.joint_solver.joint_readout import read_configuration
from systems.kinematics.joint_solver.joint_update import MEMORY


@dataclass(kw_only=True)
class ConfigurationPrior:
    """The configurations at a reference, for the prismatic and the revolute model.

    They are functions of the axis, linearised: a path of known length is a smaller angle about a
    farther axis, and later measurements may find the axis to be another.

    Attributes:
        q: (2,) for axis a (2, 3) and point c (2, 3), in the reference frame.
        variance: (2,) given axis and point.
        slope: (2, 4) per tangent coordinates of axis and point at a.
    """

    q: Array
    variance: Array
    slope: Array
    a: Array
    c: Array


ZERO_CONFIGURATION = ConfigurationPrior(
    q=np.zeros(2),
    variance=np.zeros(2),
    slope=np.zeros((2, 4)),
    a=np.tile([0.0, 0.0, 1.0], (2, 1)),
    c=np.zeros((2, 3)),
)


def prior_configuration(prior: ConfigurationPrior, kind: int, m: Models) -> tuple[float, Array]:
    """The configuration at the reference for the models' axis, and its slope (n - 6,) there."""
    if prior is ZERO_CONFIGURATION:
        return 0.0, np.zeros(dimension(kind) - 6)
    B_prior, B = normal_basis(prior.a[kind]), normal_basis(m.a[kind])
    along = np.concatenate([m.a[kind] - prior.a[kind], m.c[kind] - prior.c[kind]]).reshape(2, 3)
    slope = prior.slope[kind].reshape(2, 2)
    q = prior.q[kind] + np.sum(slope * (along @ B_prior.T))
    return float(q), (slope @ B_prior @ B.T).ravel()[: dimension(kind) - 6]


def transfer_prior(
    old: Models,
    prior: ConfigurationPrior,
    W_zero: Array,
    new: Models,
    X_FG: Array,
    dt: float,
    axis_distance: float,
) -> ConfigurationPrior:
    """Gives the models `new`, started at G, what `old` know of axes, types and signs, in place.

    Axis and point become a Gaussian prior, normalised so that evidence stays comparable.

    Args:
        old: At their newest keyframe.
        prior: Of the configurations at F.
        W_zero: See `read_configuration`.
        new: Just started.
        X_FG: (4, 4).
        dt: From the newest keyframe to the new reference, [s].
        axis_distance: See `Priors`.

    Returns:
        The prior of the configurations at G.
    """
    q, variance, slope = np.zeros(2), np.zeros(2), np.zeros((2, 4))
    X_GF = se3.inverse(X_FG)
    for kind in (PRISMATIC, REVOLUTE):
        n = dimension(kind)
        time = np.array([1.0, dt])
        state, sensitivity = read_configuration(kind, old, W_zero)
        q_prior, slope_prior = prior_configuration(prior, kind, old)
        gain = sensitivity @ time
        gain[6:] += slope_prior
        Sigma = old.covariance[kind, :n, :n]
        of_axis = gain[6:] + np.linalg.solve(Sigma[6:, 6:], Sigma[6:, :6] @ gain[:6])
        q[kind] = time @ state + q_prior
        variance[kind] = prior.variance[kind] + time @ old.P[kind] @ time
        variance[kind] += gain @ Sigma @ gain - of_axis @ Sigma[6:, 6:] @ of_axis
        a, J = _seen_from(old.a[kind], X_GF)
        c = X_GF[:3, :3] @ old.c[kind] + X_GF[:3, 3]
        along = float(a @ c)
        new.a[kind], new.c[kind] = a, c - along * a if kind == REVOLUTE else 0.0
        T = np.eye(n - 6)
        T[:2, :2] = J
        if kind == REVOLUTE:  # A tilt moves the point that is nearest to Go.
            T[2:, :2], T[2:, 2:] = along * J, J
        slope[kind, : n - 6] = np.linalg.solve(T.T, of_axis)
        covariance = symmetric(T @ Sigma[6:, 6:] @ T.T)
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
        new.state[kind, 1], new.process_noise[kind] = old.state[kind, 1], old.process_noise[kind]
        new.signed[kind] = 1.0
    new.marginal_evidence[:] = np.maximum(old.log_evidence - old.log_evidence.max(), -MEMORY)
    new.log_evidence[:] += new.marginal_evidence
    return ConfigurationPrior(
        q=q, variance=variance, slope=slope, a=new.a[:2].copy(), c=new.c[:2].copy()
    )


def _seen_from(a_F: Array, X_GF: Array) -> tuple[Array, Array]:
    """The axis (3,) in G, and its tangent coordinates there per those in F (2, 2)."""
    a_G = X_GF[:3, :3] @ a_F
    a_G /= np.linalg.norm(a_G)
    return a_G, normal_basis(a_G) @ X_GF[:3, :3] @ normal_basis(a_F).T
