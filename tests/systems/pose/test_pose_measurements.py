"""Measurements of views and touches through the ports of the system that makes them."""

from dataclasses import dataclass, field, replace
from itertools import product
from typing import Any

import numpy as np
import pytest
import shapely
import trimesh
from numpy.testing import assert_allclose
from pydrake.common.value import AbstractValue
from pydrake.math import RigidTransform
from pydrake.systems.sensors import ImageDepth32F
from seen_box import EDGES, INTRINSICS, MIDDLE, X_WC, depth_image, off_the_box

from crossmodal.maths import se3
from crossmodal.maths.arrays import Array
from crossmodal.plants.robots.arm_with_hand import make_arm_with_load
from crossmodal.plants.robots.panda import PANDA_AWAY, PANDA_WITH_CAMERA
from crossmodal.plants.robots.ur5 import UR5_HOME, UR5_WITH_GRIPPER
from crossmodal.systems.arm_pose import ArmPose
from crossmodal.systems.port_values import (
    NO_MEASUREMENT,
    NO_PRIOR,
    ObjectMasks,
    PoseMeasurement,
    PosePrior,
    Segment,
    Segments,
    StampedImage,
)
from crossmodal.systems.pose.pose_measurements import (
    CameraOnArm,
    Displacements,
    PoseMeasurements,
    TaxelsOnArm,
    camera_displacements,
)
from crossmodal.systems.pose.target_model import make_target
from crossmodal.systems.pose.target_view import TargetViewConfig
from crossmodal.systems.shared_settings import SensorNoise

TOUCHER_BASE = RigidTransform([1.1, 0.0, 0.0])
CAMERA_COVARIANCE = np.diag(np.repeat([5e-3, 3e-3], 3) ** 2)
CAMERA = CameraOnArm(
    intrinsics=INTRINSICS,
    arm=ArmPose(
        make_arm_with_load(PANDA_WITH_CAMERA, RigidTransform()), np.zeros((6, 6)), np.full(7, 1e-3)
    ),
    pose_covariance=CAMERA_COVARIANCE,
    depth_scale_std=5e-3,
    focal_length_std=4e-3,
)
TAXELS = TaxelsOnArm(
    arm=ArmPose(
        make_arm_with_load(UR5_WITH_GRIPPER, TOUCHER_BASE), CAMERA_COVARIANCE, np.full(6, 1e-3)
    ),
    p_ES=np.array([[0.01, 0.0, -0.003], [-0.01, 0.0, -0.003]]),
    radius=0.003,
    place_std=5e-4,
    ends=np.array([0, 1]),
    threshold=0.1,
    sigma=1e-3,
)
NOISE = SensorNoise()
WIDTH = 8 + (6 + 7) + (6 + 6) + 3


@dataclass
class Ended:
    """How a touch ended."""

    number: int = 0
    outcome: str = ""
    q_start: Array = field(default_factory=lambda: UR5_HOME)
    q_end: Array = field(default_factory=lambda: UR5_HOME)
    forces: Array = field(default_factory=lambda: np.zeros((2, 3)))


class Trial:
    """The system, ticked by hand."""

    def __init__(self) -> None:
        mesh = trimesh.creation.box(extents=EDGES)
        model = make_target(mesh.vertices, mesh.faces)
        self.system = PoseMeasurements(
            model, CAMERA, TAXELS, NOISE, 0.0, TargetViewConfig(), 0.1, "box"
        )
        self.context = self.system.CreateDefaultContext()
        guess = np.eye(4)
        guess[:3, 3] = MIDDLE + np.array([0.01, -0.01, 0.0])
        depth = depth_image()[0]
        image = ImageDepth32F(depth.shape[1], depth.shape[0])
        image.mutable_data[:] = depth[..., None]
        self.fix("pose_guess", PosePrior(X=guess, rotation_sigma=0.2, translation_sigma=0.01))
        self.fix("depth_measured", StampedImage(time=0.0, image=image, X_WC=X_WC))
        self.fix("touch_end", Ended())
        for port, value in (
            ("camera_joint_state_measured", np.append(PANDA_AWAY, np.zeros(7))),
            ("looked", [0.0]),
            ("unreachable", [0.0]),
        ):
            self.system.GetInputPort(port).FixValue(self.context, value)

    def fix(self, port: str, value: Any) -> None:
        self.system.GetInputPort(port).FixValue(self.context, AbstractValue.Make(value))

    def say(self, port: str, number: int) -> None:
        self.system.GetInputPort(port).FixValue(self.context, [float(number)])

    def tick(self) -> PoseMeasurement:
        self.system.ExecuteForcedEvents(self.context)
        found: PoseMeasurement = self.system.GetOutputPort("pose_measurement").Eval(self.context)
        return found


def test_views_and_touches_are_numbered_as_they_come() -> None:
    trial = Trial()
    assert (trial.tick().number, trial.tick().kind) == (0, "")
    trial.say("looked", 1)
    first = trial.tick()
    assert (first.number, first.kind) == (1, "view")
    assert len(first.points) > 20
    assert trial.tick() is first  # Nothing is new.
    trial.say("unreachable", 2)
    second = trial.tick()
    assert (second.number, second.kind, len(second.points)) == (2, "view", 0)
    assert trial.tick() is second
    trial.say("looked", 3)
    assert (trial.tick().number, trial.tick().kind) == (3, "view")
    trial.fix("touch_end", Ended(number=1, outcome="unreachable"))
    fourth = trial.tick()
    assert (fourth.number, fourth.kind, len(fourth.points)) == (4, "touch", 0)
    assert (len(fourth.free), fourth.displaced.any()) == (0, False)
    trial.fix("touch_end", Ended(number=2, outcome="miss"))
    assert (trial.tick().number, trial.tick().kind) == (5, "touch")
    widths = {one.displaced.shape[1] for one in (first, second, fourth, trial.tick())}
    assert widths == {WIDTH}


def test_before_the_object_is_looked_for_views_do_not_count() -> None:
    trial = Trial()
    guess = trial.system.GetInputPort("pose_guess").Eval(trial.context)
    trial.fix("pose_guess", NO_PRIOR)
    trial.say("looked", 3)
    assert trial.tick() is NO_MEASUREMENT
    trial.fix("pose_guess", guess)
    assert trial.tick() is NO_MEASUREMENT
    trial.say("looked", 4)
    assert (trial.tick().number, len(trial.tick().points) > 20) == (1, True)


def test_only_pixels_of_its_own_class_are_the_object_s() -> None:
    trial = Trial()
    objects = np.full(depth_image()[0].shape, -1)
    middle = objects.shape[1] // 2
    objects[:, :middle] = 7
    masks = ObjectMasks(number=1, view=0, objects=objects)
    box = Segment(number=7, name="box", contour=shapely.box(0.0, 0.0, 1.0, 1.0))
    trial.fix("object_masks", masks)
    trial.fix("segments", Segments(number=1, segments=(box,)))
    trial.say("looked", 1)
    assert trial.tick() is NO_MEASUREMENT  # The view is not segmented yet.
    trial.fix("object_masks", replace(masks, view=1))
    points = trial.tick().points
    assert len(points) > 10
    u = INTRINSICS.project((points - X_WC[:3, 3]) @ X_WC[:3, :3])[:, 0]
    assert u.max() < middle
    trial.fix("object_masks", replace(masks, view=2))
    elsewhere = shapely.box(2.0, 2.0, 3.0, 3.0)
    trial.fix("segments", Segments(number=2, segments=(replace(box, contour=elsewhere),)))
    trial.say("looked", 2)
    assert len(trial.tick().points) == 0


def test_of_glass_the_outline_counts_and_not_what_is_behind_it() -> None:
    trial = Trial()
    shown = depth_image()[1]
    objects = np.where(shown, 7, -1)
    masks = ObjectMasks(number=1, view=1, objects=objects, glass={7: 0.2})
    box = Segment(number=7, name="box", contour=shapely.box(0.0, 0.0, 1.0, 1.0))
    trial.fix("object_masks", masks)
    trial.fix("segments", Segments(number=1, segments=(box,)))
    trial.say("looked", 1)
    seen = trial.tick()
    assert len(seen.points) == 0
    assert len(seen.outline) == len(seen.outline_sigma) == TargetViewConfig().planes
    corners = 0.5 * EDGES * np.array(list(product((-1.0, 1.0), repeat=3))) + MIDDLE
    beyond = ((corners - seen.eye) @ seen.outline.T).max(axis=0)
    assert np.abs(beyond).max() < 2.0 / INTRINSICS.focal_x * np.linalg.norm(MIDDLE - seen.eye)
    # Nothing is known of where the rays end that pass through it.
    u, v = np.rint(INTRINSICS.project(seen.passed @ X_WC[:3, :3])).astype(int).T
    assert not shown[v, u].any()


def test_a_view_is_what_its_image_shows() -> None:
    trial = Trial()
    trial.say("looked", 1)
    seen = trial.tick()
    assert off_the_box(seen.points).max() < 1e-5
    assert_allclose(seen.eye, X_WC[:3, 3])
    to_eye = seen.eye - seen.points
    depths = -to_eye @ X_WC[:3, 2]
    to_eye /= np.linalg.norm(to_eye, axis=1, keepdims=True)
    assert_allclose(seen.facing, to_eye, atol=1e-9)
    sigma = NOISE.depth + NOISE.depth_growth * (depths - NOISE.depth_range) ** 2
    assert_allclose(seen.sigma, sigma, rtol=1e-5)
    assert len(seen.passed) > 100
    # Some of the rays that passed are known to be free up to where they end.
    assert seen.free.shape == (20, 2, 3)


def test_a_contact_is_a_point_and_what_was_swept_before_it() -> None:
    trial = Trial()
    away = UR5_HOME + np.array([0.1, 0.0, 0.0, 0.0, 0.0, 0.0])
    forces = np.array([[0.0, 0.0, -0.5], [0.0, 0.0, -0.05]])
    trial.fix(
        "touch_end", Ended(number=1, outcome="contact", q_start=away, q_end=UR5_HOME, forces=forces)
    )
    touched = trial.tick()
    X_WE = TAXELS.arm.Evaluate(UR5_HOME, 0.0)[0]
    tip = X_WE[:3, :3] @ [0.01, 0.0, 0.0] + X_WE[:3, 3]
    assert_allclose(touched.points, [tip], atol=1e-12)
    assert_allclose(touched.facing, [-X_WE[:3, 2]], atol=1e-12)
    assert_allclose(touched.sigma, [1e-3])
    X_start = TAXELS.arm.Evaluate(away, 0.0)[0]
    starts = TAXELS.p_ES @ X_start[:3, :3].T + X_start[:3, 3]
    assert_allclose(touched.free[:, 0], starts, atol=1e-12)
    errors = Displacements(camera=CAMERA, taxels=TAXELS)
    assert_allclose(touched.displaced, errors.touch(UR5_HOME))


def moved_by(A: Array, c: Array, p: Array) -> Array:
    """Where the errors c (m,) put a point p (3,) that a camera at X_WC sees, by A (8, m)."""
    d = A @ c
    r, k = p - X_WC[:3, 3], X_WC[:3, 2]
    stretched = p + d[6] * r + d[7] * (r - (r @ k) * k)
    return np.asarray((se3.exp(d[:6]) @ np.append(stretched, 1.0))[:3])


@pytest.mark.parametrize("error", range(6))
def test_errors_of_the_camera_s_pose_displace_what_it_sees(error: int) -> None:
    c = np.zeros(8)
    c[error] = 0.01
    A = camera_displacements(X_WC, CAMERA_COVARIANCE, 5e-3, 4e-3)
    true = X_WC @ se3.exp(np.sqrt(np.diag(CAMERA_COVARIANCE)) * c[:6])
    for p in (MIDDLE, MIDDLE + np.array([0.03, -0.05, 0.1])):
        truly = (true @ se3.inverse(X_WC) @ np.append(p, 1.0))[:3]
        assert_allclose(moved_by(A, c, p), truly, atol=1e-12)


def test_errors_of_depth_and_focal_length_displace_what_is_seen() -> None:
    """What is measured at 1 + s times the depth is nearer in truth, and so across the axis."""
    p = MIDDLE + np.array([0.02, 0.03, 0.05])
    A = camera_displacements(X_WC, CAMERA_COVARIANCE, 5e-3, 4e-3)
    p_C = X_WC[:3, :3].T @ (p - X_WC[:3, 3])
    step = 1e-3
    for column, true_C in (
        (6, p_C / (1.0 + 5e-3 * step)),
        (7, p_C / [1.0 + 4e-3 * step, 1.0 + 4e-3 * step, 1.0]),
    ):
        c = np.zeros(8)
        c[column] = step
        moved = moved_by(A, c, p) - p
        assert_allclose(moved, X_WC[:3, :3] @ (true_C - p_C), atol=1e-10)
        assert np.linalg.norm(moved) > 1e-7


def test_views_and_touches_share_no_errors_but_have_all_in_one_order() -> None:
    errors = Displacements(camera=CAMERA, taxels=TAXELS)
    view, touch = errors.view(PANDA_AWAY, X_WC), errors.touch(UR5_HOME)
    assert view.shape == (8, WIDTH)
    assert touch.shape == (6, WIDTH)
    assert view[:, :8].any(axis=0).all()
    assert not view[:, 21:].any()
    assert not touch[:, :21].any()
    assert touch[:, 21:].any(axis=0).all()
    assert_allclose(view[:6, 8:21], CAMERA.arm.displacements(PANDA_AWAY))
    X_WE = TAXELS.arm.Evaluate(UR5_HOME, 0.0)[0]
    # The taxels' places are along the axes of E.
    assert_allclose(touch[3:, -3:], 5e-4 * X_WE[:3, :3])
    assert not touch[:3, -3:].any()
