"""Joints that move as fast, and turn as abruptly, as a 15 Hz stream can show."""

import numpy as np
import pytest
from synthetic_motion import Scene, filter_states, simulate

from maths.arrays import Array
from systems.port_values import JointType

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
