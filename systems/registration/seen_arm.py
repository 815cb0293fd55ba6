"""By how much an arm meets what a carried camera sees beside it, from one look at the arm."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from pydrake.systems.framework import Context
from pydrake.systems.sensors import ImageDepth32F

from crossmodal.maths import se3
from crossmodal.maths.arrays import Array
from crossmodal.maths.validation import check
from crossmodal.systems.depth_camera import DepthCamera
from crossmodal.systems.port_values import ArmOffset, StampedImage, displacement_at
from crossmodal.systems.recursive_filter import RecursiveFilter
from crossmodal.systems.registration.arm_registration import (
    ArmRegistrationConfig,
    RegistrationState,
    after_image,
    before_images,
)
from crossmodal.systems.registration.registration_solver import (
    FOCAL,
    SCALE,
    CalibratedArm,
    distortion,
    place_unknowns,
    prior_covariance,
)
from crossmodal.systems.registration.robot_view import RobotView

ARM = "arm"


@dataclass(frozen=True, kw_only=True)
class LookedAt:
    """A place at which objects are, and how it is looked at.

    Attributes:
        p_W: (3,), [m].
        X_WC: From where the camera sees it (4, 4).
    """

    p_W: Array
    X_WC: Array


class SeenArm(RecursiveFilter):
    """Compares, in one image, where an arm is seen with where its encoders say that it is.

    The errors of both calibrations are found as by `ArmRegistration`, and what they make of a place
    that the camera looks at from elsewhere: the camera's mounting is the same there, the errors of
    the joints' zeros are not. Until the arm was seen, and if too little of it is, that is what the
    calibrations make of it.

    Input ports:
    - `depth_measured`: `StampedImage` of an `ImageDepth32F`, [m]; 0, NaN or inf is no return.
    - `looked`: (1,) number of the view at which the camera rests.
    - `joint_state_measured`: (2 n,) of the arm, at rest, [rad], [rad/s].

    Output ports:
    - `arm_offset`: `ArmOffset`, whose `view` is that of the image.

    Frames: W world, C camera, Q the place.

    Args:
        number: Of the view that shows the arm; zero: there is none.
        place: Where objects are.
        camera: As believed; its pose is that of the image, the covariance of that is by how it is
            mounted.
        arm: That is seen.
        joints: By which the errors of the joints' zeros displace what an arm carries, anew in each
            posture, [m].
        view_from: Renders the arm, by the name `ARM`, from where the camera is believed to be.
        config: Of the registration.
        period: Of the ticks, [s].

    Raises:
        ValueError: for an impossible configuration.
    """

    def __init__(
        self,
        number: int,
        place: LookedAt,
        camera: DepthCamera,
        arm: CalibratedArm,
        joints: float,
        view_from: Callable[[Array], RobotView],
        config: ArmRegistrationConfig,
        period: float,
    ) -> None:
        super().__init__()
        check(config, "SeenArm")
        self._number, self._place, self._camera = number, place, camera
        self._arm, self._joint_error = arm, joints
        self._view_from, self._config = view_from, config
        self._unknowns = place_unknowns({ARM: len(arm.joint_offset_std)})
        image = StampedImage(time=0.0, image=ImageDepth32F())
        self._depth = self._declare_value_input("depth_measured", image)
        self._looked = self.DeclareVectorInputPort("looked", 1)
        joint_count = len(arm.joint_offset_std)
        self._joints = self.DeclareVectorInputPort("joint_state_measured", 2 * joint_count)
        at_place = replace(camera, X_WC=place.X_WC)
        unseen = replace(
            before_images(place.p_W, self._unknowns.size, config),
            covariance=prior_covariance(self._unknowns, place.p_W, at_place, {ARM: arm}),
        )
        self._declare_recursion(self._offset(unseen, place.X_WC, 0), self._calc, period)
        self._declare_latest("arm_offset", lambda offset: offset)

    def _calc(self, context: Context, offset: Any) -> ArmOffset:
        before: ArmOffset = offset
        looked = int(self._read(self._looked, context)[0])
        if looked != self._number or before.view == looked:
            return before
        image: StampedImage = self._read(self._depth, context)
        q = {ARM: np.array(self._read(self._joints, context))[: len(self._arm.joint_offset_std)]}
        view = self._view_from(image.X_WC)
        found = after_image(
            before_images(self._place.p_W, self._unknowns.size, self._config),
            q,
            view.Pose(q),
            np.array(image.image.data[:, :, 0], float),
            view,
            replace(self._camera, X_WC=image.X_WC),
            {ARM: self._arm},
            self._config,
        )
        if found is None:
            return replace(before, view=looked)
        return self._offset(found, image.X_WC, looked)

    def _offset(self, found: RegistrationState, X_WC: Array, view: int) -> ArmOffset:
        """The arm's displacement at the place less that of what the camera sees there.

        Args:
            found: The errors, after an image from that pose of the camera (4, 4).
            X_WC: That pose.
            view: Number of the image.
        """
        p, X_later = self._place.p_W, self._place.X_WC
        J = np.zeros((3, self._unknowns.size))
        # The camera's mounting is the same at both views.
        J[:, :6] = -displacement_at(p, p) @ _moved(X_WC, X_later, p)
        J[:, SCALE : FOCAL + 1] = -distortion(X_later, p)
        start = self._unknowns.arms[ARM].start
        J[:, start : start + 6] = displacement_at(p, p)
        # The camera's arm has one posture for each view, the other one still another at the place.
        joints = 3.0 * self._joint_error**2 * np.eye(3)
        covariance = J @ found.covariance @ J.T + joints
        return ArmOffset(mean=J @ found.mean, covariance=covariance, view=view)


def _moved(X_WC: Array, X_WD: Array, p_WQ: Array) -> Array:
    """(6, 6): displacements about Q by an error of a frame C's pose, if the frame is at D later.

    The error is constant in the frame.
    """
    change = X_WD @ np.linalg.inv(X_WC)
    about = np.eye(4)
    about[:3, 3] = p_WQ
    return np.asarray(se3.adjoint(np.linalg.inv(about) @ change @ about))
