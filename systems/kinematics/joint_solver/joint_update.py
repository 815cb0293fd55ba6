"""One update of the joint models with one relative pose, all in place."""

import numpy as np

from maths.arrays import Array
from maths.compiled import hot
from systems.kinematics.joint_solver import pose_packets
from systems.kinematics.joint_solver.joint_geometry import PRISMATIC, REVOLUTE
from systems.kinematics.joint_solver.joint_linearisation import (
    add_packets,
    clear,
    embedding,
    new_linear,
    prior_offset,
)
from systems.kinematics.joint_solver.joint_models import Models
from systems.kinematics.joint_solver.joint_solver import (
    Priors,
    solve_moving,
    solve_still,
)
from systems.kinematics.joint_solver.joint_start import decide_sign, fresh_start, turn
from systems.kinematics.joint_solver.pose_packets import Packets

_STEPS = 6  # Linearisations per update at most,
_FRESH_STEPS = 8  # and from a fresh start.
MEMORY = 40.0  # Nats by which packets no longer in memory can speak against a model.
_MOVING = (PRISMATIC, REVOLUTE)


@hot
def _forget_configuration(m: Models, p: Packets, k: int) -> None:
    for kind in range(2):
        for i in range(k, p.size[0]):
            m.q[kind, i] = m.q[kind, i + 1]


@hot
def remember(
    m: Models, p: Packets, X_FB: Array, R: Array, time: float, priors: Priors, room: bool
) -> int:
    """Appends one pose, two packets averaged for it if there is no room.

    Returns:
        -1, or the packet that has to be dropped first, nothing done.
    """
    if not room:
        k, average = pose_packets.choose(p, priors.coarseness)
        if not average:
            return k
        pose_packets.merge(p, k, priors.walk_rate)
        _forget_configuration(m, p, k + 1)
    pose_packets.append(p, X_FB, R, time, priors.walk_rate)
    p.walk[0] = min(max(p.walk[0], -MEMORY), MEMORY)
    last, dt = p.size[0] - 1, time - p.time[p.size[0] - 2]
    for kind in range(2):
        m.q[kind, last] = m.state[kind, 0] + dt * m.state[kind, 1]
    return -1


def solve_all(m: Models, p: Packets, priors: Priors, steps: int) -> None:
    """Solves all four models, linearised at most `steps` times each."""
    for kind in _MOVING:
        solve_moving(kind, m, p, priors, steps)
    solve_still(m, p, priors.axis_distance)


def drop(m: Models, p: Packets, k: int, priors: Priors) -> None:
    """Removes packet k, and keeps what it said about theta (its q left free) and as evidence."""
    before = m.log_evidence.copy()
    d, T, lin = np.empty(12), np.empty((10, 12)), new_linear(p.time.size)
    for kind in range(3):
        m.signed[kind] = 1.0
        prior_offset(kind, m, d)
        gradient = m.prior_vector[kind] - m.prior_information[kind] @ d
        m.prior_value[kind] += 0.5 * (d @ (m.prior_vector[kind] + gradient))
        m.prior_Y[kind], m.prior_a[kind], m.prior_c[kind] = m.Y[kind], m.a[kind], m.c[kind]
        clear(lin)
        add_packets(kind, m, p, k, k + 1, lin)
        lower = np.tril(lin.information, -1)
        information = lower + lower.T + np.diag(np.diagonal(lin.information))
        embedding(m.a[kind], T)
        m.prior_information[kind] += T.T @ information @ T
        m.prior_vector[kind] = gradient + T.T @ lin.vector
        m.prior_value[kind] += lin.value[0]
    pose_packets.drop(p, k, priors.walk_rate)
    _forget_configuration(m, p, k)
    solve_all(m, p, priors, 2)
    m.carried[:] += before - m.log_evidence
    m.carried[:] = np.maximum(m.carried - m.carried.max(), -MEMORY)


def _copy_model(kind: int, source: Models, target: Models) -> None:
    for name in ("Y", "a", "c", "q", "state", "covariance", "gain", "P", "density", "log_evidence"):
        getattr(target, name)[kind] = getattr(source, name)[kind]


def restart(m: Models, p: Packets, priors: Priors) -> None:
    """Takes over the moving models that explain more from a fresh start."""
    other = Models(*[x.copy() for x in m])
    fresh_start(other, p, priors.axis_distance)
    for kind in _MOVING:
        solve_moving(kind, other, p, priors, _FRESH_STEPS)
        if other.log_evidence[kind] > m.log_evidence[kind] + 0.1:
            if other.state[kind, 0] * m.state[kind, 0] < 0.0:
                turn(kind, other)
            _copy_model(kind, other, m)


def update(
    m: Models, p: Packets, X_FB: Array, R: Array, time: float, priors: Priors, young: bool
) -> None:
    """Corrects all models with one relative pose.

    Args:
        m: Models.
        p: Packets, the reference at least.
        X_FB: Pose (4, 4) relative to the measured reference.
        R: Its covariance (6, 6), in B.
        time: [s].
        priors: See `Priors`.
        young: Whether to try a fresh start beside the last solution.
    """
    k = remember(m, p, X_FB, R, time, priors, bool(p.size[0] < p.time.size))
    if k >= 0:
        drop(m, p, k, priors)
        remember(m, p, X_FB, R, time, priors, True)
    solve_all(m, p, priors, _STEPS)
    if young:
        restart(m, p, priors)
    for kind in _MOVING:
        decide_sign(kind, m)
