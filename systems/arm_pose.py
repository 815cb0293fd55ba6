"""Where a frame of an arm is by its joints, and how sure that is."""

import numpy as np
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import JacobianWrtVariable

from crossmodal.maths import se3
from crossmodal.maths.arrays import Array
from crossmodal.systems.port_values import SampleWindow


def joints_at(
    tau: Array, values: Array, position_noise: float, velocity_noise: float
) -> tuple[Array, float]:
    """Joint positions (n,) at the tick and the variance of each, [rad^2].

    The mean of the samples, carried to the tick by the mean velocity: a window is too short for
    accelerations.

    Args:
        tau: Times of the samples relative to the tick (K,), [s]; K >= 1.
        values: Samples (K, 2 n), positions [rad] and velocities [rad/s].
        position_noise: Standard deviation of one sample, [rad].
        velocity_noise: Likewise of a velocity sample, [rad/s].
    """
    n, count = values.shape[1] // 2, len(tau)
    q, v = values.mean(axis=0)[:n], values.mean(axis=0)[n:]
    lead = float(np.mean(tau))
    variance = (position_noise**2 + (lead * velocity_noise) ** 2) / count
    return q - lead * v, variance


def offset_variances(window: SampleWindow) -> Array:
    """Of the joints' angles in a window of angles and rates (n,), or (1,) zero, [rad^2]."""
    variances = window.variances
    return variances if len(variances) == 1 else variances[: window.values.shape[1] // 2]


class ArmPose:
    """Forward kinematics of a calibrated arm with its errors.

    The pose's error has two parts: the encoders' noise through the Jacobian, new at every tick, and
    the error of the arm's base and of the joints' zeros, which stays.

    Args:
        model: Finalized plant with the arm alone, what the robot knows of itself.
        base_covariance: (6, 6) of xi in X_WBase exp(xi), rotation first, [rad, m].
        joint_offset_std: Of each joint's zero (n,), [rad].
        frame: Name of the frame E in the model.
        base_frame: Name of the arm's base in the model.

    Raises:
        ValueError: for a frame that the model lacks.
    """

    def __init__(
        self,
        model: MultibodyPlant,
        base_covariance: Array,
        joint_offset_std: Array,
        frame: str = "end_effector",
        base_frame: str = "base",
    ) -> None:
        for name in (frame, base_frame):
            if not model.HasFrameNamed(name):
                raise ValueError(f"the arm's model has no frame named '{name}'")
        self._model = model
        self._frame = model.GetFrameByName(frame)
        self._base = model.GetFrameByName(base_frame)
        self._base_covariance = base_covariance.copy()
        self._offset_std = joint_offset_std.copy()
        self._scratch = model.CreateDefaultContext()  # Holds no state between two calls.

    @property
    def num_joints(self) -> int:
        """The number n of joints."""
        return int(self._model.num_positions())

    def Evaluate(
        self, q: Array, variance: float, offset_variances: Array | float = 0.0
    ) -> tuple[Array, Array, Array]:
        """X_WE (4, 4), and in E the white and the lasting part (6, 6) of its covariance.

        Args:
            q: Joint positions (n,), [rad].
            variance: Of each, new at every tick, [rad^2].
            offset_variances: Of what else the encoders may be off by for long (n,), [rad^2].
        """
        self._model.SetPositions(self._scratch, q)
        X_WE = np.asarray(self._frame.CalcPoseInWorld(self._scratch).GetAsMatrix4())
        X_WBase = np.asarray(self._base.CalcPoseInWorld(self._scratch).GetAsMatrix4())
        J_E = np.asarray(
            self._model.CalcJacobianSpatialVelocity(
                self._scratch,
                JacobianWrtVariable.kV,
                self._frame,
                np.zeros(3),
                self._model.world_frame(),
                self._frame,
            )
        )
        Ad = se3.adjoint(se3.inverse(X_WE) @ X_WBase)
        offsets = J_E * np.sqrt(self._offset_std**2 + offset_variances)
        lasting = Ad @ self._base_covariance @ Ad.T + offsets @ offsets.T
        return X_WE, variance * J_E @ J_E.T, lasting

    def displacements(self, q: Array) -> Array:
        """(6, 6 + n): by which twist in W about Wo the frame is displaced per standard deviation.

        Of the errors of the base, then of each joint's zero.

        Args:
            q: Joint positions (n,), [rad].
        """
        self._model.SetPositions(self._scratch, q)
        X_WBase = np.asarray(self._base.CalcPoseInWorld(self._scratch).GetAsMatrix4())
        root = np.linalg.cholesky(self._base_covariance + 1e-18 * np.eye(6))
        world = self._model.world_frame()
        J_W = self._model.CalcJacobianSpatialVelocity(
            self._scratch,
            JacobianWrtVariable.kV,
            self._frame,
            self._frame.CalcPoseInWorld(self._scratch).inverse().translation(),
            world,
            world,
        )
        return np.concatenate([se3.adjoint(X_WBase) @ root, J_W * self._offset_std], axis=1)
