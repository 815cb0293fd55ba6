"""Where the moving models start while little has moved, and which way q grows.

The first solution can sit in a wrong minimum: its axis fits noise. A fresh start from the principal
direction of the child's twists is tried beside it until the axis is known.
"""

import numpy as np

from crossmodal.maths.arrays import Array
from crossmodal.maths.compiled import hot
from crossmodal.maths.gaussian import symmetric
from crossmodal.maths.se3_in_place import relative_log
from crossmodal.maths.vectors import cross, normal_basis
from crossmodal.systems.kinematics.keyframes.outliers import weigh_residual
from crossmodal.systems.kinematics.keyframes.pose_keyframes import FIRST, MEMORY, Keyframes
from crossmodal.systems.kinematics.solver.joint_geometry import (
    MOVING,
    PARAMETERS,
    PRISMATIC,
    REVOLUTE,
    RIGID,
    SCREW,
    dimension,
    turns,
)
from crossmodal.systems.kinematics.solver.joint_linearisation import embedding
from crossmodal.systems.kinematics.solver.joint_models import (
    AXIS_SPREAD,
    Models,
    has_prior,
    initial_models,
)
from crossmodal.systems.kinematics.solver.parameter_priors import WIDEST, axis_prior, pitch_evidence

_SIGNIFICANT = 4.0  # Standard deviations of q from zero at which its sign is decided.
_MOVED = 10.0  # Log evidence over the rigid model's at which its sign is decided, [nat].


@hot
def _twists(kf: Keyframes, first: int, xi: Array) -> None:
    for k in range(xi.shape[0]):
        relative_log(kf.Z[first], kf.Z[k], xi[k])


def _revolute_start(V: Array, axis_distance: float) -> tuple[Array, Array]:
    """The axis (3,) and its point (3,) of a body that moves along the twist V (6,) at Fo."""
    w, v = V[:3], V[3:]
    speed, rate = float(np.linalg.norm(v)), float(np.linalg.norm(w))
    if speed > 0.3 * rate:  # A rotation about the path's own direction does not bend it.
        w = w - v * (w @ v) / speed**2
        rate = float(np.linalg.norm(w))
    if rate < 1e-9:
        w, rate = normal_basis(v / speed)[0], 1.0
    a = w / np.linalg.norm(w)
    return a, cross(a, v) / max(rate, speed / (1.5 * axis_distance))


def _screw_start(V: Array) -> tuple[Array, Array, float]:
    """The axis (3,), its point (3,) and the pitch of a body that moves along V (6,) at Fo.

    The body moves by no more than a metre per radian.
    """
    w, v = V[:3], V[3:]
    rate = float(np.linalg.norm(w))
    a = w / rate if rate > 1e-9 else normal_basis(v / np.linalg.norm(v))[0]
    square = max(float(w @ w), float(v @ v))
    return a, cross(w, v) / square, float(w @ v) / square


@hot
def _typical(kf: Keyframes, share: float) -> int:
    """Of the oldest keyframes the one that its neighbours agree with best: the first, or, where
    that is an outlier, another."""
    best, top = 0, -np.inf
    r, none = np.empty(6), np.zeros(6)
    count = min(kf.size[0], FIRST)
    for i in range(count):
        if kf.undecided[0] == 0.0 and i > 0:
            break
        total = 0.0
        for k in range(count):
            if kf.undecided[k] > 0.0 and k != i:
                relative_log(kf.Z[i], kf.Z[k], r)
                total += weigh_residual(kf.W, kf.W_out, kf.log_out, k, r, none, share, 2.0)[1]
        if total > top + 1.0:
            best, top = i, total
    return best


def circle_start(m: Models, kf: Keyframes, axis_distance: float) -> None:
    """Starts the revolute model, in place, from the circle that passes by all positions.

    Where rotations are hardly known, an axis shows in how the path bends. The circle is that of
    V. Pratt, "Direct least-squares fitting of algebraic surfaces", 1987, with a prior of its
    curvature: what is nearly straight has noise for a curvature.

    Args:
        kf: Keyframes, at least three.
    """
    n = int(kf.size[0])
    points, weight = kf.Z[:n, :3, 3], 1.0 / np.sqrt(kf.R[:n, 3, 3] + kf.floor[3, 3])
    mean = weight**2 @ points / (weight**2).sum()
    d = points - mean
    along, across, a = np.linalg.svd(weight[:, None] * d)[2]
    u, v = d @ along, d @ across
    # A (u^2 + v^2) + B u + C v + D = 0 with B^2 + C^2 - 4 A D = 1 is a circle of curvature 2 A.
    rows = np.column_stack([u**2 + v**2, u, v, np.ones(n)]) * weight[:, None]
    rows = np.vstack([rows, [2.0 * axis_distance, 0.0, 0.0, 0.0]])
    inverse = np.array([[0.0, 0, 0, -0.5], [0, 1, 0, 0], [0, 0, 1, 0], [-0.5, 0, 0, 0]])
    values, vectors = np.linalg.eig(inverse @ rows.T @ rows)
    best = int(np.argmin(np.where(values.real > 0.0, values.real, np.inf)))
    A, B, C, _ = vectors[:, best].real
    gradient = np.array([B, C])
    if 3.0 * axis_distance * abs(A) < np.linalg.norm(gradient):
        A = np.copysign(np.linalg.norm(gradient) / (3.0 * axis_distance), A)
    x, y = -gradient / (2.0 * A)
    centre = mean + x * along + y * across
    m.a[REVOLUTE], m.c[REVOLUTE] = a, centre - a * (a @ centre)
    angle = np.unwrap(np.arctan2(v - y, u - x)) * np.sign(a @ cross(along, across))
    m.q[REVOLUTE, :n] = angle - angle[0]


def fresh_start(m: Models, kf: Keyframes, axis_distance: float, share: float) -> None:
    """Starts all models, in place, the moving ones from the principal direction of all twists.

    Args:
        kf: Keyframes, at least two.
        axis_distance: See `Priors`; a revolute axis starts no further away than 1.5 times this.
        share: Prior probability of an outlier.
    """
    n = int(kf.size[0])
    R = np.diagonal(kf.R[n - 1])
    scale = np.sqrt(np.repeat([R[:3].mean(), R[3:].mean()], 3))
    xi = np.empty((n, 6))
    first = _typical(kf, share)
    _twists(kf, first, xi)
    weight = R[3] / kf.R[:n, 3, 3]
    d = (xi - weight @ xi / weight.sum()) / scale
    scatter = (d.T * weight) @ d
    a = np.linalg.eigh(scatter[3:, 3:])[1][:, 2]
    m.a[PRISMATIC], m.c[PRISMATIC] = a, 0.0
    m.q[PRISMATIC, :n] = xi[:, 3:] @ a
    principal = np.linalg.eigh(scatter)[1][:, 5] * scale
    m.a[REVOLUTE], m.c[REVOLUTE] = _revolute_start(principal, axis_distance)
    m.a[SCREW], m.c[SCREW], m.pitch[SCREW] = _screw_start(principal)
    for kind in (REVOLUTE, SCREW):
        a, c = m.a[kind], m.c[kind]
        unit = np.concatenate([a, cross(c, a) + m.pitch[kind] * a]) / scale**2
        m.q[kind, :n] = xi @ unit / (unit @ (unit * scale**2))
    m.Y[:] = kf.Z[first]
    for kind in MOVING:
        if has_prior(kind, m) and m.a[kind] @ m.prior_a[kind] < 0.0:
            m.a[kind], m.q[kind] = -m.a[kind], -m.q[kind]


def copy_model(kind: int, source: Models, into: int, target: Models) -> None:
    """Copies the solution of one model for the keyframes in memory to another one, or to others."""
    target.Y[into], target.a[into], target.c[into] = source.Y[kind], source.a[kind], source.c[kind]
    target.pitch[into], target.q[into] = source.pitch[kind], source.q[kind]
    target.inlier[into], target.state[into] = source.inlier[kind], source.state[kind]
    target.covariance[into], target.gain[into] = source.covariance[kind], source.gain[kind]
    target.P[into], target.process_noise[into] = source.P[kind], source.process_noise[kind]
    target.log_evidence[into] = source.log_evidence[kind]


def start_from_revolute(m: Models, kf: Keyframes) -> None:
    """Starts the screw, in place, from the revolute model and what the path climbs along its axis.

    So it knows the turns, which no twist between two poses shows.
    """
    copy_model(REVOLUTE, m, SCREW, m)
    m.signed[SCREW] = m.signed[REVOLUTE]
    n = kf.size[0]
    climbed = (kf.Z[:n, :3, 3] - m.Y[REVOLUTE, :3, 3]) @ m.a[REVOLUTE]
    weighted = m.q[REVOLUTE, :n] / kf.R[:n, 3, 3]
    pitch = weighted @ climbed / max(weighted @ m.q[REVOLUTE, :n], 1e-12)
    m.pitch[SCREW] = min(max(pitch, -WIDEST), WIDEST)


def reverse_axis(kind: int, m: Models) -> None:
    """Reverses the axis, and with it the sign of q, in place; the prior's axis, too."""
    for x in (m.a, m.q, m.prior_a, m.state, m.gain):
        x[kind] *= -1.0
    m.prior_vector[kind, 6:9] *= -1.0
    m.prior_information[kind, 6:9, :] *= -1.0
    m.prior_information[kind, :, 6:9] *= -1.0
    # `tangent_basis(-a)` has the first vector of `tangent_basis(a)` and the opposite of its second.
    for i in (6, 9):
        m.gain[kind, :, i] *= -1.0
        m.covariance[kind, i, :] *= -1.0
        m.covariance[kind, :, i] *= -1.0


def decide_signs(m: Models) -> None:
    """Turns the axes, in place, so that q grows positive in the direction first moved."""
    for kind in MOVING:
        if m.signed[kind] > 0.0:
            continue
        n = dimension(kind)
        gain = m.gain[kind, 0, :n]
        variance = m.P[kind, 0, 0] + gain @ m.covariance[kind, :n, :n] @ gain
        moved = m.log_evidence[kind] > m.log_evidence[RIGID] + _MOVED
        if moved and m.state[kind, 0] ** 2 > _SIGNIFICANT**2 * variance:
            m.signed[kind] = 1.0
        if m.state[kind, 0] < 0.0:
            reverse_axis(kind, m)


def keep_axes(old: Models, axis_distance: float, far: bool) -> Models:
    """Models with what `old` know of axes and types as a prior, before anything is measured anew.

    The prior of axis, point and pitch stands beside the vague one that every solution has; together
    they are the posterior of `old`, normalised so that evidence stays comparable.

    Args:
        old: At their newest keyframe; not changed.
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
        # The vague prior has its mean at Fo and at no pitch.
        new.prior_vector[kind, 9:12] = c * of_place
        new.prior_vector[kind, 12] = old.pitch[kind] / WIDEST**2
        others = np.log(np.delete(vague, slice(2, 4))).sum()
        gain = np.linalg.slogdet(information)[1] - others + (old.pitch[kind] / WIDEST) ** 2
        new.prior_value[kind] = 0.5 * gain - density
    evidence = old.log_evidence.copy()
    # Each solution adds the pitch's part of the evidence anew.
    evidence[SCREW] -= pitch_evidence(old.pitch[SCREW], old.covariance[SCREW, 10, 10])
    new.marginal_evidence[:] = np.maximum(evidence - evidence.max(), -MEMORY)
    return new
