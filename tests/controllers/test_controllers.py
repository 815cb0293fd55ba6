"""Impedance, exploration and grasp sequence through their ports."""

from functools import cache

import numpy as np
import pytest
from numpy.testing import assert_allclose
from pydrake.common.value import AbstractValue
from pydrake.math import RigidTransform
from pydrake.systems.analysis import Simulator

from controllers.arm.impedance import (
    DesiredMotion,
    ImpedanceConfig,
    ImpedanceController,
    ImpedanceGains,
    impedance_wrench,
    posture_torque,
)
from controllers.arm.kinematics import ArmModel
from controllers.interaction.exploration import (
    ExplorationConfig,
    ExplorationController,
    explore_step,
)
from controllers.interaction.grasp_motion import exploration_gains, minimum_jerk
from controllers.interaction.grasp_sequence import GraspSequence
from controllers.interaction.grasp_sequence_config import GraspSequenceConfig
from controllers.interaction.phases import Phase
from controllers.interaction.pull_direction import PullDirection, PullDirectionConfig
from maths import se3
from plants.robots.arm_with_hand import make_arm_with_load
from plants.robots.wam import WAM_WITH_SOFT_HAND

Q = np.array([-0.6, 0.9, 0.45, 1.5, -3.65, 0.7, 0.1])
BACK = np.array([0.0, 0.0, -1.0])


@cache
def arm_model() -> ArmModel:
    return ArmModel(make_arm_with_load(WAM_WITH_SOFT_HAND, RigidTransform()))


def desired(X_WE: np.ndarray, V: np.ndarray | None = None) -> DesiredMotion:
    return DesiredMotion(X_WE=X_WE, V_WE_E=np.zeros(6) if V is None else V, A_WE_E=np.zeros(6))


def gains(scale: float) -> ImpedanceGains:
    return ImpedanceGains(
        stiffness=scale * np.eye(6), damping=scale * np.eye(6), mass=scale * np.eye(6)
    )


def test_the_wrench_is_that_of_spring_damper_and_mass() -> None:
    rng = np.random.default_rng(0)
    state = arm_model().Evaluate(np.concatenate([Q, rng.normal(size=7)]))
    xi, V_des, A_des = rng.normal(size=(3, 6)) * 0.3
    motion = DesiredMotion(X_WE=state.X_WE @ se3.exp(xi), V_WE_E=V_des, A_WE_E=A_des)
    K, D, M = rng.normal(size=(3, 6, 6))
    wrench = impedance_wrench(state, motion, ImpedanceGains(stiffness=K, damping=D, mass=M))
    assert_allclose(wrench, K @ xi + D @ (V_des - state.V_WE_E) + M @ A_des, atol=1e-9)


def test_the_posture_torque_leaves_the_end_effector_alone() -> None:
    state = arm_model().Evaluate(np.concatenate([Q, np.zeros(7)]))
    tau = posture_torque(state, Q + 0.3, 4.0, 0.4)
    wrench, *_ = np.linalg.lstsq(state.J_E.T, tau, rcond=None)
    assert_allclose(wrench, np.zeros(6), atol=1e-9)
    assert np.linalg.norm(tau) > 0.01


def test_an_arm_at_its_goal_is_held_against_gravity_only() -> None:
    state = arm_model().Evaluate(np.concatenate([Q, np.zeros(7)]))
    controller = ImpedanceController(ImpedanceConfig(), arm_model(), Q)
    context = controller.CreateDefaultContext()
    controller.GetInputPort("joint_state_measured").FixValue(
        context, np.concatenate([Q, np.zeros(7)])
    )
    controller.GetInputPort("motion_desired").FixValue(
        context, AbstractValue.Make(desired(state.X_WE))
    )
    controller.GetInputPort("gains_desired").FixValue(context, AbstractValue.Make(gains(100.0)))
    torque = controller.EvalUniquePeriodicDiscreteUpdate(context).value()
    assert_allclose(torque, state.tau_bias, atol=1e-6)
    assert np.abs(torque).max() > 1.0


def test_what_the_spring_holds_before_contact_is_taken_over_and_then_kept() -> None:
    state = arm_model().Evaluate(np.concatenate([Q, np.zeros(7)]))
    config = ImpedanceConfig()
    controller = ImpedanceController(config, arm_model(), Q)
    error = np.array([0.01, 0, 0, 0, 0.002, 0])
    simulator = Simulator(controller)
    context = simulator.get_mutable_context()
    tare = controller.GetInputPort("tare")
    tare.FixValue(context, [1.0])
    for name, value in (
        ("motion_desired", desired(state.X_WE @ se3.exp(error))),
        ("gains_desired", gains(100.0)),
    ):
        controller.GetInputPort(name).FixValue(context, AbstractValue.Make(value))
    controller.GetInputPort("joint_state_measured").FixValue(
        context, np.concatenate([Q, np.zeros(7)])
    )
    simulator.AdvanceTo(config.tare_time - 0.5 * config.period)
    spring = state.J_E.T @ (100.0 * error)
    port = controller.GetOutputPort("torque_commanded")
    assert_allclose(port.Eval(context), state.tau_bias + 2.0 * spring, atol=1e-6)
    tare.FixValue(context, [0.0])
    simulator.AdvanceTo(1.0)
    assert_allclose(port.Eval(context), state.tau_bias + 2.0 * spring, atol=1e-6)


def test_a_hand_that_lags_pulls_the_goal_ahead_in_the_wanted_direction() -> None:
    wanted = np.array([0, 0, 0, 0, 0, -0.02])
    X = explore_step(np.eye(4), 0.5 * wanted, wanted, 0.1)
    assert_allclose(X[:3, 3], [0, 0, -0.001])
    assert_allclose(explore_step(np.eye(4), wanted, wanted, 0.1), np.eye(4))


def explore_once(phase: Phase) -> tuple[np.ndarray, DesiredMotion | None]:
    state = arm_model().Evaluate(np.concatenate([Q, np.zeros(7)]))
    controller = ExplorationController(ExplorationConfig(), arm_model())
    context = controller.CreateDefaultContext()
    controller.GetInputPort("pull_direction").FixValue(context, BACK)
    controller.GetInputPort("joint_state_measured").FixValue(
        context, np.concatenate([Q, np.zeros(7)])
    )
    goal = state.X_WE @ se3.exp(np.full(6, 0.05))
    commanded = AbstractValue.Make(desired(goal))
    controller.GetInputPort("motion_commanded").FixValue(context, commanded)
    controller.GetInputPort("phase").FixValue(context, [float(phase)])
    simulator = Simulator(controller, context)
    simulator.AdvanceTo(0.005)
    return state.X_WE, controller.GetOutputPort("motion_desired").Eval(context)


def test_before_exploration_nothing_is_asked_of_the_arm() -> None:
    assert explore_once(Phase.CLOSE)[1] is None


def test_exploration_advances_the_goal_along_the_pull_and_lets_the_rest_follow_the_hand() -> None:
    X_WE, motion = explore_once(Phase.EXPLORE)
    assert motion is not None
    error = se3.log(se3.inverse(X_WE) @ motion.X_WE)
    step = ExplorationConfig().gain * ExplorationConfig().speed
    assert_allclose(error[:5], 0.0, atol=1e-9)
    assert_allclose(error[5], 0.05 - step, atol=1e-6)
    assert_allclose(motion.V_WE_E, [0, 0, 0, 0, 0, -0.02])


def test_exploration_is_compliant_but_in_the_pulling_direction() -> None:
    compliant = exploration_gains(GraspSequenceConfig(), 3.0 * BACK)
    assert_allclose(np.diag(compliant.stiffness), [0.1] * 5 + [400.0])
    assert_allclose(np.diag(compliant.damping), [1.0] * 5 + [200.0])
    assert_allclose(compliant.mass, np.eye(6))


def test_the_blend_has_the_derivatives_it_claims() -> None:
    h = 1e-5
    for s in (0.1, 0.5, 0.83):
        position, rate, acceleration = minimum_jerk(s)
        low, high = minimum_jerk(s - h), minimum_jerk(s + h)
        assert_allclose(rate, (high[0] - low[0]) / (2 * h), rtol=1e-6)
        assert_allclose(acceleration, (high[1] - low[1]) / (2 * h), rtol=1e-6, atol=1e-6)
        assert 0 < position < 1


def test_the_sequence_goes_through_its_phases_and_stops_after_its_travel() -> None:
    config = GraspSequenceConfig(approach_time=0.1, close_time=0.1, travel=0.05)
    state = arm_model().Evaluate(np.concatenate([Q, np.zeros(7)]))
    sequence = GraspSequence(config, arm_model(), state.X_WE, state.X_WE)
    simulator = Simulator(sequence)
    context = simulator.get_mutable_context()
    port = sequence.GetInputPort("joint_state_measured")
    port.FixValue(context, np.concatenate([Q, np.zeros(7)]))

    def phase_at(time: float) -> int:
        simulator.AdvanceTo(time)
        return int(sequence.GetOutputPort("phase").Eval(context)[0])

    assert phase_at(0.05) == Phase.APPROACH
    assert sequence.GetOutputPort("interaction_active").Eval(context)[0] == 0
    assert phase_at(0.15) == Phase.CLOSE
    assert np.all(sequence.GetOutputPort("pressure_commanded").Eval(context) > 0)
    assert phase_at(0.25) == Phase.EXPLORE
    assert sequence.GetOutputPort("interaction_active").Eval(context)[0] == 1
    moved = Q.copy()
    moved[3] += 0.3
    port.FixValue(context, np.concatenate([moved, np.zeros(7)]))
    assert phase_at(0.3) == Phase.STOP


def test_a_hand_that_comes_away_empty_says_that_it_holds_nothing_any_more() -> None:
    config = GraspSequenceConfig(approach_time=0.1, close_time=0.1)
    state = arm_model().Evaluate(np.concatenate([Q, np.zeros(7)]))
    sequence = GraspSequence(config, arm_model(), state.X_WE, state.X_WE)
    simulator = Simulator(sequence)
    context = simulator.get_mutable_context()
    sequence.GetInputPort("joint_state_measured").FixValue(context, np.append(Q, np.zeros(7)))
    held = np.array(config.closing_pressure)

    def after(time: float, pressure: np.ndarray) -> dict[str, float]:
        sequence.GetInputPort("pressure_measured").FixValue(context, pressure)
        simulator.AdvanceTo(time)
        names = ("phase", "interaction_active", "grasp_lost")
        return {name: sequence.GetOutputPort(name).Eval(context)[0] for name in names}

    holding = {"phase": Phase.EXPLORE, "interaction_active": 1, "grasp_lost": 0}
    assert after(0.25, held) == holding
    assert after(0.35, held * [0.7, 0.7, 0.9, 0.7]) == holding
    assert after(0.45, 0.7 * held) == {
        "phase": Phase.STOP,
        "interaction_active": 0,
        "grasp_lost": 1,
    }


def test_impossible_values_are_refused_by_name() -> None:
    with pytest.raises(ValueError, match="period"):
        ImpedanceController(ImpedanceConfig(period=0.0), arm_model(), Q)
    with pytest.raises(ValueError, match="speed"):
        ExplorationController(ExplorationConfig(speed=-1.0), arm_model())
    with pytest.raises(ValueError, match="direction_E"):
        PullDirection(PullDirectionConfig(), arm_model(), 0.0 * BACK)
    with pytest.raises(ValueError, match="limit"):
        PullDirection(PullDirectionConfig(limit=120.0), arm_model(), BACK)


def pull_towards(tangent_E: np.ndarray, q: float = 0.1, **config: float) -> np.ndarray:
    """The pull after 2 s of exploring a joint along which the hand goes by `tangent_E`."""
    state = arm_model().Evaluate(np.concatenate([Q, np.zeros(7)]))
    system = PullDirection(PullDirectionConfig(follow_joint=True, **config), arm_model(), BACK)
    simulator = Simulator(system)
    context = simulator.get_mutable_context()
    screw_W = se3.adjoint(state.X_WE) @ np.concatenate([np.zeros(3), tangent_E])
    for name, value in (
        ("joint_state_measured", np.concatenate([Q, np.zeros(7)])),
        ("joint_remembered", np.concatenate([np.zeros(6), [q, 0.0]])),
        ("end_effector_screw_remembered", screw_W),
        ("phase", [float(Phase.EXPLORE)]),
    ):
        system.GetInputPort(name).FixValue(context, value)
    simulator.AdvanceTo(2.0)
    return np.asarray(system.get_output_port().Eval(context))


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_the_pull_turns_to_the_joint_whatever_sign_its_configuration_has(sign: float) -> None:
    tangent = np.array([0.0, 0.6, -0.8])
    assert_allclose(pull_towards(sign * 0.3 * tangent, q=sign), tangent, atol=1e-3)


def test_the_pull_stays_as_taught_while_the_joint_is_unknown_hardly_moved_or_absurd() -> None:
    tangent = np.array([0.0, 0.6, -0.8])
    assert_allclose(pull_towards(np.full(3, np.nan), q=np.nan), BACK)
    assert_allclose(pull_towards(tangent, q=0.02), BACK)
    assert_allclose(pull_towards(np.array([0.0, 0.8, -0.6]), limit=50.0), BACK)


def test_the_pull_turns_within_its_time() -> None:
    tangent = np.array([0.0, 0.6, -0.8])
    angle = np.arctan2(tangent[1], -tangent[2])
    (y, z) = pull_towards(tangent, time=2.0)[1:]
    assert_allclose(np.arctan2(y, -z) / angle, 1.0 - np.exp(-1.0), atol=0.05)
