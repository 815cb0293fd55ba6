"""Turns what camera and taxels give into measurements of an object's pose, one after the other."""

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import shapely
from pydrake.common.value import Value
from pydrake.systems.framework import Context
from pydrake.systems.sensors import ImageDepth32F, ImageGrey8U

from crossmodal.maths import se3
from crossmodal.maths.arrays import Array, Ids
from crossmodal.maths.immutable import Immutable
from crossmodal.maths.pinhole import Intrinsics
from crossmodal.systems.arm_pose import ArmPose
from crossmodal.systems.port_values import (
    NO_MASKS,
    NO_MEASUREMENT,
    NO_PRIOR,
    NO_SEGMENTS,
    ObjectMasks,
    PoseMeasurement,
    PosePrior,
    StampedImage,
    of_middle,
)
from crossmodal.systems.pose.evidence import all_displacements
from crossmodal.systems.pose.outline import outline_planes
from crossmodal.systems.pose.target_model import TargetModel
from crossmodal.systems.pose.target_view import TargetViewConfig, view_target
from crossmodal.systems.pose.touch_contacts import contact_points, swept_lines
from crossmodal.systems.recursive_filter import RecursiveFilter
from crossmodal.systems.shared_settings import SensorNoise


@dataclass(frozen=True, kw_only=True)
class CameraOnArm:
    """A camera that an arm carries, as it is believed to be.

    Attributes:
        intrinsics: Of its depth image.
        arm: Where the frame that carries the camera is by the arm's joints.
        pose_covariance: (6, 6) of xi in X_WC exp(xi), rotation first, [rad, m], by how it is
            mounted.
        depth_scale_std: As a share of all depths.
        focal_length_std: As a share of it.
    """

    intrinsics: Intrinsics
    arm: ArmPose
    pose_covariance: Array
    depth_scale_std: float
    focal_length_std: float


@dataclass(frozen=True, kw_only=True)
class TaxelsOnArm:
    """Taxels that an arm carries, as they are believed to be.

    Attributes:
        arm: Where the gripper's frame E is by the arm's joints.
        p_ES: Middles of the taxels' spheres (T, 3), [m].
        radius: Of the spheres, [m].
        place_std: By which all taxels are displaced along each axis, [m].
        ends: Those that sweep the space before the fingers, by index.
        threshold: Of the force on a taxel that is pressed, [N].
        sigma: Of a contact's place, [m].
    """

    arm: ArmPose
    p_ES: Array
    radius: float
    place_std: float
    ends: Ids
    threshold: float
    sigma: float


@dataclass(frozen=True, kw_only=True)
class Displacements:
    """How what is measured is displaced by errors of the calibration, all of one standard normal.

    These are, in order: eight of the camera (see `camera_displacements`), those of the arm that
    carries it (see `ArmPose.displacements`), those of the touching arm, three of the taxels' places
    along the axes of E.

    Attributes:
        camera: As believed.
        taxels: As believed.
    """

    camera: CameraOnArm
    taxels: TaxelsOnArm

    def view(self, q: Array, X_WC: Array) -> Array:
        """(8, m): how what is seen is displaced per error, as in `PoseMeasurement`."""
        camera = self.camera
        own = camera_displacements(
            X_WC, camera.pose_covariance, camera.depth_scale_std, camera.focal_length_std
        )
        carried = all_displacements(camera.arm.displacements(q))
        rest = np.zeros((8, 6 + self.taxels.arm.num_joints + 3))
        return np.concatenate([own, carried, rest], axis=1)

    def touch(self, q: Array) -> Array:
        """(6, m): by which twist in W about Wo contacts at a posture are displaced per error."""
        taxels = self.taxels
        R_WE = taxels.arm.Evaluate(q, 0.0)[0][:3, :3]
        places = np.vstack([np.zeros((3, 3)), taxels.place_std * R_WE])
        before = np.zeros((6, 8 + 6 + self.camera.arm.num_joints))
        return np.concatenate([before, taxels.arm.displacements(q), places], axis=1)


@dataclass(frozen=True, kw_only=True)
class MeasurementsState(Immutable):
    """The last measurement, and which views and touches are in it or in those before it.

    Attributes:
        measurement: The last one.
        view: Number of the last view that was read.
        touch: Number of the last touch that was read.
    """

    measurement: PoseMeasurement = field(default_factory=lambda: NO_MEASUREMENT)
    view: int = 0
    touch: int = 0


class PoseMeasurements(RecursiveFilter):
    """Numbers views and touches as they come, and says what each has measured.

    A view or a touch that the arm cannot get to is a measurement without points.

    Input ports:
    - `pose_guess`: `PosePrior`, about where the object is.
    - `depth_measured`: `StampedImage` in depth.
    - `robot_mask`: `ImageGrey8U`, nonzero on the robots; may stay unconnected.
    - `camera_joint_state_measured`: (2 n,) of the arm with the camera.
    - `looked`: (1,) number of the view at which the camera rests.
    - `unreachable`: (1,) number of the last view that cannot be got to.
    - `touch_end`: how the last touch ended, with `number`, `outcome`, `q_start`, `q_end`, `forces`.
    - `segments`, `object_masks`: `Segments` and `ObjectMasks`, which tell the object's pixels from
      those of others; unconnected, all near where it is thought to be are the object's.

    Output ports:
    - `pose_measurement`: `PoseMeasurement`, the last one.

    Frames: W world, C camera, E the gripper's end-effector.

    Args:
        model: Of the object.
        camera: As believed.
        taxels: As believed.
        noise: Of depth, as believed.
        height: Of the table as believed, [m]; None if it stands on nothing that is known.
        config: Of the object's pixels.
        period: Of the ticks, [s].
        name: Of the object's class.
    """

    def __init__(
        self,
        model: TargetModel,
        camera: CameraOnArm,
        taxels: TaxelsOnArm,
        noise: SensorNoise,
        height: float | None,
        config: TargetViewConfig,
        period: float,
        name: str = "",
    ) -> None:
        super().__init__()
        self._name = name
        self._model, self._camera, self._taxels = model, camera, taxels
        self._errors = Displacements(camera=camera, taxels=taxels)
        self._nowhere = np.zeros_like(self._errors.touch(np.zeros(taxels.arm.num_joints)))
        self._noise, self._height, self._config = noise, height, config
        self._guess = self._declare_value_input("pose_guess", NO_PRIOR)
        image = StampedImage(time=0.0, image=ImageDepth32F())
        self._depth = self._declare_value_input("depth_measured", image)
        self._mask = self._declare_value_input("robot_mask", ImageGrey8U())
        self._joints = self.DeclareVectorInputPort(
            "camera_joint_state_measured", 2 * camera.arm.num_joints
        )
        self._looked = self.DeclareVectorInputPort("looked", 1)
        self._unreachable = self.DeclareVectorInputPort("unreachable", 1)
        self._touch = self.DeclareAbstractInputPort("touch_end", Value[object]())
        self._segments = self._declare_value_input("segments", NO_SEGMENTS)
        self._masks = self._declare_value_input("object_masks", NO_MASKS)
        self._declare_recursion(MeasurementsState(), self._calc, period)
        self._declare_latest("pose_measurement", lambda state: state.measurement)

    def _calc(self, context: Context, state: Any) -> MeasurementsState:
        number = state.measurement.number + 1
        looked = int(self._read(self._looked, context)[0])
        unreachable = int(self._read(self._unreachable, context)[0])
        if not self._read(self._guess, context).given:
            return replace(state, view=max(looked, unreachable))
        masks: ObjectMasks | None = self._read_optional(self._masks, context)
        if looked > state.view and masks is not None and masks.view < looked:
            unchanged: MeasurementsState = state
            return unchanged
        if looked > state.view:
            return MeasurementsState(
                measurement=self._view(context, number), view=looked, touch=state.touch
            )
        if unreachable > state.view:
            nothing = PoseMeasurement(kind="view", number=number, displaced=self._nowhere)
            return MeasurementsState(measurement=nothing, view=unreachable, touch=state.touch)
        touch = self._read(self._touch, context)
        if touch.number > state.touch:
            return MeasurementsState(
                measurement=self._touched(touch, number), view=state.view, touch=touch.number
            )
        return MeasurementsState(measurement=state.measurement, view=state.view, touch=state.touch)

    def _view(self, context: Context, number: int) -> PoseMeasurement:
        camera, noise = self._camera, self._noise
        q = np.array(self._read(self._joints, context))[: camera.arm.num_joints]
        image: StampedImage = self._read(self._depth, context)
        X_WC = image.X_WC
        guess: PosePrior = self._read(self._guess, context)
        centre = of_middle(guess.X, self._model.middle)[:3, 3]
        depth = np.array(image.image.data[:, :, 0])
        mask = self._read_optional(self._mask, context)
        masked = np.zeros(depth.shape, bool) if mask is None else mask.data[:, :, 0] != 0
        own, outline = np.ones(depth.shape, bool), np.zeros((0, 3))
        masks: ObjectMasks | None = self._read_optional(self._masks, context)
        if masks is not None:
            near = shapely.Point(centre[:2]).buffer(3.0 * guess.translation_sigma)
            target = self._read(self._segments, context).largest(self._name, near)
            own = masks.objects == (-1 if target is None else target.number)
            own &= target is not None
            if target is not None and target.number in masks.glass:
                others = np.where(masked, masks.objects.max() + 1, masks.objects)
                others[own & ~masked] = -1
                outline = outline_planes(
                    own & ~masked, others, camera.intrinsics, X_WC[:3, :3], self._config.planes
                )
                masked = masked | own  # Depths are those of what is behind it.
        seen = view_target(
            depth,
            masked,
            own,
            camera.intrinsics,
            X_WC,
            centre,
            self._model.radius + 3.0 * guess.translation_sigma,
            self._height,
            self._config,
        )
        distance = float(np.linalg.norm(centre - X_WC[:3, 3]))
        outline_sigma = self._config.outline_error / camera.intrinsics.focal_x * distance
        facing = X_WC[:3, 3] - seen.p_WP
        facing /= np.linalg.norm(facing, axis=1, keepdims=True)
        return PoseMeasurement(
            kind="view",
            number=number,
            points=seen.p_WP,
            sigma=noise.depth + noise.depth_growth * (seen.depth - noise.depth_range) ** 2,
            facing=facing,
            eye=X_WC[:3, 3],
            axis=X_WC[:3, 2],
            passed=seen.passed,
            free=seen.free,
            outline=outline,
            outline_sigma=np.full(len(outline), outline_sigma),
            displaced=self._errors.view(q, X_WC),
        )

    def _touched(self, touch: Any, number: int) -> PoseMeasurement:
        taxels = self._taxels
        if touch.outcome == "unreachable":
            return PoseMeasurement(kind="touch", number=number, displaced=self._nowhere)
        X_start, X_end = (taxels.arm.Evaluate(q, 0.0)[0] for q in (touch.q_start, touch.q_end))
        met = touch.outcome == "contact"
        points, facing = np.zeros((0, 3)), np.zeros((0, 3))
        if met:
            points, facing = contact_points(
                X_end, taxels.p_ES, touch.forces, taxels.radius, taxels.threshold
            )
        return PoseMeasurement(
            kind="touch",
            number=number,
            points=points,
            sigma=np.full(len(points), taxels.sigma),
            facing=facing,
            free=swept_lines(X_start, X_end, taxels.p_ES, taxels.ends, met),
            displaced=self._errors.touch(touch.q_end),
        )


def camera_displacements(
    X_WC: Array, covariance: Array, depth_scale_std: float, focal_length_std: float
) -> Array:
    """(8, 8): how what a camera sees is displaced per error, as in `PoseMeasurement`.

    The errors are those of its pose, of the depths' scale and of the focal length.

    Args:
        X_WC: Pose of the camera (4, 4).
        covariance: (6, 6) of xi in X_WC exp(xi), rotation first, [rad, m].
        depth_scale_std: As a share of all depths.
        focal_length_std: As a share of it.
    """
    A = np.diag(np.repeat([0.0, -depth_scale_std, -focal_length_std], [6, 1, 1]))
    A[:6, :6] = se3.adjoint(X_WC) @ _root(covariance)
    return A


def _root(covariance: Array) -> Array:
    return np.asarray(np.linalg.cholesky(covariance + 1e-18 * np.eye(len(covariance))))
