import numpy as np
import pytest
from matplotlib.figure import Figure
from numpy.testing import assert_allclose
from synthetic_episode import joint_belief, synthetic_episode

from crossmodal.diagrams.joints.joint_drawing import (
    HELIX_RADIUS,
    draw_joint,
    helix_along,
    sketch_joint,
    uncertainty_outline,
)
from crossmodal.systems.port_values import JointType


def test_a_sketch_points_to_growing_opening_whatever_the_signs() -> None:
    last = synthetic_episode().estimators["crossmodal"].ticks[-1]
    body = last.values["body_motions_latest"].bodies[0]
    axis = np.array([0.0, -1.0, 0.0])
    for sign in (1.0, -1.0):
        sketch = sketch_joint(
            joint_belief(JointType.PRISMATIC, sign * axis, sign * 0.1, 0.001, 0.05), body
        )
        assert sketch is not None
        assert_allclose(sketch.direction_W, axis)
        assert_allclose(sketch.center_W[:2], body.motion.X[:2, 3])
        assert_allclose(sketch.angle, 0.1)
        assert sketch.radius == 0.0


def test_a_revolute_sketch_lies_on_its_axis_with_two_deviations_around_it() -> None:
    point = np.array([0.5, 0.2, 0.3])
    joint = joint_belief(JointType.REVOLUTE, np.array([0.0, 0, 1]), 0.5, 0.01, 0.05, point=point)
    sketch = sketch_joint(joint, None)
    assert sketch is not None
    assert_allclose(sketch.center_W, point)
    assert_allclose(sketch.radius, 0.02)
    outline = uncertainty_outline(sketch, 1.0, points=8)
    assert_allclose(np.linalg.norm(outline[:8] - point, axis=1), 0.02)
    far = outline[8:] - point
    assert_allclose(far[:, 2], 0.5 * sketch.length)
    assert_allclose(np.hypot(far[:, 0], far[:, 1]), 0.02 + 0.5 * sketch.length * np.tan(0.1))


def test_bodies_that_do_not_move_have_no_sketch() -> None:
    for joint_type in (JointType.RIGID, JointType.DISCONNECTED):
        belief = joint_belief(joint_type, np.array([0.0, 0, 1]), 0.5, 0.01, 0.05)
        assert sketch_joint(belief, None) is None


def test_a_thread_runs_about_its_bar_from_end_to_end() -> None:
    bar = np.array([0.3, 0.0, 0.0])
    thread = helix_along(bar)
    assert_allclose(thread[[0, -1], 0], [-0.15, 0.15])
    assert_allclose(np.linalg.norm(thread[:, 1:], axis=1), HELIX_RADIUS)


@pytest.mark.parametrize("joint_type", [JointType.PRISMATIC, JointType.REVOLUTE])
def test_a_joint_is_drawn_where_the_camera_sees_it(joint_type: JointType) -> None:
    record = synthetic_episode(joint_type)
    values = record.estimators["crossmodal"].ticks[-1].values
    joint, body = values["joints_latest"].joints[0], values["body_motions_latest"].bodies[0]
    for left, seen in ((0.0, True), (5000.0, False)):
        axes = Figure().subplots()
        axes.set_xlim(left, left + 640.0)
        axes.set_ylim(480.0, 0.0)
        assert draw_joint(axes, joint, body, record.calibration.camera) is seen
