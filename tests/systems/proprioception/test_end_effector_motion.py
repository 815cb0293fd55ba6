"""The end-effector filter against closed forms, and its uncertainty against simulated encoders."""

import numpy as np
import pytest
from pydrake.common.value import AbstractValue
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import JacobianWrtVariable
from scipy.stats import chi2

from crossmodal.maths import se3
from crossmodal.models import SDF_DIR
from crossmodal.systems.port_values import EndEffectorBelief, SampleWindow
from crossmodal.systems.proprioception.end_effector_motion import (
    EndEffectorMotion,
    EndEffectorMotionConfig,
    calibration_bias_jacobian,
    fit_joint_samples,
    predict_motion,
)

Q_0 = np.array([0.3, 0.9, -0.2, 1.6, 0.4, -0.5, 0.1])
CONFIG = EndEffectorMotionConfig()


@pytest.fixture(scope="module")
def arm() -> MultibodyPlant:
    plant = MultibodyPlant(0.0)
    Parser(plant).AddModels(str(SDF_DIR / "wam_arm.sdf"))
    plant.WeldFrames(plant.world_frame(), plant.GetFrameByName("base"))
    plant.Finalize()
    return plant


def pose(plant: MultibodyPlant, q: np.ndarray) -> np.ndarray:
    context = plant.CreateDefaultContext()
    plant.SetPositions(context, q)
    return plant.GetFrameByName("tool_plate").CalcPoseInWorld(context).GetAsMatrix4()


def trajectory(t: np.ndarray, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Positions and velocities (K, 7) of slow sines with random phases."""
    phase, rate = rng.uniform(0, 2 * np.pi, 7), rng.uniform(0.5, 1.0, 7)
    angle = rate * t[:, None] + phase
    return Q_0 + 0.1 * (np.sin(angle) - np.sin(phase)), 0.1 * rate * np.cos(angle)


def run(
    plant: MultibodyPlant, seed: int, offset: np.ndarray, ticks: int
) -> tuple[list[EndEffectorBelief], list[np.ndarray]]:
    """Beliefs and true poses of every tick, from encoders at 200 Hz with noise and an offset."""
    rng = np.random.default_rng(seed)
    system = EndEffectorMotion(CONFIG, plant, "tool_plate")
    context = system.CreateDefaultContext()
    port = system.GetInputPort("joint_state_window")
    ticks_at = CONFIG.period * np.arange(ticks)
    samples_at = np.arange(0, 200 * ticks_at[-1] + 1e-9) / 200
    all_q, all_v = trajectory(np.append(samples_at, ticks_at), rng)
    beliefs, truth = [], []
    for tick, now in enumerate(ticks_at):
        new = (samples_at <= now + 1e-9) & (samples_at > now - CONFIG.period + 1e-9)
        q, v = all_q[: samples_at.size][new], all_v[: samples_at.size][new]
        noisy_q = q + offset + rng.normal(0, CONFIG.noise.angle, q.shape)
        noisy_v = v + rng.normal(0, CONFIG.noise.rate, v.shape)
        context.SetTime(now)
        window = SampleWindow(times=samples_at[new], values=np.hstack([noisy_q, noisy_v]))
        port.FixValue(context, AbstractValue.Make(window))
        beliefs.append(system.GetOutputPort("end_effector_estimated").Eval(context))
        truth.append(pose(plant, all_q[samples_at.size + tick]))
        system.ExecuteForcedEvents(context)
    return beliefs, truth


def nees(error: np.ndarray, covariance: np.ndarray) -> float:
    return float(error @ np.linalg.solve(covariance, error))


def test_window_fit_is_exact_for_constant_velocity() -> None:
    tau = np.linspace(-0.066, 0, 14)
    q0, v = np.array([0.1, -0.2]), np.array([0.3, 0.4])
    values = np.hstack([q0 + tau[:, None] * v, np.tile(v, (14, 1))])
    fitted_q, fitted_v, _ = fit_joint_samples(tau, values, CONFIG)
    np.testing.assert_allclose(fitted_q, q0, atol=1e-9)
    np.testing.assert_allclose(fitted_v, v, atol=1e-9)


def test_one_sample_gives_its_own_reading_and_noise() -> None:
    sample = np.array([[0.1, 0.2]])
    q, v, covariance = fit_joint_samples(np.zeros(1), sample, CONFIG)
    np.testing.assert_allclose([q[0], v[0]], sample[0], atol=1e-12)
    expected = np.diag([CONFIG.noise.angle**2, CONFIG.noise.rate**2])
    np.testing.assert_allclose(covariance, expected, rtol=1e-9)


def test_prediction_covariance_matches_finite_differences() -> None:
    rng = np.random.default_rng(0)
    X, V = se3.exp(rng.normal(size=6)), rng.normal(size=6)
    nothing = np.zeros((12, 12))
    X_next, _, Q = predict_motion(X, V, nothing, CONFIG)
    step = 1e-6
    F = np.eye(12)
    for i in range(12):
        delta = step * np.eye(12)[i]
        moved, V_moved, _ = predict_motion(X @ se3.exp(delta[:6]), V + delta[6:], nothing, CONFIG)
        F[:6, i] = se3.log(se3.inverse(X_next) @ moved) / step
        F[6:, i] = (V_moved - V) / step
    P = np.diag(rng.uniform(1, 2, 12))
    _, _, predicted = predict_motion(X, V, P, CONFIG)
    np.testing.assert_allclose(predicted, F @ P @ F.T + Q, atol=1e-5)


def test_absolute_error_agrees_with_covariance_over_episodes(arm: MultibodyPlant) -> None:
    rng = np.random.default_rng(1)
    context = arm.CreateDefaultContext()
    values = []
    for seed in range(40):
        start = Q_0
        arm.SetPositions(context, start)
        J_E = EndEffectorMotion(CONFIG, arm, "tool_plate")._kinematics(
            np.concatenate([start, np.zeros(7)])
        )[1]
        offset = calibration_bias_jacobian(J_E, CONFIG) @ rng.normal(size=6)
        beliefs, truth = run(arm, seed, offset, 12)
        error = se3.log(se3.inverse(beliefs[-1].X) @ truth[-1])
        values.append(nees(error, beliefs[-1].covariance[:6, :6]))
    low, high = chi2.ppf([0.001, 0.999], 6 * len(values))
    assert low < sum(values) < high


def test_offset_has_the_paper_size_at_the_first_posture(arm: MultibodyPlant) -> None:
    beliefs, _ = run(arm, 0, np.zeros(7), 1)
    sigma = np.sqrt(np.diag(beliefs[0].covariance)[:6])
    np.testing.assert_allclose(sigma[:3], np.deg2rad(3), rtol=0.15)
    np.testing.assert_allclose(sigma[3:], 0.01, rtol=0.15)


def test_error_without_offset_agrees_with_white_covariance(arm: MultibodyPlant) -> None:
    values = []
    for seed in range(12):
        beliefs, truth = run(arm, seed, np.zeros(7), 25)
        for belief, X in list(zip(beliefs, truth, strict=True))[5:]:
            error = se3.log(se3.inverse(belief.X) @ X)
            values.append(nees(error, belief.white_covariance[:6, :6]))
    assert 3.0 < np.mean(values) < 9.0
    assert np.sqrt(beliefs[-1].white_covariance[3, 3]) < 2e-4


def test_offset_nearly_cancels_in_displacements(arm: MultibodyPlant) -> None:
    rng = np.random.default_rng(5)
    J_E = EndEffectorMotion(CONFIG, arm, "tool_plate")._kinematics(np.append(Q_0, np.zeros(7)))[1]
    values = []
    for seed in range(30):
        offset = calibration_bias_jacobian(J_E, CONFIG) @ rng.normal(size=6)
        beliefs, truth = run(arm, seed, offset, 16)
        first, last = beliefs[0], beliefs[-1]
        error = se3.log(se3.inverse(last.X) @ truth[-1]) - se3.log(se3.inverse(first.X) @ truth[0])
        common = last.bias_jacobian - first.bias_jacobian
        white = last.white_covariance[:6, :6] + first.white_covariance[:6, :6]
        values.append(nees(error, common @ common.T + white))
    assert np.mean(values) < 12.0
    assert np.median(values) > 1.0


def test_latest_and_predicted_do_not_see_this_ticks_samples(arm: MultibodyPlant) -> None:
    system = EndEffectorMotion(CONFIG, arm, "tool_plate")
    assert not system.HasDirectFeedthrough(0, 1)
    assert not system.HasDirectFeedthrough(0, 2)
    assert system.HasDirectFeedthrough(0, 0)


def test_an_empty_window_predicts(arm: MultibodyPlant) -> None:
    system = EndEffectorMotion(CONFIG, arm, "tool_plate")
    context = system.CreateDefaultContext()
    port = system.GetInputPort("joint_state_window")
    values = np.append(Q_0, 0.1 * np.ones(7))[None]
    port.FixValue(context, AbstractValue.Make(SampleWindow(times=np.zeros(1), values=values)))
    system.ExecuteForcedEvents(context)
    empty = SampleWindow(times=np.zeros(0), values=np.zeros((0, 14)))
    port.FixValue(context, AbstractValue.Make(empty))
    predicted = system.GetOutputPort("end_effector_predicted").Eval(context)
    estimated = system.GetOutputPort("end_effector_estimated").Eval(context)
    np.testing.assert_allclose(estimated.X, predicted.X)
    assert np.linalg.norm(estimated.X[:3, 3] - pose(arm, Q_0)[:3, 3]) > 1e-3


def test_what_is_left_of_a_taken_out_offset_widens_the_pose(arm: MultibodyPlant) -> None:
    values = np.append(Q_0, np.zeros(7))[None]
    beliefs = []
    for common in (0.0, 1e-3):
        system = EndEffectorMotion(CONFIG, arm, "tool_plate")
        context = system.CreateDefaultContext()
        variances = np.repeat([common**2, 0.0], 7)
        for tick in range(20):
            now = tick * CONFIG.period
            context.SetTime(now)
            window = SampleWindow(times=np.array([now]), values=values, variances=variances)
            system.GetInputPort("joint_state_window").FixValue(context, AbstractValue.Make(window))
            system.ExecuteForcedEvents(context)
        beliefs.append(system.GetOutputPort("end_effector_latest").Eval(context))
    context = arm.CreateDefaultContext()
    arm.SetPositions(context, Q_0)
    frame = arm.GetFrameByName("tool_plate")
    J_E = arm.CalcJacobianSpatialVelocity(
        context, JacobianWrtVariable.kV, frame, np.zeros(3), arm.world_frame(), frame
    )
    usual, wide = (belief.white_covariance[:6, :6] for belief in beliefs)
    # Twenty ticks do not average it away.
    np.testing.assert_allclose(wide - usual, 1e-6 * J_E @ J_E.T, atol=1e-15)


@pytest.mark.parametrize("field", ["joint_acceleration", "linear_process_noise"])
def test_impossible_values_are_refused(arm: MultibodyPlant, field: str) -> None:
    config = EndEffectorMotionConfig()
    setattr(config, field, -1.0)
    with pytest.raises(ValueError, match=f"EndEffectorMotion: {field} = -1.0"):
        EndEffectorMotion(config, arm, "tool_plate")


def test_an_unknown_frame_is_refused(arm: MultibodyPlant) -> None:
    with pytest.raises(ValueError, match="no frame named 'hand_tip'"):
        EndEffectorMotion(CONFIG, arm, "hand_tip")
