"""Joint commands move the fingertip as they should, within the joints' limits."""

from functools import cache

import numpy as np
import pytest
from numpy.testing import assert_allclose
from pydrake.math import RigidTransform
from pydrake.multibody.plant import MultibodyPlant

from crossmodal.controllers.arm.kinematics import ArmModel
from crossmodal.controllers.servoing.twist_to_joints import TwistToJoints, TwistToJointsConfig
from crossmodal.maths import se3
from crossmodal.plants.robots.arm_with_hand import make_arm_with_load
from crossmodal.plants.robots.lwr import LWR_WITH_FINGERTIP

Q = np.array([-0.22, -0.63, -0.39, 1.6, 1.4, 1.01, -0.83])
CONFIG = TwistToJointsConfig()


@cache
def model() -> MultibodyPlant:
    return make_arm_with_load(LWR_WITH_FINGERTIP, RigidTransform())


@cache
def arm() -> ArmModel:
    return ArmModel(model())


def limited(half_range: float = 0.0, speed: float = 0.0) -> ArmModel:
    """An arm whose joints have a range about Q [rad] and a speed [rad/s] of their own."""
    plant = make_arm_with_load(LWR_WITH_FINGERTIP, RigidTransform())
    for joint in map(plant.get_joint, plant.GetJointIndices()):
        if joint.num_positions() and half_range:
            middle = Q[joint.position_start()]
            joint.set_position_limits([middle - half_range], [middle + half_range])
        if joint.num_positions() and speed:
            joint.set_velocity_limits([-speed], [speed])
    return ArmModel(plant)


def pose(q: np.ndarray) -> np.ndarray:
    return arm().Evaluate(np.concatenate([q, np.zeros(7)])).X_WE


def follow(
    V_WS_S: np.ndarray,
    steps: int,
    given: ArmModel | None = None,
    config: TwistToJointsConfig = CONFIG,
    follows: bool = True,
) -> tuple[np.ndarray, np.ndarray]:
    """Commands (steps, 7) and shares (steps,), by an arm that follows at once or stands still."""
    system = TwistToJoints(config, given or arm(), Q)
    context = system.CreateDefaultContext()
    system.GetInputPort("twist_desired").FixValue(context, V_WS_S)
    measured = system.GetInputPort("joint_state_measured")
    commands, shares = [], []
    for _ in range(steps):
        q = system.GetOutputPort("joint_position_commanded").Eval(context).copy()
        measured.FixValue(context, np.concatenate([q if follows else Q, np.zeros(7)]))
        context.SetDiscreteState(system.EvalUniquePeriodicDiscreteUpdate(context))
        commands.append(system.GetOutputPort("joint_position_commanded").Eval(context).copy())
        shares.append(system.GetOutputPort("twist_share").Eval(context)[0])
    return np.array(commands), np.array(shares)


def test_the_first_command_is_where_the_arm_is() -> None:
    system = TwistToJoints(CONFIG, arm(), Q)
    context = system.CreateDefaultContext()
    assert_allclose(system.GetOutputPort("joint_position_commanded").Eval(context), Q)


def test_the_fingertip_moves_by_the_twist_in_its_own_frame() -> None:
    V = np.array([0.05, -0.02, 0.08, 0.007, 0.002, -0.003])
    commands, shares = follow(V, 50)
    assert_allclose(shares, 1.0, atol=1e-6)
    moved = se3.log(se3.inverse(pose(Q)) @ pose(commands[-1]))
    assert_allclose(moved, 0.5 * V, atol=2e-4)


def test_no_twist_is_no_motion() -> None:
    commands, shares = follow(np.zeros(6), 20)
    assert_allclose(commands, np.tile(Q, (20, 1)), atol=1e-9)
    assert_allclose(shares, 1.0)


def test_a_twist_that_is_too_fast_is_done_in_its_direction_as_far_as_possible() -> None:
    V = np.array([0.0, 0.0, 0.0, 0.1, 0.0, 0.0])
    commands, shares = follow(V, 1, limited(speed=0.02))
    assert 0.0 < shares[0] < 0.9
    assert np.abs(commands[0] - Q).max() <= 0.01 * 0.02 * CONFIG.velocity_share + 1e-7
    moved = se3.log(se3.inverse(pose(Q)) @ pose(commands[0]))
    assert_allclose(moved[3:], [0.01 * 0.1 * shares[0], 0.0, 0.0], atol=1e-6)
    assert_allclose(moved[:3], 0.0, atol=1e-6)


def test_a_joint_at_its_limit_stops_the_twist_and_does_not_wind_up() -> None:
    """With joint 7 held at its limit, the command goes no further and comes back at once."""
    V = np.array([0.0, 0.0, 0.1, 0.0, 0.0, 0.0])
    commands, shares = follow(V, 200, limited(half_range=CONFIG.margin + 0.01))
    assert shares[-1] < 0.01
    assert np.all(commands <= Q + 0.01 + 1e-7)
    assert np.all(commands >= Q - 0.01 - 1e-7)


def test_the_command_does_not_run_away_from_an_arm_that_is_held_up() -> None:
    V = np.array([0.0, 0.0, 0.3, 0.0, 0.0, 0.0])
    commands, shares = follow(V, 300, follows=False)
    assert np.abs(commands - Q).max() <= CONFIG.lead + 1e-12
    assert shares[-1] == 0.0


def test_a_posture_beyond_the_limits_is_refused() -> None:
    with pytest.raises(ValueError, match="TwistToJoints: q_initial"):
        TwistToJoints(CONFIG, arm(), Q + 10.0)
