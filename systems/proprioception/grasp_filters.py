"""Filters of the grasp types side by side: how the body moves in the bent hand.

What is measured is z = X_WH^-1 X_WB, the hand from proprioception and the body from vision. With
z_0 at the reference, e = J c + L n the hand's error (J its bias Jacobian, L its noise square root)
and v that of vision, a grasp says

    z = exp(e - e_0) E z_0 exp(v),   E = exp(turn phi + slide d)

with E the identity for a perfect grasp, d = 0 for a revolute one. Axis and point are expressed in
H where proprioception puts it: what is constant in the hand's error moves them with it, cannot be
told from them, and does no harm there. The error state of each filter is (c, n, axis (2),
point (2), phi, d), cut to what the type has; errors of axis and point are in `normal_basis(axis)`.
A failed grasp lets the body stay where it was, loosely.
"""

from dataclasses import dataclass, replace

import numpy as np

from crossmodal.maths import error_state, se3
from crossmodal.maths.arrays import Array
from crossmodal.maths.compiled import assign, hot
from crossmodal.maths.gaussian import joseph_update, log_likelihood, nees, symmetric
from crossmodal.maths.vectors import cross, normal_basis, transport
from crossmodal.systems.port_values import GraspBelief, GraspType
from crossmodal.systems.proprioception.bent_hand import BentHand, free_rotation, free_sliding, screw
from crossmodal.systems.proprioception.grasp_model_config import GraspModelConfig

HELD_TYPES = (GraspType.PERFECT, GraspType.REVOLUTE, GraspType.CYLINDRICAL)
_PLAUSIBLE = 3.0  # Deviation from the morphology that costs nothing, in standard deviations.
_BEYOND = 100.0  # Cost of each standard deviation beyond, [nat].
_COORDINATES = {GraspType.PERFECT: 0, GraspType.REVOLUTE: 1, GraspType.CYLINDRICAL: 2}


@dataclass(kw_only=True)
class GraspFilter:
    """One type's belief; never written after it is made.

    Attributes:
        type: Perfect, revolute or cylindrical.
        z_0: X_HB (4, 4) at its reference, with the hand's bias Jacobian (6, m) there.
        axis: Unit vector (3,) in H as measured, through point (3,), [m].
        coordinates: (phi [rad], d [m]).
        line_covariance: (6, 6) of (axis, point), as the best single tick tells them.
        x: Mean (m + 6,) of (c, n).
        P: Covariance of (c, n, axis, point, coordinates).
        displacement: Of the hand since the reference, [m].
        rejection_count: Ticks in a row at which the gate rejected the measurement.
    """

    type: GraspType
    z_0: Array
    bias_jacobian_0: Array
    axis: Array
    point: Array
    coordinates: Array
    line_covariance: Array
    x: Array
    P: Array
    displacement: float = 0.0
    rejection_count: int = 0


def start_filter(
    grasp_type: GraspType, z_0: Array, bias_jacobian_0: Array, config: GraspModelConfig
) -> GraspFilter:
    """A filter at its reference, with the hand's morphology as prior."""
    axis, point = config.hand.grasping_axis
    errors = bias_jacobian_0.shape[1] + 6
    line = prior_line_variances(bias_jacobian_0, config)
    variances = [1.0] * errors
    if grasp_type != GraspType.PERFECT:
        variances += [*line, *([1e-12] * _COORDINATES[grasp_type])]
    U = np.kron(np.eye(2), normal_basis(axis).T)
    return GraspFilter(
        type=grasp_type,
        z_0=z_0,
        bias_jacobian_0=bias_jacobian_0,
        axis=axis,
        point=point,
        coordinates=np.zeros(2),
        line_covariance=U @ np.diag(line) @ U.T,
        x=np.zeros(errors),
        P=np.diag(variances),
    )


def prior_line_variances(bias_jacobian_0: Array, config: GraspModelConfig) -> Array:
    """Prior variances (4,) of the axis (2) and the point (2) across it.

    The bar lies elsewhere in the hand, and the hand is not where it seems to be.
    """
    offset = (bias_jacobian_0**2).sum(axis=1).reshape(2, 3).mean(axis=1)
    own = np.array([config.axis_deviation**2, config.point_deviation**2])
    return np.repeat(own + offset, 2)


@hot
def grasp_displacement(axis: Array, point: Array, coordinates: Array) -> tuple[Array, Array]:
    """E (4, 4), and its derivative (6, 6): left perturbation by (axis, point, phi, d)."""
    phi, d = coordinates
    B = normal_basis(axis)
    tau = screw(axis, point) * phi
    tau[3:] += axis * d
    D = np.zeros((6, 6))
    for i in range(2):
        assign(D[:3, i], phi * B[i])
        assign(D[3:, i], phi * cross(point, B[i]) + d * B[i])
        assign(D[3:, 2 + i], phi * cross(B[i], axis))
    assign(D[:, 4], screw(axis, point))
    assign(D[3:, 5], axis)
    return se3.exp(tau), se3.left_jacobian(tau) @ D


def predict_filter(
    grasp: GraspFilter, config: GraspModelConfig, displacement: float
) -> GraspFilter:
    """One tick: the bent hand's error is a Gauss-Markov process, all else a random walk."""
    m = len(grasp.x) - 6
    rho = np.exp(-config.period / config.hand.correlation_time)
    x, P = error_state.fade(grasp.x, grasp.P, slice(m, m + 6), rho)
    Q = np.zeros(len(P))
    rates = np.array([config.rotation_process_noise, config.sliding_process_noise])
    count = _COORDINATES[grasp.type]
    if count:
        Q[-count:] = rates[:count] ** 2 * config.period
    line = (
        np.repeat([config.axis_process_noise**2, config.point_process_noise**2], 3) * config.period
    )
    if count:
        Q[m + 6 : m + 10] = line[[0, 1, 3, 4]]
    return replace(
        grasp,
        x=x,
        P=P + np.diag(Q),
        line_covariance=grasp.line_covariance + np.diag(line),
        displacement=grasp.displacement + displacement,
    )


def expected(
    grasp: GraspFilter, bias_jacobian: Array, noise_square_root: Array
) -> tuple[Array, Array]:
    """The z that a filter expects (4, 4), and the left derivative by its error state (6, n)."""
    m = bias_jacobian.shape[1]
    E, D = grasp_displacement(grasp.axis, grasp.point, grasp.coordinates)
    change = bias_jacobian - grasp.bias_jacobian_0
    e = change @ grasp.x[:m] + noise_square_root @ grasp.x[m:]
    H = np.hstack([change, noise_square_root, D[:, : len(grasp.P) - m - 6]])
    return se3.exp(e) @ E @ grasp.z_0, H


def correct_filter(
    grasp: GraspFilter,
    z: Array,
    R: Array,
    hand: BentHand,
    noise_square_root: Array,
    config: GraspModelConfig,
) -> tuple[GraspFilter, float]:
    """The filter after the measurement z, and its log likelihood before.

    Args:
        z: X_HB (4, 4), with white noise R (6, 6) expressed in H.
        noise_square_root: Of the hand's other errors (6, 6), those of the landmarks among them.
    """
    slip = np.diag(config.hand.slip * grasp.displacement)
    noise = noise_square_root @ noise_square_root.T + slip
    noise_square_root = np.asarray(np.linalg.cholesky(noise), dtype=float)
    predicted, H = expected(grasp, hand.bias_jacobian, noise_square_root)
    innovation = se3.log(z @ se3.inverse(predicted))
    R = R + second_order_noise(grasp)
    S = symmetric(H @ grasp.P @ H.T + R)
    likelihood = log_likelihood(innovation, S)
    if nees(innovation, S) > config.gate:
        return replace(grasp, rejection_count=grasp.rejection_count + 1), likelihood
    correction, P = joseph_update(grasp.P, np.ascontiguousarray(H), R, innovation)
    errors = len(grasp.x)
    theta = np.zeros(6)
    theta[: len(correction) - errors] = correction[errors:]
    B = normal_basis(grasp.axis)
    axis = grasp.axis + theta[:2] @ B
    axis /= np.linalg.norm(axis)
    if grasp.type != GraspType.PERFECT:  # The basis at the axis turns with it.
        Q, T = np.empty((2, 2)), np.eye(len(P))
        transport(grasp.axis, axis, Q)
        T[errors : errors + 4, errors : errors + 4] = np.kron(np.eye(2), Q)
        P = T @ P @ T.T
    corrected = replace(
        grasp,
        axis=axis,
        point=grasp.point + theta[2:4] @ B,
        coordinates=grasp.coordinates + theta[4:],
        x=grasp.x + correction[:errors],
        P=P,
        rejection_count=0,
    )
    if grasp.type != GraspType.PERFECT:
        U = np.kron(np.eye(2), normal_basis(axis).T)
        known = U.T @ corrected.line_covariance @ U
        single = single_tick_line_covariance(corrected, hand, noise_square_root, R, config)
        smaller = known if np.linalg.det(single) > np.linalg.det(known) else single
        corrected = replace(corrected, line_covariance=U @ smaller @ U.T)
    return corrected, likelihood


def second_order_noise(grasp: GraspFilter) -> Array:
    """Covariance (6, 6) of what the linear measurement leaves out: uncertain angle times line.

    Without it, an angle that is mere noise would seem to measure the axis.
    """
    count, start = _COORDINATES[grasp.type], len(grasp.x)
    noise = np.zeros((6, 6))
    if count == 0:
        return noise
    variances = np.diag(grasp.P)[-count:]
    U = normal_basis(grasp.axis).T
    axis = U @ grasp.P[start : start + 2, start : start + 2] @ U.T
    point = U @ grasp.P[start + 2 : start + 4, start + 2 : start + 4] @ U.T
    noise[:3, :3] = variances[0] * axis
    noise[3:, 3:] = variances[0] * point
    if count == 2:
        noise[3:, 3:] += variances[1] * axis
    return noise


def single_tick_line_covariance(
    grasp: GraspFilter, hand: BentHand, noise_square_root: Array, R: Array, config: GraspModelConfig
) -> Array:
    """Covariance (4, 4) of axis and point across the axis, from this tick's displacement alone.

    The hand's errors persist, so that many ticks tell little more about the line than the best of
    them. The filter's own covariance claims more: its angle, and with it how the line and those
    errors show in the measurement, is noisy, and so it takes for different what is the same.
    """
    change = hand.bias_jacobian - grasp.bias_jacobian_0
    C = change @ change.T + noise_square_root @ noise_square_root.T + R
    _, D = grasp_displacement(grasp.axis, grasp.point, grasp.coordinates)
    D = D[:, : 4 + _COORDINATES[grasp.type]]
    information = D.T @ np.linalg.solve(C, D)
    information[:4, :4] += np.diag(1.0 / prior_line_variances(grasp.bias_jacobian_0, config))
    return np.asarray(np.linalg.inv(information)[:4, :4])


def follow(grasp: GraspFilter, z: Array, hand: BentHand, noise_square_root: Array) -> GraspFilter:
    """Moves the coordinates to where `z` is, without learning anything from it.

    For z that was computed through the grasp itself: it may not confirm the grasp.
    """
    count = _COORDINATES[grasp.type]
    if count == 0:
        return grasp
    predicted, _ = expected(grasp, hand.bias_jacobian, noise_square_root)
    nu = se3.log(z @ se3.inverse(predicted))
    moved = np.array([grasp.axis @ nu[:3], grasp.axis @ (nu[3:] + cross(nu[:3], grasp.point))])
    moved[count:] = 0.0
    return replace(grasp, coordinates=grasp.coordinates + moved)


def plausibility(grasp: GraspFilter, config: GraspModelConfig) -> float:
    """At most zero: how far the errors that a filter has assumed exceed what is usual, [nat].

    The memory of the evidence is bounded; this keeps a type from becoming likely again after it
    has explained an impossible motion by impossible errors or an impossible axis.
    """
    excess = max(0.0, float(grasp.x @ grasp.x) - len(grasp.x))
    if grasp.type == GraspType.PERFECT:
        return -0.5 * excess
    axis, point = config.hand.grasping_axis
    tilt = float(np.arccos(np.clip(grasp.axis @ axis, -1.0, 1.0))) / config.axis_deviation
    shift = float(np.linalg.norm(grasp.point - point)) / config.point_deviation
    beyond = max(0.0, tilt - _PLAUSIBLE) + max(0.0, shift - _PLAUSIBLE)
    return -0.5 * excess - _BEYOND * beyond


def free_projection(grasp_type: GraspType, axis: Array, point: Array) -> Array:
    """The hand's twists (6, 6), in H at Ho, that the body does not follow."""
    if grasp_type == GraspType.FAILED:
        return np.eye(6)
    if grasp_type == GraspType.REVOLUTE:
        return free_rotation(axis, point)
    if grasp_type == GraspType.CYLINDRICAL:
        return free_rotation(axis, point) + free_sliding(axis, point)
    return np.zeros((6, 6))


def if_held(grasp: GraspBelief) -> GraspBelief:
    """What is believed of a grasp if it has not failed."""
    held = max(1.0 - grasp.probabilities[GraspType.FAILED], 1e-9)
    probabilities = {kind: p / held for kind, p in grasp.probabilities.items()}
    probabilities[GraspType.FAILED] = 0.0
    best = max(probabilities, key=lambda kind: probabilities[kind])
    projection = free_projection(best, grasp.axis_H, grasp.p_HA)
    return replace(grasp, probabilities=probabilities, free_motion=projection)
