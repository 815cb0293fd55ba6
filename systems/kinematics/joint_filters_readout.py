"""What is believed of one pair of bodies, read from what their joint filters know."""

import numpy as np

from maths.arrays import Array
from maths.gaussian import symmetric
from systems.kinematics.goodness_of_fit import reduced_chi_square
from systems.kinematics.joint_filters_config import JointFiltersConfig
from systems.kinematics.joint_filters_state import JointFiltersState
from systems.kinematics.joint_solver.joint_geometry import (
    SCREW,
    dimension,
    turns,
)
from systems.kinematics.joint_solver.joint_pitch import pitch_posterior
from systems.kinematics.joint_solver.joint_readout import (
    read_axis,
    read_configuration,
)
from systems.kinematics.joint_solver.path_floor import FLOORS
from systems.port_values import JointFit, JointModelBelief

_NO_VECTOR, _NO_MATRIX = np.full(3, np.nan), np.full((3, 3), np.nan)


def read_joint(
    state: JointFiltersState, kind: int, dt: float, config: JointFiltersConfig
) -> JointModelBelief:
    """What is believed of one kind of moving joint, predicted dt [s] ahead."""
    m, n = state.models, dimension(kind)
    vectors, axis, point = read_axis(kind, m, state.X_PF, config.axis_distance)
    displaced = state.reference_noise + state.offset
    configuration, sensitivity, variance = read_configuration(kind, m, state.W_zero, displaced)
    q_covariance = sensitivity.T @ m.covariance[kind, :n, :n] @ sensitivity + m.P[kind]
    q_covariance[0, 0] += state.zero_variance[kind] + variance
    if dt > 1e-9:
        S = config.unmeasured_process_noise
        if turns(kind):
            S /= config.radius**2 + float(m.c[kind] @ m.c[kind]) + m.pitch[kind] ** 2
        configuration, q_covariance = _predicted(configuration, q_covariance, S, dt)
    pitch, pitch_variance = np.nan, np.nan
    if kind == SCREW:
        pitch, pitch_variance = pitch_posterior(m.pitch[kind], m.covariance[kind, 10, 10])
    return JointModelBelief(
        log_evidence=float(state.models.log_evidence[kind]),
        axis_P=vectors[0],
        axis_covariance=axis,
        p_PA=vectors[1],
        p_PA_covariance=point,
        configuration=configuration,
        configuration_covariance=symmetric(q_covariance),
        pitch=pitch,
        pitch_variance=pitch_variance,
    )


def read_fit(state: JointFiltersState, kind: int) -> JointFit:
    """How well one kind of joint fits the measurements."""
    value, bounds, degrees = reduced_chi_square(kind, state.models, state.keyframes, state.noise)
    return JointFit(
        reduced_chi_square=value,
        bounds=bounds,
        degrees=degrees,
        outlier_share=state.outliers / max(state.updates, 1),
        noise_scale=(float(state.scale[0]), float(state.scale[3])),
        path_floor=FLOORS[state.floor],
    )


def _predicted(x: Array, P: Array, S: float, dt: float) -> tuple[Array, Array]:
    """Configuration and rate (2,), and their covariance, a time dt [s] later.

    What is not measured goes on as it went, with the density of acceleration S, or has stopped at
    once: an equal mixture of both.
    """
    F = np.array([[1.0, dt], [0.0, 1.0]])
    goes_on = F @ P @ F.T + S * np.array([[dt**3 / 3.0, dt**2 / 2.0], [dt**2 / 2.0, dt]])
    stopped, rests = np.array([x[0], 0.0]), np.diag([P[0, 0], 0.0])
    apart = F @ x - stopped
    return stopped + 0.5 * apart, 0.5 * (goes_on + rests) + 0.25 * np.outer(apart, apart)


def still_joint(log_evidence: float) -> JointModelBelief:
    """What is believed of what has neither axis nor configuration: rigid, or disconnected."""
    return JointModelBelief(
        log_evidence=log_evidence,
        axis_P=_NO_VECTOR,
        axis_covariance=_NO_MATRIX,
        p_PA=_NO_VECTOR,
        p_PA_covariance=_NO_MATRIX,
        configuration=_NO_VECTOR[:2],
        configuration_covariance=_NO_MATRIX[:2, :2],
    )
