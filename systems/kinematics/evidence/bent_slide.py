"""How likely a hinge far away is while its path is hardly told from a straight one, compiled.

A hinge at a distance d whose child slides along u turns it by the curvature vector k, |k| = 1 / d,
normal to u: the slide's twist per metre is (k, u) instead of (0, u). For a path that is short
against d the measurements are linear in k, and its likelihood is normal; that of the axis' place is
not, for all places far away explain a straight path. So the evidence of such a hinge is an integral
over k, about the slide's own solution.
"""

import numpy as np

from crossmodal.maths import cholesky
from crossmodal.maths.arrays import Array
from crossmodal.maths.compiled import hot
from crossmodal.systems.kinematics.evidence.deviation_series import Waves, marginalise
from crossmodal.systems.kinematics.keyframes.pose_keyframes import Keyframes
from crossmodal.systems.kinematics.solver.joint_chain import new_chain, run_chain
from crossmodal.systems.kinematics.solver.joint_geometry import (
    BENT_SLIDE,
    PARAMETERS,
    PRISMATIC,
    dimension,
)
from crossmodal.systems.kinematics.solver.joint_linearisation import (
    Linear,
    add_prior,
)
from crossmodal.systems.kinematics.solver.joint_models import AXIS_SPREAD, Models, has_prior
from crossmodal.systems.kinematics.solver.joint_solver import Priors
from crossmodal.systems.kinematics.solver.parameter_priors import axis_prior

_POINTS = 20  # Points of the integral, in distance and in direction each.
_DEVIATIONS = 6.0  # Standard deviations beyond which a curvature is left out.
_NEAREST, _FARTHEST = 0.05, 64.0  # Range of an axis' distance, by the nearest scale.


@hot
def log_mean_likelihood(L: Array, b: Array, sigma: float) -> float:
    """Log of the mean over all hinges of exp(|b|^2 / 2 - |L^T k - b|^2 / 2).

    That is how likely their curvature k is, against none.

    Args:
        L: (2, 2) lower factor of the information about k, [m].
        b: (2,) L^-1 of its information vector.
        sigma: Of the axis' place, see `axis_prior`, [m].
    """
    k1 = b[1] / L[1, 1]
    k0 = (b[0] - L[1, 0] * k1) / L[0, 0]
    k, width = np.sqrt(k0 * k0 + k1 * k1), _DEVIATIONS / min(L[0, 0], L[1, 1])
    low = max(k - width, 1.0 / (_FARTHEST * sigma))
    high = min(k + width, 1.0 / (_NEAREST * sigma))
    if low >= high:
        return -np.inf
    half = min(np.pi, width / k) if k > 0.0 else np.pi
    by_distance, by_direction = np.log(high / low) / _POINTS, 2.0 * half / _POINTS
    first, total = np.arctan2(k1, k0) - half, 0.0
    for i in range(_POINTS):
        k = low * np.exp((i + 0.5) * by_distance)
        likelihood = 0.0
        for j in range(_POINTS):
            angle = first + (j + 0.5) * by_direction
            x, y = k * np.cos(angle), k * np.sin(angle)
            u, v = L[0, 0] * x + L[1, 0] * y - b[0], L[1, 1] * y - b[1]
            likelihood += np.exp(-0.5 * (u * u + v * v))
        # The axis' place is in a plane, where distances d = 1 / k have the area d^2 d(log d).
        total += likelihood * np.exp(axis_prior(k**-2.0, sigma, True)[0]) / k**2
    mean = total * by_distance * by_direction / (2.0 * np.pi)
    return 0.5 * (b[0] * b[0] + b[1] * b[1]) + np.log(mean)


@hot
def far_evidence(m: Models, kf: Keyframes, priors: Priors, waves: Waves, lin: Linear) -> float:
    """Log evidence of a hinge far away over that of the prismatic model, which must be solved.

    From the keyframes linearised about a bent slide with smooth errors, no prior added yet.
    """
    more, zero = int(waves.variance.size), int(np.int64(0))
    chain, still = new_chain(kf.time.size, more), np.zeros(PARAMETERS + more)
    slide = int(np.int64(PRISMATIC))  # For a literal, Numba would compile all callees again.
    if has_prior(slide, m):
        add_prior(slide, m, lin)
    for i in range(6, 8):
        lin.information[i, i] += 1.0 / AXIS_SPREAD**2
    n, S, J = dimension(BENT_SLIDE), m.process_noise[PRISMATIC], priors.jump_noise
    q, speed = m.q[PRISMATIC], priors.speed
    run_chain(n + more, S, J, priors.jumps, speed, 1.0, q, kf, lin, still, zero, chain)
    marginalise(n, waves, chain)
    cholesky.factor(chain.H, n)
    for i in range(n):
        chain.step[i] = chain.h[i]
    cholesky.forward(chain.H, chain.step, n)
    return log_mean_likelihood(chain.H[8:10, 8:10], chain.step[8:10], priors.axis_distance)
