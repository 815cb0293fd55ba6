"""The limit for any joint filter: a batch fit of the true model to a whole stream.

Maximum likelihood over the reference pose, the axis and a constant rate, q = rate t, by
Gauss-Newton from the truth, with Jacobians by central differences. No filter knows that the rate is
constant, and none sees the whole stream before its end.
"""

import numpy as np

from benchmarks.joint_streams import Stream, StreamConfig, joint_pose
from crossmodal.maths import se3
from crossmodal.maths.arrays import Array
from crossmodal.maths.vectors import normal_basis
from crossmodal.systems.port_values import JointType

_STEP = 1e-5


def _move(
    x: tuple[Array, Array, Array, float], d: Array, joint_type: JointType
) -> tuple[Array, Array, Array, float]:
    """The parameters (reference pose, axis, axis point, rate) moved by `d` (9 or 11,)."""
    X0, axis, p_PA, rate = x
    B = normal_basis(axis)
    tilted = axis + d[6:8] @ B
    point = p_PA + d[9:11] @ B if joint_type == JointType.REVOLUTE else p_PA
    return X0 @ se3.exp(d[:6]), tilted / np.linalg.norm(tilted), point, rate + d[8]


def _residuals(x: tuple[Array, Array, Array, float], config: StreamConfig, stream: Stream) -> Array:
    X0, axis, p_PA, rate = x
    scale = np.repeat([config.rotation_noise, config.translation_noise], 3)
    rows = []
    for time, Z in zip(stream.times, stream.X_PB_measured, strict=True):
        X = joint_pose(config.joint_type, axis, p_PA, rate * time) @ X0
        rows.append(se3.log(se3.inverse(X) @ Z) / scale)
    return np.concatenate(rows)


def batch_fit(config: StreamConfig, stream: Stream) -> tuple[float, Array, Array]:
    """The final configuration [m or rad], the axis (3,) and a point of it (3,) [m]."""
    n = 11 if config.joint_type == JointType.REVOLUTE else 9
    rate = float(stream.configuration[-1] / stream.times[-1])
    # The axis point nearest to the body, so that a tilt of the axis turns about it.
    x = (stream.X_PB_reference, stream.axis_P, stream.p_PA, rate)
    for _ in range(3):
        J = np.empty((6 * stream.times.size, n))
        for i in range(n):
            d = np.zeros(n)
            d[i] = _STEP
            ahead = _residuals(_move(x, d, config.joint_type), config, stream)
            behind = _residuals(_move(x, -d, config.joint_type), config, stream)
            J[:, i] = (ahead - behind) / (2.0 * _STEP)
        step = np.linalg.lstsq(J, -_residuals(x, config, stream), rcond=None)[0]
        x = _move(x, np.asarray(step, dtype=float), config.joint_type)
    return x[3] * float(stream.times[-1]), x[1], x[2]
