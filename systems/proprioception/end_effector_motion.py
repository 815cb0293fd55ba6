"""Where the end-effector is and how it moves, from joint encoders through forward kinematics."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import JacobianWrtVariable
from pydrake.systems.framework import Context

from crossmodal.maths import se3
from crossmodal.maths.arrays import Array
from crossmodal.maths.gaussian import joseph_update
from crossmodal.maths.validation import check, number
from crossmodal.systems.port_values import EndEffectorBelief, SampleWindow, no_samples
from crossmodal.systems.recursive_filter import RecursiveFilter
from crossmodal.systems.shared_settings import SensorNoise
from crossmodal.systems.ticks import Ticked

# Bounds the joints' offsets near singular postures, [m/rad].
_OFFSET_DAMPING = 0.05


@dataclass(kw_only=True)
class EndEffectorMotionConfig(Ticked):
    noise = SensorNoise()
    # Expected within a window, 1 sigma.
    joint_acceleration: float = number(1.0, at_least=1e-6, at_most=1e4, unit="rad/s^2")
    # White acceleration that drives the velocity.
    angular_process_noise: float = number(0.5, at_least=1e-9, at_most=1000.0, unit="rad/s^1.5")
    # The same for the translation.
    linear_process_noise: float = number(0.2, at_least=1e-9, at_most=1000.0, unit="m/s^1.5")


def fit_joint_samples(
    tau: Array, values: Array, config: EndEffectorMotionConfig
) -> tuple[Array, Array, Array]:
    """Joint positions and velocities at the tick, by least squares over a window.

    Every joint follows q0 + v tau + a tau^2 / 2, where the acceleration has a zero-mean prior.

    Args:
        tau: Sample times (K,) relative to the tick, at most 0, [s]; K >= 1.
        values: Samples (K, 2 n), positions [rad] then velocities [rad/s].

    Returns:
        q0 (n,), v (n,), and the covariance (2, 2) of both, the same for every joint.
    """
    n = values.shape[1] // 2
    ones = np.ones_like(tau)
    A_q = np.column_stack([ones, tau, 0.5 * tau**2])
    A_v = np.column_stack([0.0 * tau, ones, tau])
    w_q, w_v = config.noise.angle**-2, config.noise.rate**-2
    normal = w_q * A_q.T @ A_q + w_v * A_v.T @ A_v
    normal[2, 2] += config.joint_acceleration**-2
    covariance = np.asarray(np.linalg.inv(normal), dtype=float)
    fit = covariance @ (w_q * A_q.T @ values[:, :n] + w_v * A_v.T @ values[:, n:])
    return fit[0], fit[1], covariance[:2, :2]


def predict_motion(
    X: Array, V: Array, covariance: Array, config: EndEffectorMotionConfig
) -> tuple[Array, Array, Array]:
    """One tick of constant velocity: X exp(V dt), V, and the covariance (12, 12) of both."""
    dt = config.period
    step = se3.exp(V * dt)
    F = np.eye(12)
    F[:6, :6] = se3.adjoint(se3.inverse(step))
    F[:6, 6:] = dt * se3.right_jacobian(V * dt)
    q = np.repeat([config.angular_process_noise**2, config.linear_process_noise**2], 3)
    Q = np.zeros((12, 12))
    Q[:6, :6] = np.diag(q * dt**3 / 3.0)
    Q[:6, 6:] = Q[6:, :6] = np.diag(q * dt**2 / 2.0)
    Q[6:, 6:] = np.diag(q * dt)
    return X @ step, V, np.asarray(F @ covariance @ F.T + Q, dtype=float)


def calibration_bias_jacobian(J_E: Array, config: EndEffectorMotionConfig) -> Array:
    """Joint offsets (n, 6) [rad] per unit constant that offset the pose as the calibration does.

    The damped inverse of the Jacobian `J_E` (6, n) of the calibration posture, so that
    `J_E @ result` is close to diag(offset_rotation, offset_translation).
    """
    scale = np.repeat([config.noise.offset_rotation, config.noise.offset_translation], 3)
    gram = J_E @ J_E.T + _OFFSET_DAMPING**2 * np.eye(6)
    return J_E.T @ np.linalg.solve(gram, np.diag(scale))


@dataclass(kw_only=True)
class EndEffectorState:
    """The posterior, its errors sorted by how long they last.

    Attributes:
        X: X_WE (4, 4).
        V: V_WE_E (6,).
        white: Covariance (12, 12) of both, without what follows.
        bias_jacobian: (6, m) pose error in E per unit of each constant of the episode.
        joint_bias_jacobian: Joint offsets per unit constant (n, m); None before the first data.
        common: Covariance (6, 6), in E, of what the pose is off by in common with the last samples.
    """

    X: Array
    V: Array
    white: Array
    bias_jacobian: Array
    joint_bias_jacobian: Array | None
    common: Array


def predict_state(state: EndEffectorState, config: EndEffectorMotionConfig) -> EndEffectorState:
    """The state one tick later; the offset turns with the end-effector."""
    X, V, white = predict_motion(state.X, state.V, state.white, config)
    turn = se3.adjoint(se3.inverse(X) @ state.X)
    return replace(state, X=X, V=V, white=white, bias_jacobian=turn @ state.bias_jacobian)


def belief(state: EndEffectorState) -> EndEffectorBelief:
    """The port value of a state."""
    covariance = state.white.copy()
    covariance[:6, :6] += state.bias_jacobian @ state.bias_jacobian.T + state.common
    return EndEffectorBelief(
        X=state.X, V=state.V, covariance=covariance, bias_jacobian=state.bias_jacobian
    )


class EndEffectorMotion(RecursiveFilter):
    """Recursive estimate of the end-effector's pose and velocity.

    Prediction: X_t = X_{t-1} exp(V dt), V_t = V_{t-1}. Measurement: the window's encoder samples,
    fitted to the tick's time, through forward kinematics and the Jacobian J_E of the robot's model
    of itself. Its white part is the encoders' noise through J_E. The calibration error, 1 cm and 3
    degrees, is an offset: the joints are off by constants of the episode, so it neither averages
    away nor shows between ticks. It is kept out of the recursion and added to the output, where
    `bias_jacobian` tells how much of the pose error each constant causes at this posture:
    J_E(q) J_E(q_0)^+ diag(3 deg, 1 cm), q_0 being the first posture that is measured. (The velocity
    that an offset turns, about 5 % of it, is not modelled.)

    Input ports:
    - `joint_state_window`: `SampleWindow` of (2 n,) positions [rad] and velocities [rad/s]. An
      error that its samples have in common is kept out of the recursion, too, and added to the
      output as part of the white one.

    Output ports:
    - `end_effector_estimated`: `EndEffectorBelief`, posterior of this tick.
    - `end_effector_latest`: `EndEffectorBelief`, posterior of the last tick, from the state alone.
    - `end_effector_predicted`: `EndEffectorBelief`, one tick after the last, from the state alone.

    Frames: W world, E nominal end-effector.

    Source: Martín-Martín and Brock, "Cross-modal interpretation of multi-modal sensor streams in
    interactive perception based on coupled recursion", IROS 2017, section IV-A.

    Args:
        plant: Finalized plant with the arm alone, the robot's knowledge of itself.
        frame: Name of frame E in it.
    """

    def __init__(
        self,
        config: EndEffectorMotionConfig,
        plant: MultibodyPlant,
        frame: str = "end_effector",
    ) -> None:
        super().__init__()
        check(config, "EndEffectorMotion")
        if not plant.is_finalized():
            raise ValueError("EndEffectorMotion: the robot's model must be finalized")
        if not plant.HasFrameNamed(frame):
            raise ValueError(f"EndEffectorMotion: the robot's model has no frame named '{frame}'")
        self._config = config
        self._plant = plant
        self._frame = plant.GetFrameByName(frame)
        self._scratch = plant.CreateDefaultContext()  # Holds no state between two calls.
        none = no_samples(2 * plant.num_positions())
        self._window = self._declare_value_input("joint_state_window", none)
        initial = EndEffectorState(
            X=np.eye(4),
            V=np.zeros(6),
            white=100.0 * np.eye(12),
            bias_jacobian=np.zeros((6, 6)),
            joint_bias_jacobian=None,
            common=np.zeros((6, 6)),
        )
        self._declare_recursion(initial, self._calc_motion, config.period)
        self._declare_estimated("end_effector_estimated", belief)
        self._declare_latest("end_effector_latest", belief)
        self._declare_latest(
            "end_effector_predicted", lambda state: belief(predict_state(state, config))
        )

    def _kinematics(self, joint_state: Any) -> tuple[Array, Array]:
        """X_WE (4, 4) and J_E (6, n) at positions and velocities (2 n,)."""
        self._plant.SetPositionsAndVelocities(self._scratch, joint_state)
        origin: Any = np.zeros(3)
        J_E = self._plant.CalcJacobianSpatialVelocity(
            self._scratch,
            JacobianWrtVariable.kV,
            self._frame,
            origin,
            self._plant.world_frame(),
            self._frame,
        )
        X_WE = self._frame.CalcPoseInWorld(self._scratch).GetAsMatrix4()
        return np.asarray(X_WE), np.asarray(J_E)

    def _calc_motion(self, context: Context, state: EndEffectorState) -> EndEffectorState:
        window: SampleWindow = self._read(self._window, context)
        if window.times.size == 0:
            unknown = state.joint_bias_jacobian is None
            return state if unknown else predict_state(state, self._config)
        tau = window.times - context.get_time()
        q, v, covariance = fit_joint_samples(tau, window.values, self._config)
        X_WE, J_E = self._kinematics(np.concatenate([q, v]))
        joint_bias_jacobian = state.joint_bias_jacobian
        if joint_bias_jacobian is None:
            joint_bias_jacobian = calibration_bias_jacobian(J_E, self._config)
        X, V, white = predict_motion(state.X, state.V, state.white, self._config)
        R = np.asarray(np.kron(covariance, J_E @ J_E.T), dtype=float)
        innovation = np.concatenate([se3.log(se3.inverse(X) @ X_WE), J_E @ v - V])
        correction, white = joseph_update(white, np.eye(12), R, innovation)
        return EndEffectorState(
            X=X @ se3.exp(correction[:6]),
            V=V + correction[6:],
            white=white,
            bias_jacobian=J_E @ joint_bias_jacobian,
            joint_bias_jacobian=joint_bias_jacobian,
            common=(J_E * np.broadcast_to(window.variances, 2 * len(q))[: len(q)]) @ J_E.T,
        )
