"""Where the end-effector of a well calibrated arm is, and how sure that is."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from pydrake.math import RigidTransform

from crossmodal.maths import se3
from crossmodal.maths.consistency import normalised_squared_error
from crossmodal.plants.robots.arm_with_hand import make_arm_with_load
from crossmodal.plants.robots.lwr import LWR_WITH_THREE_FINGERS
from crossmodal.systems.arm_pose import ArmPose, joints_at, offset_variances
from crossmodal.systems.port_values import SampleWindow
from crossmodal.systems.proprioception.end_effector_pose import (
    EndEffectorPose,
    EndEffectorPoseConfig,
)

Q = np.array([-0.2, -0.43, 0.97, 1.19, 1.12, -0.89, 0.16])
BASE = np.diag(np.repeat([0.005, 0.003], 3) ** 2)
OFFSETS = np.full(7, 1e-3)


@pytest.fixture(scope="module")
def model():
    return make_arm_with_load(LWR_WITH_THREE_FINGERS, RigidTransform([0.0, -0.45, 0.0]))


def pose_of(model, q):
    context = model.CreateDefaultContext()
    model.SetPositions(context, q)
    frame = model.GetFrameByName("end_effector")
    return frame.CalcPoseInWorld(context).GetAsMatrix4()


def test_joints_are_carried_to_the_tick_by_their_velocity():
    tau = np.array([-0.06, -0.04, -0.02])
    v = np.linspace(-0.1, 0.1, 7)
    values = np.hstack([Q + tau[:, None] * v, np.tile(v, (3, 1))])
    q, variance = joints_at(tau, values, 1e-4, 5e-3)
    assert_allclose(q, Q, atol=1e-12)
    assert_allclose(variance, (1e-8 + (0.04 * 5e-3) ** 2) / 3)


def test_the_errors_of_base_and_joints_are_as_large_as_claimed(model):
    arm = ArmPose(model, BASE, OFFSETS)
    X_WE, white, lasting = arm.Evaluate(Q, 1e-6)
    assert_allclose(X_WE, pose_of(model, Q))
    rng = np.random.default_rng(3)
    X_WBase = RigidTransform([0.0, -0.45, 0.0]).GetAsMatrix4()
    nees = []
    for _ in range(300):
        base = se3.exp(np.linalg.cholesky(BASE) @ rng.normal(size=6))
        q = Q + OFFSETS * rng.normal(size=7) + 1e-3 * rng.normal(size=7)
        true = X_WBase @ base @ se3.inverse(X_WBase) @ pose_of(model, q)
        error = se3.log(se3.inverse(X_WE) @ true)
        nees.append(normalised_squared_error(error, white + lasting))
    assert_allclose(np.mean(nees), 6.0, rtol=0.15)


@pytest.mark.parametrize("error", range(13))
def test_displacements_are_derivatives_of_the_pose_by_each_error(model, error):
    """What is displaced by a twist in W about Wo is where the true base and joints put it."""
    root = np.linalg.cholesky(BASE + 1e-6 * np.ones((6, 6)))
    spread = np.linspace(1e-3, 2e-3, 7)
    arm = ArmPose(model, root @ root.T, spread)
    step = 1e-3
    c = step * np.eye(13)[error]
    X_WBase = RigidTransform([0.0, -0.45, 0.0]).GetAsMatrix4()
    moved = X_WBase @ se3.exp(root @ c[:6]) @ se3.inverse(X_WBase)
    true = moved @ pose_of(model, Q + spread * c[6:])
    twist = se3.log(true @ se3.inverse(pose_of(model, Q)))
    assert_allclose(arm.displacements(Q) @ c, twist, atol=1e-8 * step, rtol=1e-5)
    assert np.linalg.norm(twist) > 1e-7


def test_an_offset_that_was_taken_out_makes_the_pose_less_sure(model):
    arm = ArmPose(model, BASE, OFFSETS)
    window = SampleWindow(
        times=np.zeros(1), values=np.zeros((1, 14)), variances=np.full(14, 4.0 * 1e-6)
    )
    assert_allclose(offset_variances(window), np.full(7, 4e-6))
    _, _, usual = arm.Evaluate(Q, 1e-8)
    _, _, wider = arm.Evaluate(Q, 1e-8, offset_variances(window))
    _, _, fivefold = ArmPose(model, BASE, np.sqrt(5.0) * OFFSETS).Evaluate(Q, 1e-8)
    assert np.linalg.eigvalsh(wider - usual).min() > -1e-12
    assert_allclose(wider, fivefold, atol=1e-15)


def test_an_unknown_frame_is_refused(model):
    with pytest.raises(ValueError, match="no frame named 'fingertip'"):
        ArmPose(model, BASE, OFFSETS, frame="fingertip")


def test_the_filter_keeps_its_belief_without_samples(model):
    system = EndEffectorPose(EndEffectorPoseConfig(), ArmPose(model, BASE, OFFSETS))
    context = system.CreateDefaultContext()
    port = system.GetInputPort("joint_state_window")
    port.FixValue(context, SampleWindow(times=np.zeros(1), values=np.append(Q, np.zeros(7))[None]))
    system.ExecuteForcedEvents(context)
    belief = system.GetOutputPort("end_effector_latest").Eval(context)
    assert_allclose(belief.X, pose_of(model, Q))
    assert_allclose(
        belief.white_covariance[:6, :6],
        ArmPose(model, BASE, OFFSETS).Evaluate(Q, 1e-8)[1],
        atol=1e-12,
    )
    port.FixValue(context, SampleWindow(times=np.zeros(0), values=np.zeros((0, 14))))
    system.ExecuteForcedEvents(context)
    assert_allclose(system.GetOutputPort("end_effector_latest").Eval(context).X, belief.X)
