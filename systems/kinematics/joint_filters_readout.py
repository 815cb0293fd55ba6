"""What is believed of one pair of bodies, read from what their joint filters know."""

import numpy as np

from crossmodal.systems.kinematics.joint_filters_config import JointFiltersConfig
from crossmodal.systems.kinematics.joint_filters_state import JointFiltersState
from crossmodal.systems.kinematics.joint_solver.joint_geometry import SCREW, turns
from crossmodal.systems.kinematics.joint_solver.joint_pitch import pitch_posterior
from crossmodal.systems.kinematics.joint_solver.joint_readout import read_moving
from crossmodal.systems.port_values import JointModelBelief

_NO_VECTOR, _NO_MATRIX = np.full(3, np.nan), np.full((3, 3), np.nan)


def read_joint(
    state: JointFiltersState, kind: int, dt: float, config: JointFiltersConfig
) -> JointModelBelief:
    """What is believed of one kind of moving joint, predicted dt [s] ahead."""
    m, S = state.models, config.unmeasured_process_noise
    if turns(kind):
        S /= config.radius**2 + float(m.c[kind] @ m.c[kind]) + float(m.pitch[kind]) ** 2
    vectors, axis, point, configuration, covariance = read_moving(
        kind,
        m,
        state.covariance[kind],
        state.X_PF,
        config.axis_distance,
        state.W_zero,
        state.reference_noise + state.offset,
        float(state.zero_variance[kind]),
        S,
        dt,
    )
    pitch, pitch_variance = np.nan, np.nan
    if kind == SCREW:
        pitch, pitch_variance = pitch_posterior(m.pitch[kind], state.covariance[kind, 10, 10])
    return JointModelBelief(
        log_evidence=float(state.models.log_evidence[kind]),
        axis_P=vectors[0],
        axis_covariance=axis,
        p_PA=vectors[1],
        p_PA_covariance=point,
        configuration=configuration,
        configuration_covariance=covariance,
        pitch=pitch,
        pitch_variance=pitch_variance,
    )


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
