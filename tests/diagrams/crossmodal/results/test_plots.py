from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure
from numpy.testing import assert_allclose
from synthetic_episode import empty_episode, joint_belief, synthetic_episode

from diagrams.crossmodal.results.frame_plots import draw_frames
from diagrams.crossmodal.results.plots import draw_errors, draw_openings, save
from diagrams.drawing import palette
from diagrams.joints.joint_drawing import perpendicular_axes, sketch_joint, uncertainty_outline
from systems.port_values import JointType


def texts(figure: Figure) -> str:
    figure.canvas.draw()
    return "\n".join(text.get_text() for text in figure.findobj(lambda a: hasattr(a, "get_text")))


@pytest.mark.parametrize("joint_type", [JointType.PRISMATIC, JointType.REVOLUTE])
def test_all_figures_are_drawn(joint_type: JointType, tmp_path: Path) -> None:
    result = synthetic_episode(joint_type)
    for draw in (draw_errors, draw_openings, draw_frames):
        figure = draw(result)
        assert figure is not None
        path = tmp_path / "figure.partial"
        save(figure, path)
        assert path.read_bytes().startswith(b"\x89PNG")


def test_the_error_plot_shows_every_modality_the_events_and_the_unit() -> None:
    words = texts(draw_errors(synthetic_episode()))
    for label in ("vision", "proprioception", "cross-modal", "lights off", "grasped", "error [mm]"):
        assert label in words
    assert "error [deg]" in texts(draw_errors(synthetic_episode(JointType.REVOLUTE)))


def test_each_curve_is_the_error_in_millimetres_in_its_modalitys_colour() -> None:
    result = synthetic_episode()
    axes = draw_errors(result).axes[0]
    (curve,) = (
        line
        for line in axes.lines
        if line.get_color() == palette.MODALITY["crossmodal"] and len(line.get_xdata()) > 10
    )
    error = np.asarray(curve.get_ydata())
    assert 0.1 < np.nanmedian(np.abs(error)) < 5.0
    low, high = axes.get_ylim()
    assert -low == high < 60.0


def test_frames_come_from_start_middle_and_end_of_the_motion() -> None:
    result = synthetic_episode()
    words = texts(draw_frames(result))
    for time in ("t = 4.5 s", "t = 9.5 s\nprismatic", "t = 15.5 s, lights off"):
        assert time in words
    result.scenario.disturbances.lights_off.clear()
    assert "t = 10.0 s" in texts(draw_frames(result))
    assert "prismatic, q = 22." in words


def test_an_episode_that_hardly_began_is_drawn_without_frames() -> None:
    result = empty_episode()
    assert draw_frames(result) is None
    texts(draw_errors(result))
    texts(draw_openings(result))


def test_a_sketch_points_to_growing_opening_whatever_the_signs() -> None:
    result = synthetic_episode()
    body = result.modalities["crossmodal"].ticks[-1].bodies.bodies[0]
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


@pytest.mark.parametrize("direction", np.eye(3))
def test_perpendicular_axes_complete_a_right_handed_frame(direction: np.ndarray) -> None:
    u, v = perpendicular_axes(direction)
    R = np.column_stack([u, v, direction])
    assert_allclose(R.T @ R, np.eye(3), atol=1e-12)
    assert_allclose(np.linalg.det(R), 1.0)


def test_the_camera_projects_its_optical_axis_to_the_principal_point() -> None:
    camera = synthetic_episode().camera
    z = camera.X_WC[:3, 2]
    ahead = camera.X_WC[:3, 3] + 0.7 * z
    assert_allclose(camera.project(ahead), [[319.5, 239.5]])
    assert np.all(np.isnan(camera.project(camera.X_WC[:3, 3] - z)))
    right = camera.project(ahead + 0.07 * camera.X_WC[:3, 0])
    assert_allclose(right, [[319.5 + 57.7, 239.5]])
