"""What a wrong calibration adds to the errors of a joint.

It is wrong in the same way in all poses of a body, so that a joint explains them as well as the
true poses: no filter can find it, and none can average it away. So a joint is estimated as if the
calibration were right, and what the calibration may be off by is added to what is reported of it.

Frames: P the joint's parent, F the frame of the sensor that measures, z its third axis.
"""

from dataclasses import dataclass, replace

import numpy as np

from crossmodal.maths import se3
from crossmodal.maths.arrays import Array
from crossmodal.systems.depth_camera import displacement_covariance
from crossmodal.systems.port_values import JointBelief, JointModelBelief, JointType

_HINGES = (JointType.REVOLUTE, JointType.SCREW)


@dataclass(frozen=True, kw_only=True)
class SensorCalibration:
    """Where a sensor is believed to be, and standard deviations of what is wrong with it.

    Attributes:
        X_WF: Pose (4, 4) of its frame.
        covariance: (6, 6) of xi in X_WF exp(xi), rotation first, [rad, m].
        scale: Of all lengths from the origin of F, as a share of them.
        focal_length: Of a camera that looks along z, as a share of it.
        latency: By how much later than at its stamp a measurement shows the world, [s].
    """

    X_WF: Array
    covariance: Array
    scale: float = 0.0
    focal_length: float = 0.0
    latency: float = 0.0


PERFECT = SensorCalibration(X_WF=np.eye(4), covariance=np.zeros((6, 6)))


def with_calibration(joint: JointBelief, sensor: SensorCalibration, X_WP: Array) -> JointBelief:
    """A joint from poses that a sensor measured, with the errors of its calibration.

    A wrong pose of the sensor moves all that is measured, a scale stretches it about the origin of
    F, and a wrong focal length across z. By the latter a slide's direction tilts as an axis does.
    What turns seems to turn by another angle then, by how much depends on its shape: here it is the
    mean square over all directions of a line in it.

    Args:
        joint: As if the calibration were right.
        sensor: That measured.
        X_WP: (4, 4) of the joint's parent, as it is believed to be.
    """
    models = {
        kind: _with_calibration(kind, model, sensor, se3.inverse(X_WP) @ sensor.X_WF)
        for kind, model in joint.models.items()
    }
    return replace(joint, models=models)


def _with_calibration(
    kind: JointType, model: JointModelBelief, sensor: SensorCalibration, X_PF: Array
) -> JointModelBelief:
    if kind not in (JointType.PRISMATIC, *_HINGES):
        return model
    a, z = model.axis_P, X_PF[:3, 2]
    p = model.p_PA if kind in _HINGES else X_PF[:3, 3]
    displacement = displacement_covariance(X_PF, sensor.covariance, p)
    turn = se3.skew(a)
    tilt = sensor.focal_length * (z @ a) * (z - (z @ a) * a)
    across = sensor.focal_length * (1.0 - (z @ a) ** 2)
    stretch = sensor.scale**2 + across**2  # Variance of lengths along the axis, as a share.
    q, rate = model.configuration
    if kind in _HINGES:
        turned = np.array([np.sin(q), np.cos(q) * rate])
        off = 0.5 * across**2 * np.outer(turned, turned)
    else:
        off = stretch * np.outer(model.configuration, model.configuration)
    off[0, 0] += (sensor.latency * rate) ** 2
    ray = p - X_PF[:3, 3]
    aside = sensor.focal_length * (ray - (z @ ray) * z)
    of_point = sensor.scale**2 * np.outer(ray, ray) + np.outer(aside, aside)
    pitch = model.pitch_mixture.copy()
    pitch[:, 2] += stretch * pitch[:, 1] ** 2
    return replace(
        model,
        axis_covariance=(
            model.axis_covariance + turn @ displacement[:3, :3] @ turn.T + np.outer(tilt, tilt)
        ),
        p_PA_covariance=model.p_PA_covariance + displacement[3:, 3:] + of_point,
        configuration_covariance=model.configuration_covariance + off,
        pitch_mixture=pitch,
    )
