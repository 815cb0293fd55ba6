"""A measuring rig in place of robots: a camera on a hemisphere, and a finger along rays.

What it measures is what robots would measure, with the noise of camera and contacts and with wrong
calibrations of the camera, of the finger's arm and of the table's height.
"""

from typing import Any

import numpy as np
from pydrake.common.value import Value
from pydrake.math import RigidTransform
from pydrake.systems.framework import Context

from crossmodal.diagrams.clutter.scenario import Scenario, generator, is_transparent
from crossmodal.diagrams.clutter.start import first_guess, true_displacement, true_pose
from crossmodal.diagrams.run.calibration import Calibration, Camera, draw_camera
from crossmodal.diagrams.run.record import TaskStatus
from crossmodal.maths.arrays import Array
from crossmodal.systems.active.touch_planning import across
from crossmodal.systems.port_values import (
    NO_MEASUREMENT,
    NO_TOUCH,
    NO_VIEW,
    PoseMeasurement,
    TouchRequest,
    of_mesh,
    of_middle,
)
from crossmodal.systems.pose.pose_measurements import camera_displacements
from crossmodal.systems.pose.surface import cast_rays
from crossmodal.systems.pose.target_model import TargetModel
from crossmodal.systems.pose.target_view import lines_beside
from crossmodal.systems.pose.touch_contacts import BEFORE_CONTACT, shortened
from crossmodal.systems.recursive_filter import RecursiveFilter
from crossmodal.systems.sensors.depth_noise import DepthNoiseConfig, depth_sigma
from crossmodal.systems.shared_settings import SensorNoise

CAMERA_ERRORS, ARM_ERRORS = 8, 6  # Pose, depth scale, focal length; pose.
_CAMERA_REACH = 3.0  # [m]
_DRAWN = DepthNoiseConfig()  # The camera's own noise.


def finger_displacements(scenario: Scenario) -> Array:
    """(6, 14): by which twist in W contacts are displaced per error: of the camera, of the arm."""
    believed = scenario.calibration.believed
    sigma = np.repeat([believed.arm_rotation, believed.arm_translation], 3)
    return np.concatenate([np.zeros((6, CAMERA_ERRORS)), np.diag(sigma)], axis=1)


class MeasuringRig(RecursiveFilter):
    """Takes the views that are wanted, then the touches.

    Input ports:
    - `view`: `ViewRequest`.
    - `touch`: `TouchRequest`.

    Output ports:
    - `pose_measurement`: `PoseMeasurement`, the last one.
    - `pose_guess`: `PosePrior`.
    - `task_status`: `TaskStatus`.
    - `cheat_object_pose`: `RigidTransform` X_WO of the object's mesh.
    """

    def __init__(self, scenario: Scenario, calibration: Calibration, model: TargetModel) -> None:
        super().__init__()
        self._scenario, self._model = scenario, model
        self._camera, self._noise = calibration.cameras["camera"], calibration.noise
        seed = scenario.seed
        errors = scenario.calibration.drawn_errors(seed)
        self._true_camera: Camera = draw_camera("camera", self._camera, errors, seed)
        self._X_base = true_displacement(scenario, calibration)
        self._of_arm = finger_displacements(scenario)
        self._X_WM = true_pose(scenario, model)
        self._guess = first_guess(scenario, self._X_WM, model)
        self._view_wanted = self._declare_value_input("view", NO_VIEW)
        self._touch = self._declare_value_input("touch", NO_TOUCH)
        self._declare_recursion((NO_MEASUREMENT, 0), self._calc, scenario.network_period)
        self._declare_latest("pose_measurement", lambda state: state[0])
        self._declare_latest("pose_guess", lambda state: self._guess)
        X_WO = RigidTransform(of_mesh(self._X_WM, model.middle))
        self.DeclareAbstractOutputPort(
            "cheat_object_pose",
            lambda: Value(RigidTransform()),
            lambda context, output: output.set_value(X_WO),
        )
        self.DeclareAbstractOutputPort(
            "task_status", lambda: Value[object](TaskStatus()), self._write_status
        )

    def _write_status(self, context: Context, value: Any) -> None:
        measured, _ = self._stored(context)
        wanted: TouchRequest = self._read(self._touch, context)
        phase = "looking" if measured.kind == "view" else "touching" if measured.kind else ""
        value.set_value(TaskStatus(phase=phase, done=wanted.done, note=wanted.why))

    def _calc(self, context: Context, state: Any) -> tuple[PoseMeasurement, int]:
        measured, touches = state
        if measured.number < self._scenario.views.count:
            view = self._read(self._view_wanted, context)
            if view.number <= measured.number:
                return measured, touches
            return self._view(view.number, view.X_WC), 0
        wanted: TouchRequest = self._read(self._touch, context)
        if wanted.number > touches and not wanted.done:
            return self._touched(measured.number + 1, wanted), wanted.number
        return measured, touches

    def _cast(self, p: Array, directions: Array, reach: float) -> Array:
        """Distances (R,) at which rays from `p` (3,) or (R, 3) truly meet the object."""
        R, t = self._X_WM[:3, :3], self._X_WM[:3, 3]
        starts = np.ascontiguousarray(np.broadcast_to((p - t) @ R, directions.shape))
        along = np.ascontiguousarray(directions @ R)
        length = np.full(len(directions), reach)
        return cast_rays(starts, along, length, self._model.surface, True)[0]

    def _view(self, number: int, X_believed: Array) -> PoseMeasurement:
        rng = generator(self._scenario, f"view {number}")
        camera, stride = self._true_camera, self._scenario.view.stride
        p_W = of_middle(self._guess.X, self._model.middle)[:3, 3]
        # The flange is where it is believed to be, the camera on it is not.
        mounting = self._camera.X_PC.inverse() @ camera.X_PC
        X_true = X_believed @ np.asarray(mounting.GetAsMatrix4())
        rays, believed_rays = (_pixel_rays(c, stride) for c in (camera, self._camera))
        length = np.linalg.norm(rays, axis=1)
        found = self._cast(
            X_true[:3, 3], (rays / length[:, None]) @ X_true[:3, :3].T, _CAMERA_REACH
        )
        met = np.isfinite(found)
        is_glass = is_transparent(self._scenario)
        hidden = met & is_glass  # Behind glass nothing returns, and from it neither.
        met &= not is_glass
        depth = found[met] / length[met]
        reach = self._model.radius + 3.0 * self._guess.translation_sigma
        sigma = depth_sigma(depth, _DRAWN.sigma_base, _DRAWN.sigma_square)
        measured = depth * camera.depth_scale + sigma * rng.normal(size=len(depth))
        points = X_believed[:3, 3] + (measured[:, None] * believed_rays[met]) @ X_believed[:3, :3].T
        facing = X_believed[:3, 3] - points
        facing /= np.linalg.norm(facing, axis=1, keepdims=True)
        displaced = camera_displacements(
            X_believed,
            self._camera.pose_covariance,
            self._camera.depth_scale_std,
            self._camera.focal_length_std,
        )
        passed = (believed_rays / length[:, None])[~met & ~hidden] @ X_believed[:3, :3].T
        lines = 0 if is_glass else self._scenario.perception.view.lines
        return PoseMeasurement(
            kind="view",
            number=number,
            points=points,
            sigma=_believed_sigma(measured, self._noise),
            facing=facing,
            eye=X_believed[:3, 3],
            axis=X_believed[:3, 2],
            passed=passed,
            free=lines_beside(
                X_believed[:3, 3], passed, np.full(len(passed), np.inf), points, p_W, reach, lines
            ),
            displaced=np.concatenate([displaced, np.zeros((8, ARM_ERRORS))], axis=1),
        )

    def _touched(self, number: int, wanted: TouchRequest) -> PoseMeasurement:
        rng = generator(self._scenario, f"touch {number}")
        contact = self._scenario.contact
        # The finger truly goes where the arm's base truly stands.
        R, t = self._X_base[:3, :3], self._X_base[:3, 3]
        start, direction = R @ wanted.start + t, R @ wanted.direction
        face = across(direction[None], self._scenario.touches.touch.of_finger())[0]
        along = np.tile(direction, (len(face), 1))
        distances = self._cast(start + face, along, wanted.reach)
        first = int(np.argmin(distances))
        distance = float(distances[first])
        if rng.uniform() < contact.false_contacts:
            distance = min(distance, rng.uniform(0.0, wanted.reach))
        met = np.isfinite(distance)
        points, facing = np.zeros((0, 3)), np.zeros((0, 3))
        if met:
            noise = contact.noise * rng.normal(size=3)
            meant = wanted.start + R.T @ face[first]  # Where the robot believes that point to be.
            points = (meant + distance * wanted.direction + noise)[None]
            facing = -wanted.direction[None]
        starts = wanted.start + face @ R
        stops = starts + min(distance, wanted.reach) * wanted.direction
        return PoseMeasurement(
            kind="touch",
            number=number,
            points=points,
            sigma=np.full(len(points), self._scenario.touches.touch.sigma),
            facing=facing,
            free=shortened(starts, stops, BEFORE_CONTACT if met else 0.0),
            displaced=self._of_arm,
        )


def _pixel_rays(camera: Camera, stride: int) -> Array:
    """Rays (N, 3) in C through every so many pixels, with z = 1."""
    k = camera.intrinsics
    u, v = np.meshgrid(np.arange(0, k.width, stride), np.arange(0, k.height, stride))
    x, y = (u.ravel() - k.center_x) / k.focal_x, (v.ravel() - k.center_y) / k.focal_y
    return np.column_stack([x, y, np.ones(x.size)])


def _believed_sigma(depth: Array, noise: SensorNoise) -> Array:
    """Standard deviation of depths (N,) as the robot believes it, [m]."""
    return np.asarray(noise.depth + noise.depth_growth * (depth - noise.depth_range) ** 2)
