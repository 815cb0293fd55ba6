"""The stamps that a camera's driver puts on its images, and where the camera is by them."""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from pydrake.common.value import AbstractValue, Value
from pydrake.math import RigidTransform
from pydrake.systems.framework import Context, InputPort, LeafSystem
from pydrake.systems.sensors import ImageDepth32F, ImageRgba8U

from crossmodal.maths import se3
from crossmodal.maths.arrays import Array
from crossmodal.systems.arm_pose import ArmPose
from crossmodal.systems.port_values import StampedImage
from crossmodal.systems.port_values.streams import copied


@dataclass(frozen=True, kw_only=True)
class Mounting:
    """What is believed of where a camera is fixed.

    Attributes:
        X_PC: Pose of the camera C in the frame P that carries it.
        covariance: (6, 6) of xi in X_PC exp(xi), rotation first, [rad, m].
        arm: Where P is by the joints of an arm; None if P is the world.
    """

    X_PC: RigidTransform = field(default_factory=RigidTransform)
    covariance: Array = field(default_factory=lambda: np.zeros((6, 6)))
    arm: ArmPose | None = None


def carried_pose(mounting: Mounting, arm: ArmPose, q: Array) -> tuple[Array, Array]:
    """X_WC (4, 4) of a camera on an arm, and the covariance (6, 6) of xi in X_WC exp(xi).

    X_WP exp(xi_P) X_PC exp(xi_C) = X_WC exp(Ad_CP xi_P) exp(xi_C). The errors of the arm's base and
    of its joints' zeros are in xi_P; the encoders' noise is left out.

    Args:
        mounting: Of the camera.
        arm: That carries P.
        q: Measured joint positions (n,), [rad].
    """
    X_WP, _, lasting = arm.Evaluate(q, 0.0)
    Ad = se3.adjoint(np.ascontiguousarray(mounting.X_PC.inverse().GetAsMatrix4()))
    X_WC = (RigidTransform(X_WP) @ mounting.X_PC).GetAsMatrix4()
    return X_WC, Ad @ lasting @ Ad.T + mounting.covariance


class ImageStamps(LeafSystem):
    """Stamps images with the instant at which they are read, and with where the camera then is.

    Read them at the ticks. A camera that is fixed in the world is where its calibration says; one
    on an arm is where the robot's own model of the arm says by the measured joints.

    Input ports:
    - `color_image`: `ImageRgba8U`.
    - `depth_image`: `ImageDepth32F`, [m].
    - `joint_state_measured`: (2 n,), q [rad] and qdot [rad/s] of the arm that carries the camera;
      qdot is not used. Only declared for a camera on an arm.

    Output ports:
    - `color_measured`, `depth_measured`: `StampedImage` of them.

    Frames: W world, P what carries the camera, C camera (x right, y down, z forward).

    Args:
        mounting: Of the camera; None where nobody knows where it is.
    """

    def __init__(self, mounting: Mounting | None = None) -> None:
        super().__init__()
        self._mounting = mounting
        self._joints: InputPort | None = None
        if mounting is not None and mounting.arm is not None:
            size = 2 * mounting.arm.num_joints
            self._joints = self.DeclareVectorInputPort("joint_state_measured", size)
        for name, kind in (("color", ImageRgba8U), ("depth", ImageDepth32F)):
            image = self.DeclareAbstractInputPort(f"{name}_image", Value(kind()))
            tickets = {self.input_port_ticket(image.get_index()), self.time_ticket()}
            if self._joints is not None:
                tickets.add(self.input_port_ticket(self._joints.get_index()))
            self.DeclareAbstractOutputPort(
                f"{name}_measured",
                lambda kind=kind: AbstractValue.Make(StampedImage(time=0.0, image=kind())),
                self._stamp(image),
                tickets,
            )

    def _stamp(self, port: InputPort) -> Callable[[Context, AbstractValue], None]:
        def stamp(context: Context, output: AbstractValue) -> None:
            image, time = copied(port.Eval(context)), context.get_time()
            if self._mounting is None:
                output.set_value(StampedImage(time=time, image=image))
                return
            X_WC, covariance = self._pose(self._mounting, context)
            output.set_value(StampedImage(time=time, image=image, X_WC=X_WC, covariance=covariance))

        return stamp

    def _pose(self, mounting: Mounting, context: Context) -> tuple[Array, Array]:
        if mounting.arm is None or self._joints is None:
            return mounting.X_PC.GetAsMatrix4(), mounting.covariance
        q = self._joints.Eval(context)[: mounting.arm.num_joints]
        return carried_pose(mounting, mounting.arm, q)
