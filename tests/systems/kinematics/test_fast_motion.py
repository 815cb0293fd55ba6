"""Joints that move as fast, and turn as abruptly, as a 15 Hz stream can show."""

import numpy as np
import pytest
from synthetic_motion import RATE, Motion, Scene, at_rest, filter_states, simulate

from crossmodal.maths import se3
from crossmodal.maths.arrays import Array
from crossmodal.systems.kinematics.joint_filters import JointFilters, JointFiltersConfig
from crossmodal.systems.kinematics.measurement_errors import MeasurementErrorsConfig
from crossmodal.systems.port_values import JointType

PRISMATIC, REVOLUTE = JointType.PRISMATIC, JointType.REVOLUTE


def thrown_shut(t: Array) -> Array:
    """A quarter of a turn at 0.35 m within a second, after two at rest."""
    return 0.35 * np.pi / 2.0 * np.clip(t - 2.0, 0.0, 1.0)


def pulled_open(t: Array) -> Array:
    """Thirty centimetres within half a second, after two at rest."""
    return 0.3 * np.clip((t - 2.0) / 0.5, 0.0, 1.0)


def swinging(t: Array) -> Array:
    """Thirty degrees at 0.35 m to both sides, every two seconds."""
    return 0.35 * np.pi / 6.0 * np.sin(np.pi * t)


@pytest.mark.parametrize(
    "scene",
    [
        Scene(joint=REVOLUTE, motion=thrown_shut, seconds=8.0),
        Scene(joint=PRISMATIC, motion=pulled_open, seconds=8.0),
        Scene(joint=REVOLUTE, motion=swinging, seconds=8.0),
    ],
)
def test_a_fast_motion_is_followed(scene: Scene) -> None:
    lever = 1.0 if scene.joint == PRISMATIC else scene.radius
    squares = []
    for seed in range(3):
        run = simulate(scene, seed)
        filters, states = filter_states(scene, run)
        assert filters.belief(states[-1]).type == scene.joint
        for k in range(45, len(states)):
            m = filters.belief(states[k]).models[scene.joint]
            error = m.configuration[0] - run.q[k]
            squares.append((error**2 / m.configuration_covariance[0, 0], (lever * error) ** 2))
    nees, square = np.mean(squares, axis=0)
    assert nees < 3.0
    assert np.sqrt(square) < 2.0 * scene.translation


@pytest.mark.parametrize("motion", [thrown_shut, pulled_open])
def test_the_first_frames_of_a_fast_motion_are_followed(motion: Motion) -> None:
    """From rest, and back to it: the body is where it is seen, not an outlier."""
    scene = Scene(joint=PRISMATIC, motion=motion, seconds=4.0)
    for seed in range(6):
        run = simulate(scene, seed)
        filters, states = filter_states(scene, run)
        for k in range(round(2.0 * RATE) + 1, len(states)):
            m = filters.belief(states[k]).models[PRISMATIC]
            assert abs(m.configuration[0] - run.q[k]) < 4.0 * scene.translation


def test_a_single_bad_pose_of_a_resting_body_is_no_jump() -> None:
    scene = Scene(joint=JointType.RIGID, motion=at_rest, seconds=6.0)
    for seed in range(4):
        run = simulate(scene, seed)
        run.measured[45, :3, 3] += [0.05, 0.0, 0.0]
        filters, states = filter_states(scene, run)
        for state in states[49:]:
            assert filters.belief(state).type == JointType.RIGID


def test_a_type_that_is_far_behind_is_back_when_its_turn_comes() -> None:
    """A drawer of which a hinge's evidence has waited: it comes to its end and swings down."""
    errors = MeasurementErrorsConfig(wander=0.0)  # Which it might be for a while, else.
    filters = JointFilters(JointFiltersConfig(errors=errors))
    rng, X, R = np.random.default_rng(0), np.eye(4), np.diag(np.repeat([3e-4, 9e-6], 3))
    state, since = filters.start(X, R, 0.0), None
    for k in range(1, 100):
        turning = k > 60
        step = np.array([0.0, 0.03 * turning, 0.0, 0.005 * (not turning), 0.0, 0.0])
        X = X @ se3.exp(step)
        noise = np.sqrt(np.diag(R)) * rng.normal(size=6)
        state = filters.update(state, X @ se3.exp(noise), R, k / 15.0)
        if k == 60:
            assert filters.belief(state).type == PRISMATIC
        if since is None and k > 60 and filters.belief(state).type == JointType.DISCONNECTED:
            since = k
    assert since is not None
    assert since < 75
