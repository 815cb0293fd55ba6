"""The impedance controller: its law, and what it takes over before contact."""

import numpy as np
import pytest
from known_arm import Q, arm_model, desired
from numpy.testing import assert_allclose
from pydrake.common.value import AbstractValue
from pydrake.systems.analysis import Simulator

from crossmodal.controllers.arm.impedance import (
    DesiredMotion,
    ImpedanceConfig,
    ImpedanceController,
    ImpedanceGains,
    bounded_damping,
    impedance_wrench,
    likely_zeros,
    posture_torque,
    weight_error,
)
from crossmodal.maths import se3
from crossmodal.systems.sensors.joint_encoders import JointEncodersConfig, draw_joint_offset


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


def test_encoders_that_are_off_let_the_hand_feel_little_of_the_posture() -> None:
    arm, config, rng = arm_model(), ImpedanceConfig(), np.random.default_rng(0)
    truth, felt = arm.Evaluate(np.concatenate([Q, np.zeros(7)])), []
    for _ in range(60):
        q = Q + draw_joint_offset(JointEncodersConfig(), truth.J_E, rng)
        measured = arm.Evaluate(np.concatenate([q, np.zeros(7)]))
        elbow = np.linalg.svd(measured.J_E)[2][-1]
        tau = posture_torque(measured, q + 0.3 * elbow, config.posture_stiffness, 0.0)
        felt.append(np.linalg.norm(np.linalg.lstsq(truth.J_E.T, tau, rcond=None)[0][:3]))
    assert np.percentile(felt, 90) < 0.1  # [N m], what an error of the arm's weight makes it feel.


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


@pytest.mark.parametrize(
    ("field", "value"),
    [("period", 0.0), ("tare_time", np.nan), ("torque_limit", -1.0), ("posture_damping", np.inf)],
)
def test_impossible_values_are_refused_by_name(field: str, value: float) -> None:
    with pytest.raises(ValueError, match=f"ImpedanceController: {field} = "):
        ImpedanceController(ImpedanceConfig(**{field: value}), arm_model(), Q)


def test_a_posture_of_another_arm_is_refused() -> None:
    with pytest.raises(ValueError, match="need 7 joints"):
        ImpedanceController(ImpedanceConfig(), arm_model(), Q[:6])


def test_what_is_tared_holds_the_weight_elsewhere_too() -> None:
    """What is left of the weight's error half a radian away, with encoders that are 3 deg off."""
    arm, config, rng = arm_model(), ImpedanceConfig(), np.random.default_rng(1)
    kept, explained = [], []
    for _ in range(20):
        off, away = np.deg2rad(3.0) * rng.normal(size=7), 0.5 * rng.normal(size=7)

        def missing(q: np.ndarray, off: np.ndarray = off) -> np.ndarray:
            return arm.CalcHoldingTorque(q - off) - arm.CalcHoldingTorque(q)

        zeros = likely_zeros(arm, Q, missing(Q), config)
        rest = missing(Q) - weight_error(arm, Q, zeros)
        kept.append(missing(Q + away) - missing(Q))
        explained.append(missing(Q + away) - weight_error(arm, Q + away, zeros) - rest)
    assert np.linalg.norm(explained) < 0.5 * np.linalg.norm(kept)


def test_a_torque_that_no_zero_explains_is_kept() -> None:
    """The first joint is vertical, so that gravity makes no torque about it."""
    arm, config = arm_model(), ImpedanceConfig()
    torque = np.array([2.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    zeros = likely_zeros(arm, Q, torque, config)
    assert_allclose(weight_error(arm, Q + 0.3, zeros), np.zeros(7), atol=1e-6)


def test_damping_stops_no_motion_faster_than_a_digital_damper_can() -> None:
    state = arm_model().Evaluate(np.concatenate([Q, np.zeros(7)]))
    to_acceleration = state.J_E @ np.linalg.solve(state.M, state.J_E.T)
    A = np.random.default_rng(0).normal(size=(6, 6))
    for damping in (A @ A.T, np.diag([1.0, 1.0, 1.0, 80.0, 80.0, 200.0]), np.zeros((6, 6))):
        wanted = np.sort(np.linalg.eigvals(to_acceleration @ damping).real)
        for rate in (0.5 * wanted.max() + 0.01, 2.0 * wanted.max() + 0.01):
            bounded = bounded_damping(damping, state, rate)
            rates = np.sort(np.linalg.eigvals(to_acceleration @ bounded).real)
            assert_allclose(rates, np.minimum(wanted, rate), atol=1e-6 * rate)
            assert_allclose(bounded, bounded.T, atol=1e-9)


def controller_at(q: np.ndarray, v: np.ndarray, error: np.ndarray) -> Simulator:
    """A controller whose arm is off by `error` (6,) from its goal, before it tares."""
    arm, controller = arm_model(), ImpedanceController(ImpedanceConfig(), arm_model(), q)
    simulator = Simulator(controller)
    state = arm.Evaluate(np.concatenate([q, np.zeros(7)]))
    values = {"motion_desired": desired(state.X_WE @ se3.exp(error)), "gains_desired": gains(100.0)}
    for name, value in values.items():
        port = controller.GetInputPort(name)
        port.FixValue(simulator.get_mutable_context(), AbstractValue.Make(value))
    for name, numbers in (("joint_state_measured", np.concatenate([q, v])), ("tare", [0.0])):
        controller.GetInputPort(name).FixValue(simulator.get_mutable_context(), numbers)
    return simulator


def test_what_was_tared_changes_with_the_posture_as_the_weight_does() -> None:
    error, config = np.array([0.01, 0, 0, 0, 0.002, 0]), ImpedanceConfig()
    simulator = controller_at(Q, np.zeros(7), error)
    context, controller = simulator.get_mutable_context(), simulator.get_system()
    controller.GetInputPort("tare").FixValue(context, [1.0])
    simulator.AdvanceTo(config.tare_time - 0.5 * config.period)
    controller.GetInputPort("tare").FixValue(context, [0.0])
    arm, q = arm_model(), Q + 0.4
    there = arm.Evaluate(np.concatenate([q, np.zeros(7)]))
    motion = AbstractValue.Make(desired(there.X_WE))
    controller.GetInputPort("motion_desired").FixValue(context, motion)
    joint_state = np.concatenate([q, np.zeros(7)])
    controller.GetInputPort("joint_state_measured").FixValue(context, joint_state)
    simulator.AdvanceTo(config.tare_time + config.period)
    spring = arm.Evaluate(np.concatenate([Q, np.zeros(7)])).J_E.T @ (100.0 * error)
    zeros = likely_zeros(arm, Q, spring, config)
    change = weight_error(arm, q, zeros) - weight_error(arm, Q, zeros)
    posture = posture_torque(there, Q, config.posture_stiffness, config.posture_damping)
    torque = controller.GetOutputPort("torque_commanded").Eval(context)
    assert_allclose(torque, there.tau_bias + posture + spring + change, atol=1e-5)
    assert np.abs(change).max() > 1e-3


def test_the_torque_is_that_of_the_bounded_damping() -> None:
    config, v = ImpedanceConfig(), np.full(7, 0.1)
    simulator = controller_at(Q, v, np.zeros(6))
    state = arm_model().Evaluate(np.concatenate([Q, v]))
    damping = bounded_damping(100.0 * np.eye(6), state, 0.5 / config.period)
    posture = posture_torque(state, Q, config.posture_stiffness, config.posture_damping)
    expected = state.tau_bias + posture - state.J_E.T @ (damping @ state.V_WE_E)
    simulator.AdvanceTo(0.5 * config.period)
    torque = simulator.get_system().GetOutputPort("torque_commanded").Eval(simulator.get_context())
    assert_allclose(torque, expected, atol=1e-6)
    assert not np.allclose(damping, 100.0 * np.eye(6))
