"""The plan back to the start: closed forms, the loop on the perceived joint, its ports."""

from itertools import pairwise

import numpy as np
import pytest
from known_arm import STILL, arm_model
from numpy.testing import assert_allclose
from pydrake.systems.analysis import Simulator

from crossmodal.controllers.arm.impedance import NO_GAINS, NO_MOTION, DesiredMotion, ImpedanceGains
from crossmodal.controllers.interaction.phases import Phase
from crossmodal.controllers.interaction.trajectory_generator import (
    Plan,
    TrajectoryGenerator,
    TrajectoryGeneratorConfig,
    advance,
    path_gains,
    plan_duration,
)
from crossmodal.maths import se3


def about_vertical(point: np.ndarray) -> np.ndarray:
    """Unit screw (6,) in W of a vertical axis through a point."""
    axis = np.array([0.0, 0.0, 1.0])
    return np.concatenate([axis, np.cross(point, axis)])


def plan_from(q: float, X_WE: np.ndarray, duration: float) -> Plan:
    still = DesiredMotion(X_WE=X_WE, V_WE_E=np.zeros(6), A_WE_E=np.zeros(6))
    gains = ImpedanceGains(stiffness=np.eye(6), damping=np.eye(6), mass=np.eye(6))
    return Plan(start=0.0, duration=duration, q_start=q, revolute=False, motion=still, gains=gains)


def follow(screw_W: np.ndarray, q_0: float, X_0: np.ndarray) -> tuple[list[Plan], list[float]]:
    """A hand that is always where it is wanted, and a joint perceived where the hand has it."""
    config = TrajectoryGeneratorConfig()
    S_E = se3.adjoint(se3.inverse(X_0)) @ screw_W
    duration = plan_duration(q_0, float(np.linalg.norm(S_E[3:])), config.speed)
    plan, q = plan_from(q_0, X_0, duration), q_0
    plans, configurations = [], []
    for k in range(1, round((duration + 1.0) / config.period)):
        plan = advance(plan, plan.motion.X_WE, screw_W, q, k * config.period, config)
        moved = se3.log(plan.motion.X_WE @ se3.inverse(X_0))
        q = q_0 + float(moved @ screw_W / (screw_W @ screw_W))
        plans.append(plan)
        configurations.append(q)
    return plans, configurations


def test_a_revolute_joint_makes_a_circle_that_ends_at_the_start() -> None:
    point, q_0 = np.array([0.5, -0.2, 0.0]), 0.7
    X_0 = se3.exp(np.array([0.3, -0.2, 0.5, 0.9, -0.5, 0.8]))
    plans, configurations = follow(about_vertical(point), q_0, X_0)
    p_WE = np.array([plan.motion.X_WE[:3, 3] for plan in plans])
    radius = np.hypot(*(X_0[:2, 3] - point[:2]))
    assert_allclose(np.hypot(*(p_WE[:, :2] - point[:2]).T), radius, rtol=1e-9)
    assert_allclose(p_WE[:, 2], X_0[2, 3])
    X_goal = se3.exp(about_vertical(point) * -q_0) @ X_0
    assert_allclose(plans[-1].motion.X_WE, X_goal, atol=1e-4)
    assert_allclose(configurations[-1], 0.0, atol=1e-4)


def test_a_screw_makes_a_helix_that_ends_at_the_start() -> None:
    """While the hand turns by a radian about the axis, it climbs by the pitch along it."""
    point, q_0, pitch = np.array([0.5, -0.2, 0.0]), 0.9, 0.02
    screw_W = about_vertical(point) + np.array([0, 0, 0, 0, 0, pitch])
    X_0 = se3.exp(np.array([0.3, -0.2, 0.5, 0.9, -0.5, 0.8]))
    plans, configurations = follow(screw_W, q_0, X_0)
    p_WE = np.array([plan.motion.X_WE[:3, 3] for plan in plans])
    radius = np.hypot(*(X_0[:2, 3] - point[:2]))
    assert_allclose(np.hypot(*(p_WE[:, :2] - point[:2]).T), radius, rtol=1e-9)
    turned = np.unwrap(np.arctan2(*(p_WE[:, :2] - point[:2]).T[::-1]))
    assert_allclose(p_WE[:, 2] - p_WE[0, 2], pitch * (turned - turned[0]), atol=1e-12)
    assert_allclose(p_WE[-1, 2] - X_0[2, 3], -pitch * q_0, atol=1e-5)
    assert_allclose(configurations[-1], 0.0, atol=1e-4)


def test_the_commanded_velocity_is_the_derivative_of_the_commanded_pose() -> None:
    X_0 = se3.exp(np.array([0.3, -0.2, 0.5, 0.9, -0.5, 0.8]))
    plans, _ = follow(about_vertical(np.array([0.5, -0.2, 0.0])), 0.7, X_0)
    period = TrajectoryGeneratorConfig().period
    fastest = 0.0
    for before, after in pairwise(plans):
        V = se3.log(se3.inverse(before.motion.X_WE) @ after.motion.X_WE) / period
        assert_allclose(after.motion.V_WE_E, V, atol=1e-9)
        fastest = max(fastest, float(np.linalg.norm(V[3:])))
    assert_allclose(fastest, TrajectoryGeneratorConfig().speed, rtol=0.05)


def test_a_joint_that_lags_behind_the_plan_is_drawn_on() -> None:
    """The handle yields 1 cm: the hand goes that much farther, so that the joint ends at zero."""
    screw_W, config = np.array([0.0, 0, 0, 1, 0, 0]), TrajectoryGeneratorConfig()
    plan = plan_from(0.2, np.eye(4), 5.0)
    for k in range(1500):
        q = 0.21 + plan.motion.X_WE[0, 3]
        plan = advance(plan, plan.motion.X_WE, screw_W, q, k * config.period, config)
    assert_allclose(plan.motion.X_WE[0, 3], -0.21, atol=1e-4)


def test_a_better_screw_turns_the_rest_of_the_path_without_a_jump() -> None:
    config = TrajectoryGeneratorConfig()
    plan = plan_from(0.2, np.eye(4), 5.0)
    before = advance(plan, np.eye(4), np.array([0.0, 0, 0, 1, 0, 0]), 0.2, 2.5, config)
    after = advance(before, before.motion.X_WE, np.array([0.0, 0, 0, 0, 1, 0]), 0.1, 2.51, config)
    step = se3.log(se3.inverse(before.motion.X_WE) @ after.motion.X_WE)
    assert np.linalg.norm(step) < 1.5 * config.speed * config.period + 1e-12
    assert_allclose(step[[0, 1, 2, 3, 5]], 0.0, atol=1e-12)
    assert step[4] < 0.0


def test_without_perception_the_plan_goes_on_as_it_is() -> None:
    config = TrajectoryGeneratorConfig()
    plan = plan_from(0.2, np.eye(4), 10.0)
    for k in range(1100):
        X_WE = plan.motion.X_WE
        plan = advance(plan, X_WE, np.array([0.0, 0, 0, 1, 0, 0]), None, k * 0.01, config)
    assert_allclose(plan.motion.X_WE[0, 3], -0.2, atol=1e-6)


def test_the_plan_waits_for_a_hand_that_is_held_up() -> None:
    config = TrajectoryGeneratorConfig()
    plan = plan_from(0.2, np.eye(4), 2.0)
    for k in range(1000):
        plan = advance(plan, np.eye(4), np.array([0.0, 0, 0, 1, 0, 0]), 0.2, k * 0.01, config)
    assert_allclose(plan.motion.X_WE[0, 3], -config.lead, atol=config.speed * 0.02)


def test_only_the_way_of_the_joint_is_stiff() -> None:
    config = TrajectoryGeneratorConfig()
    stiffness = path_gains(np.array([0.0, 0, 0.3, 0.0, 2.0, 0.0]), config).stiffness
    expected = [config.stiffness_rotation] * 3 + [
        config.stiffness_across,
        config.stiffness_along,
        config.stiffness_across,
    ]
    assert_allclose(stiffness, np.diag(expected), atol=1e-12)


def generator_at(phase: Phase) -> tuple[TrajectoryGenerator, Simulator]:
    generator = TrajectoryGenerator(TrajectoryGeneratorConfig(), arm_model())
    simulator = Simulator(generator)
    context = simulator.get_mutable_context()
    generator.GetInputPort("joint_state_measured").FixValue(context, STILL)
    generator.GetInputPort("phase").FixValue(context, [float(phase)])
    screw_W = np.array([0.0, 0, 0, 0, 1, 0])
    generator.GetInputPort("joint_remembered").FixValue(context, np.append(screw_W, [0.1, 0.0]))
    generator.GetInputPort("end_effector_screw_remembered").FixValue(context, screw_W)
    return generator, simulator


def test_before_the_return_there_is_no_motion_and_no_plan() -> None:
    generator, simulator = generator_at(Phase.EXPLORE)
    simulator.AdvanceTo(0.1)
    context = simulator.get_context()
    assert generator.GetOutputPort("motion_desired").Eval(context) is NO_MOTION
    assert generator.GetOutputPort("gains_desired").Eval(context) is NO_GAINS
    assert np.isinf(generator.GetOutputPort("plan_time_left").Eval(context)[0])
    assert len(generator.GetOutputPort("path_planned").Eval(context)) == 0


def test_the_return_begins_where_the_hand_is_and_leads_to_the_joints_start() -> None:
    generator, simulator = generator_at(Phase.RETURN)
    simulator.AdvanceTo(0.005)
    context = simulator.get_context()
    X_WE = arm_model().Evaluate(STILL).X_WE
    motion = generator.GetOutputPort("motion_desired").Eval(context)
    assert_allclose(motion.X_WE, X_WE, atol=1e-4)
    path = generator.GetOutputPort("path_planned").Eval(context)
    assert_allclose(path[0], motion.X_WE)
    assert_allclose(path[-1][:3, 3] - path[0][:3, 3], [0.0, -0.1, 0.0], atol=1e-12)
    left = generator.GetOutputPort("plan_time_left").Eval(context)[0]
    assert_allclose(left, plan_duration(0.1, 1.0, TrajectoryGeneratorConfig().speed), atol=0.02)


def test_impossible_values_are_refused_by_name() -> None:
    with pytest.raises(ValueError, match="speed"):
        TrajectoryGenerator(TrajectoryGeneratorConfig(speed=0.0), arm_model())
    with pytest.raises(ValueError, match="mass"):
        TrajectoryGenerator(TrajectoryGeneratorConfig(mass=np.nan), arm_model())
